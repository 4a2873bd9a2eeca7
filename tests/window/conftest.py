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


@pytest.fixture(scope="session")
def write_film() -> Callable[[Path], None]:
    """Writes a film of the coarse sample, at half its size: a loop about the frame's pose; the last one is mirrored."""

    def write(path: Path) -> None:
        poses, small = film_poses()[::5], MICROSCOPE.resized(480, 360)
        shots = [(pose, path.with_name(f"film_{number}.png")) for number, pose in enumerate(poses)]
        images = [cv2.imread(str(each)) for each in take_photographs(sample_surface(spacing_mm=0.6), small, shots)]
        images[-1] = np.ascontiguousarray(images[-1][:, ::-1])
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 5.0, small.size_wh)
        for image in images:
            writer.write(image)
        writer.release()

    return write


@pytest.fixture
def play(
    blender: str, resources: Path, sample: Path, tmp_path: Path, write_film: Callable[[Path], None]
) -> Callable[[Path, float], dict]:
    """Plays a scenario file in a separate Blender; returns its facts, and fails if the scenario fails."""

    def run(scenario: Path, timeout_s: float) -> dict:
        if "film.avi" in scenario.read_text() and not sample.with_name("film.avi").exists():
            write_film(sample.with_name("film.avi"))
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
