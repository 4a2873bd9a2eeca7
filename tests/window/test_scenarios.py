"""Plays every ``scenario_*.py`` of this folder in Blender's real window, each in a separate Blender.

A scenario that takes long has a line ``TIMEOUT_S = 1200``.
"""

import re
from pathlib import Path

import pytest

pytestmark = pytest.mark.window

SCENARIOS = sorted(Path(__file__).parent.glob("scenario_*.py"))
TIMEOUT_S = 900


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda path: path.stem.removeprefix("scenario_"))
def test_scenario(scenario, play):
    own = re.search(r"^TIMEOUT_S = (\d+)$", scenario.read_text(), re.MULTILINE)
    print(play(scenario, int(own[1]) if own else TIMEOUT_S))
