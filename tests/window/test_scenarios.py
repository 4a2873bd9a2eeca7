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


@pytest.mark.parametrize(
    ("body", "messages", "timeout_s"),
    [
        ("yield from user.until(lambda: False, 'the moon', timeout_s=0.2)", "the moon", TIMEOUT_S),
        ("while True: pass", "not finished after", 8),
    ],
)
def test_a_scenario_that_goes_wrong_fails(body, messages, timeout_s, play, tmp_path):
    scenario = tmp_path / "scenario_going_wrong.py"
    scenario.write_text(f"def scenario(user):\n    yield 0\n    {body}\n")
    with pytest.raises(AssertionError, match=messages):
        play(scenario, timeout_s)
