"""Plays every ``scenario_*.py`` of this folder in Blender's real window, each in a separate Blender.

A scenario that takes long has a line ``TIMEOUT_S = 1200``, and one that needs a larger window ``WINDOW = 1024, 640``.
"""

import re
from pathlib import Path

import pytest

from tests.window import session

pytestmark = pytest.mark.window

SCENARIOS = sorted(Path(__file__).parent.glob("scenario_*.py"))
TIMEOUT_S = 900


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda path: path.stem.removeprefix("scenario_"))
def test_scenario(scenario, play):
    text = scenario.read_text()
    own = re.search(r"^TIMEOUT_S = (\d+)$", text, re.MULTILINE)
    size = re.search(r"^WINDOW = (\d+), (\d+)$", text, re.MULTILINE)
    size_wh = (int(size[1]), int(size[2])) if size else session.SIZE
    print(play(scenario, int(own[1]) if own else TIMEOUT_S, size_wh))
