"""Fixtures: Blender's real window on a separate display, the extension installed from the zip, the sample case."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from oneframe.blender.sample.sample_case import write_sample_case
from oneframe.sample.temporal_bone import sample_surface
from tests.window import session

PICTURES = Path(__file__).resolve().parents[2] / "build" / "window"


@pytest.fixture(scope="session")
def blender() -> str:
    """The Blender program."""
    if not (program := os.environ.get("BLENDER")):
        pytest.skip("the environment variable BLENDER names no Blender program")
    if not shutil.which("Xvfb"):
        pytest.skip("Xvfb is not installed, which gives Blender a window without a screen")
    return program


@pytest.fixture(scope="session")
def resources(blender: str, extension_zip: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A user configuration with the extension installed from the zip, not enabled."""
    folder = tmp_path_factory.mktemp("resources")
    session.install_extension(blender, extension_zip, folder)
    return folder


@pytest.fixture(scope="session")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The case file of the built-in sample, without the held-out photographs."""
    folder = tmp_path_factory.mktemp("sample")
    # coarse: software OpenGL draws it in half the time
    finest = {} if os.environ.get("ONEFRAME_SCREENSHOTS") else {"spacing_mm": 0.6}
    *_, case = write_sample_case(folder, sample_surface(**finest), held_out=False)
    return case


@pytest.fixture
def play(blender: str, resources: Path, sample: Path, tmp_path: Path) -> Callable[[Path, float], dict]:
    """Plays a scenario file in a separate Blender; returns its facts, and fails if the scenario fails."""

    def run(scenario: Path, timeout_s: float) -> dict:
        pictures = PICTURES / scenario.stem.removeprefix("scenario_")
        return session.play_scenario(
            blender,
            scenario,
            resources=resources,
            case=sample,
            folder=tmp_path,
            pictures=pictures,
            timeout_s=timeout_s,
        )

    return run
