"""Blender ends in the middle of a queue by kill -9 and by its cross, with File > New in between: nothing is lost."""

from pathlib import Path

import pytest

from tests.window import session
from tests.window.conftest import PICTURES

pytestmark = pytest.mark.window

HERE = Path(__file__).parent
TIMEOUT_S = 600
STARTS = {"killed": r"^Blender ended with -9", "left_by_cross": r"^Blender ended with 0", "read_back": ""}
"""Start of Blender -> how it ends, without a result; the last one ends with one."""


def test_a_pose_outlives_a_kill_the_cross_and_a_new_file(blender, resources, sample, tmp_path):
    shared = tmp_path / "case"
    for name, ends in STARTS.items():
        (tmp_path / name).mkdir()
        given = {
            "resources": resources,
            "case": shared / sample.name if shared.exists() else sample,
            "folder": tmp_path / name,
            "pictures": PICTURES / f"kept_{name}",
            "timeout_s": TIMEOUT_S,
        }
        scenario = HERE / f"kept_{name}.py"
        if ends:
            # it writes no result
            with pytest.raises(AssertionError, match=ends):
                session.play_scenario(blender, scenario, **given)
            # the next start finds what this one has left
            shared = tmp_path / name / "case"
        else:
            print(session.play_scenario(blender, scenario, **given))
