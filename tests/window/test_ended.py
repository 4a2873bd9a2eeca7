"""Blender ends in the middle of a queue, and nothing is lost; scenario_queue shows what a kill would leave."""

from pathlib import Path

import pytest

from tests.window import session
from tests.window.conftest import PICTURES

pytestmark = pytest.mark.window

HERE = Path(__file__).parent
TIMEOUT_S = 600


def test_what_was_not_saved_is_offered_at_the_next_start(blender, resources, sample, tmp_path):
    before = tmp_path / "before"

    def play(name, folder, **given):
        folder.mkdir()
        pictures = PICTURES / f"ended_{name}"
        scenario = HERE / f"ended_{name}.py"
        return session.play_scenario(blender, scenario, folder=folder, pictures=pictures, timeout_s=TIMEOUT_S, **given)

    # it writes no result
    with pytest.raises(AssertionError, match=r"^Blender ended with "):
        play("first", before, resources=resources, case=sample)
    facts = play("second", tmp_path / "after", resources=before / "resources", case=sample)
    print(facts)
