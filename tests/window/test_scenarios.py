"""Plays every ``scenario_*.py`` of this folder in Blender's real window, each in a separate Blender.

A scenario that takes long has a line ``TIMEOUT_S = 1200``, one that needs data beside the repository ``DATA = "name"``.
"""

import re
from pathlib import Path

import pytest

pytestmark = pytest.mark.window

SCENARIOS = sorted(Path(__file__).parent.glob("scenario_*.py"))
SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
TIMEOUT_S = 900


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda path: path.stem.removeprefix("scenario_"))
def test_scenario(scenario, play):
    text = scenario.read_text()
    own, data = (re.search(rule, text, re.MULTILINE) for rule in (r"^TIMEOUT_S = (\d+)$", r'^DATA = "(\w+)"$'))
    if data and not (SHARED / data[1]).is_dir():
        pytest.skip(f"no folder shared/data/{data[1]} beside the repository")
    print(play(scenario, int(own[1]) if own else TIMEOUT_S))
