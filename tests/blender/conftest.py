"""A case small enough to be rendered many times, and the script as a user starts it."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline.blender.loading import LoadedCase
from pipeline.camera import PinholeCamera
from pipeline.case import Case
from pipeline.frames import inverse_rigid, rigid
from pipeline.image_file import encode_png
from pipeline.mesh import TriangleMesh
from pipeline.mesh_export import write_ply

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "render_dataset.py"
WIDTH, HEIGHT = 64, 48
SAME_FRAME = rigid()
OFFSET = np.array([12.0, -7.0, 40.0])
CASE = """
units = "mm"
[frame]
image = "frame.png"
[camera]
size = [64, 48]
K = [[320.0, 0, 30.0], [0, 318.0, 25.5], [0, 0, 1]]
[surface]
mesh = "surface.ply"
[pose]
cam_from_model = [[1, 0, 0, -12], [0, -1, 0, -7], [0, 0, -1, 340], [0, 0, 0, 1]]
"""


def tiny_surface() -> TriangleMesh:
    """60 x 50 mm of hills around :data:`OFFSET`, so that the mesh's own frame is not the demeaned one."""
    x, y = np.meshgrid(np.linspace(-30, 30, 31), np.linspace(-25, 25, 26))
    vertices = np.stack([x, y, 3 * np.sin(x / 6) * np.cos(y / 5)], -1).reshape(-1, 3) + OFFSET
    index = np.arange(len(vertices)).reshape(x.shape)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return TriangleMesh(vertices, faces.astype(np.int32))


@pytest.fixture(scope="session")
def write_tiny_case() -> Callable[[Path], Path]:
    """Writes frame, surface and case file into a folder and gives the case file's path."""

    def write(folder: Path) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        v, u = np.mgrid[:HEIGHT, :WIDTH]
        image = np.stack([120 + 90 * np.sin(u / 9), 120 + 90 * np.cos(v / 7), 2.0 * u + v], -1)
        (folder / "frame.png").write_bytes(encode_png(image.astype(np.uint8)))
        write_ply(folder / "surface.ply", tiny_surface())
        (folder / "case.toml").write_text(CASE)
        return folder / "case.toml"

    return write


@pytest.fixture
def loaded_case(tmp_path: Path) -> Callable[..., LoadedCase]:
    """Makes a case in memory, without files, from a mesh (model frame, mm), a frame and its pose."""

    def make(
        mesh: TriangleMesh,
        image: np.ndarray,
        cam_from_model: np.ndarray,
        camera: PinholeCamera,
        valid: np.ndarray | None = None,
        *,
        given_from_model: np.ndarray = SAME_FRAME,
        mm_per_unit: float = 1.0,
    ) -> LoadedCase:
        case = Case(
            path=tmp_path / "case.toml",
            mm_per_unit=mm_per_unit,
            image=tmp_path / "frame.png",
            camera=camera,
            distortion=None,
            mesh=tmp_path / "surface.ply",
            cam_from_given=cam_from_model @ inverse_rigid(given_from_model),
        )
        valid = np.ones(camera.shape_hw, dtype=bool) if valid is None else valid
        return LoadedCase(case, image, valid, mesh, given_from_model, cam_from_model, (), ())

    return make


@pytest.fixture(scope="session")
def render_command() -> Callable[..., list[str]]:
    """The command line of ``render_dataset.py`` by this Python, from any arguments."""
    return lambda *arguments: [sys.executable, str(SCRIPT), *map(str, arguments)]


@pytest.fixture(scope="session")
def run_command() -> Callable[..., subprocess.CompletedProcess]:
    """Runs a command to its end; more environment variables by keyword."""

    def run(command: list[str], **environment: str) -> subprocess.CompletedProcess:
        return subprocess.run(
            command, capture_output=True, text=True, timeout=600, check=False, env=os.environ | environment
        )

    return run


@pytest.fixture
def addon():
    """The add-on, registered in an empty file as it is used from the checkout."""
    import bpy

    import blender_addon

    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    yield blender_addon
    blender_addon.unregister()
    bpy.ops.wm.read_factory_settings(use_empty=True)
