"""Fixtures: Blender's real window on a separate display, the extension installed from the zip, the sample case."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.blender.sample.photograph import take_photographs
from oneframe.blender.sample.sample_case import write_sample_case
from oneframe.sample.film import film_poses
from oneframe.sample.temporal_bone import MICROSCOPE, sample_surface
from tests.video.surgical_film import write_film
from tests.window import session

PICTURES = Path(__file__).resolve().parents[2] / "build" / "window"
SPACING = {} if os.environ.get("ONEFRAME_SCREENSHOTS") else {"spacing_mm": 0.6}
"""Of the sample's surface: coarse, as software OpenGL draws it in half the time."""


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
    """A user configuration with the extension installed from the zip."""
    folder = tmp_path_factory.mktemp("resources")
    session.install_extension(blender, extension_zip, folder)
    return folder


@pytest.fixture(scope="session")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The case file of the built-in sample, without the held-out photographs."""
    folder = tmp_path_factory.mktemp("sample")
    *_, case = write_sample_case(folder, sample_surface(**SPACING), held_out=False)
    return case


@pytest.fixture(scope="session")
def film(sample: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``film.avi`` beside that case, six frames at half the size: a loop about its pose; the last one is mirrored."""
    path, folder = sample.with_name("film.avi"), tmp_path_factory.mktemp("film")
    small = MICROSCOPE.resized(480, 360)
    shots = [(pose, folder / f"{number}.png") for number, pose in enumerate(film_poses()[::10])]
    images = [cv2.imread(str(each)) for each in take_photographs(sample_surface(**SPACING), small, shots)]
    images[-1] = np.ascontiguousarray(images[-1][:, ::-1])
    return write_film(path, [image[..., ::-1] for image in images], "MJPG", 5.0)


@pytest.fixture
def play(
    request: pytest.FixtureRequest, blender: str, resources: Path, sample: Path, tmp_path: Path
) -> Callable[[Path, float], dict]:
    """Plays a scenario file in a separate Blender; returns its facts, and fails if the scenario fails."""

    def run(scenario: Path, timeout_s: float) -> dict:
        if "film.avi" in scenario.read_text():
            request.getfixturevalue("film")
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
