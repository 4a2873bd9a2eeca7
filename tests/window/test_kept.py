"""Blender ends in the middle of a queue by kill -9 and by its cross, with File > New in between: nothing is lost."""

from pathlib import Path

import pytest

from tests.window import session
from tests.window.conftest import PICTURES

pytestmark = pytest.mark.window

TIMEOUT_S = 600
ENDS = r"^Blender ended with -9", r"^Blender ended with 0", ""
"""Of the three starts: the first two end without a result."""


def test_a_pose_outlives_a_kill_the_cross_and_a_new_file(blender, resources, sample, tmp_path):
    case, scenario = sample, Path(__file__).with_name("kept.py")
    for number, ends in enumerate(ENDS):
        folder = tmp_path / str(number)
        folder.mkdir()
        given = {"resources": resources, "case": case, "folder": folder, "pictures": PICTURES / f"kept_{number}"}
        if ends:
            with pytest.raises(AssertionError, match=ends):
                session.play_scenario(blender, scenario, timeout_s=TIMEOUT_S, **given)
            # the next start finds what this one has left
            case = folder / "case" / sample.name
        else:
            print(session.play_scenario(blender, scenario, timeout_s=TIMEOUT_S, **given))
