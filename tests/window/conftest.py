"""Fixtures: Blender's real window on a separate display, the extension installed from the zip, the sample case."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from oneframe.blender.render.engines import opened_engine, reference_view_of
from oneframe.case.case_file import read_case
from oneframe.case.loaded_case import load_case
from oneframe.colour.reference_view import unseen_colours_of
from oneframe.colour.shading import ColouredSurface
from oneframe.images.pixel_values import to_uint8
from oneframe.sample.film import film_poses
from oneframe.sample.temporal_bone import MICROSCOPE, sample_surface
from oneframe.surface.mesh_writer import write_ply
from scripts.dev.build_extension import sample_case
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
    """The case file of the built-in sample as the extension has it, without the held-out photographs."""
    folder = Path(shutil.copytree(sample_case(), tmp_path_factory.mktemp("sample") / "sample"))
    if SPACING:
        write_ply(folder / "surface.ply", sample_surface(**SPACING).bone)
    return folder / "case.toml"


@pytest.fixture(scope="session")
def film(sample: Path) -> Path:
    """``film.avi`` beside that case, six views at half the size: a loop about its pose; the last one is mirrored."""
    loaded = load_case(read_case(sample))
    source = reference_view_of(loaded, "raster")
    surface = ColouredSurface(source.mesh, source.views, unseen_colours_of(source, "fill"), source.pivot_model)
    with opened_engine("raster", surface, MICROSCOPE.resized(480, 360)) as render:
        views = [render(pose @ loaded.surface.mesh_from_model).rgb for pose in film_poses()[::10]]
    images = [to_uint8(view) for view in views]
    images[-1] = np.ascontiguousarray(images[-1][:, ::-1])
    return write_film(sample.with_name("film.avi"), images, "MJPG", 5.0)


@pytest.fixture
def play(
    request: pytest.FixtureRequest, blender: str, resources: Path, sample: Path, tmp_path: Path
) -> Callable[..., dict]:
    """Plays a scenario file in a separate Blender; returns its facts, and fails if the scenario fails."""

    def run(scenario: Path, timeout_s: float, size_wh: tuple[int, int] = session.SIZE) -> dict:
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
            size_wh=size_wh,
        )

    return run
