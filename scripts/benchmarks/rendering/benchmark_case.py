"""The surface, frame and case for measurements of speed: synthetic, so that every machine measures the same."""

from pathlib import Path

import numpy as np

from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import Case
from oneframe.case.case_writer import write_case
from oneframe.files.writing import write_bytes_atomically
from oneframe.images.pixel_values import to_uint8
from oneframe.images.png import encode_png
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import rigid

from ..grid_mesh import grid_mesh

VIEW_CAMERA = PinholeCamera(640, 480, 3200.0, 3190.0, 322.5, 236.0)
"""The camera of the rendered views."""
FRAME_CAMERA = VIEW_CAMERA.resized(1280, 960)
FRAME_SEED = 4
CAM_FROM_MESH = rigid(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 300.0]))
TRIANGLES = 200_000


def ridged_bowl(triangles: int) -> TriangleMesh:
    """A bowl with ridges like a drilled bone, in mm, that fills the view; about ``triangles`` faces."""
    side = max(2, round(np.sqrt(triangles / 2)))
    x, y = np.meshgrid(np.linspace(-34, 34, side + 1), np.linspace(-27, 27, side + 1))
    r = np.hypot(x, y)
    # the wall leans over the floor, so that there is occlusion
    lean = 1 + 0.12 * np.exp(-(((r - 13) / 3) ** 2))
    z = -14 / (1 + np.exp((r - 13) * 2.2)) + 0.6 * np.sin(x * 1.3) * np.cos(y * 1.1) + 0.15 * np.sin(4 * x + 3 * y)
    return grid_mesh(np.stack([x * lean, y * lean, z], -1))


def detailed_frame(rng: np.random.Generator) -> np.ndarray:
    """``(H, W, 3)`` uint8 image for :data:`FRAME_CAMERA`, with detail down to a few pixels as in a photograph."""
    height, width = FRAME_CAMERA.shape_hw
    image = np.zeros((height, width, 3))
    for period in (160, 40, 12, 5):
        coarse = rng.normal(size=(height // period + 3, width // period + 3, 3))
        v = (np.arange(height) / period)[:, None]
        u = (np.arange(width) / period)[None]
        i, j, s, t = v.astype(int), u.astype(int), (v % 1)[..., None], (u % 1)[..., None]
        smooth = (coarse[i, j] * (1 - t) + coarse[i, j + 1] * t) * (1 - s)
        smooth += (coarse[i + 1, j] * (1 - t) + coarse[i + 1, j + 1] * t) * s
        image += smooth * period**0.5
    return to_uint8(0.55 + 0.16 * image / image.std())


def write_benchmark_case(folder: Path, triangles: int = TRIANGLES) -> Path:
    """Write surface, frame and case file into a folder; returns the case file's path."""
    folder.mkdir(parents=True, exist_ok=True)
    surface, frame, case = (folder / name for name in ("surface.ply", "frame.png", "case.toml"))
    write_ply(surface, ridged_bowl(triangles))
    write_bytes_atomically(frame, encode_png(detailed_frame(np.random.default_rng(FRAME_SEED))))
    write_case(case, Case(case, 1.0, frame, FRAME_CAMERA, None, surface, CAM_FROM_MESH))
    return case
