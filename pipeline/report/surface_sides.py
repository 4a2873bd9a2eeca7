"""The surface as a page draws it below the cameras: from the source frame, and from the side."""

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..projection.z_buffer import rasterise_depth
from ..surface.mesh import TriangleMesh
from ..transforms import rigid
from .thumbnails import base64_text, webp
from .view_geometry import SourceFrame

SIDE_PX = 360
"""Longer side of a picture."""
AWAY = 300.0
"""Distance of the camera that draws it, in sizes of the surface: lines stay parallel to 0.3 %."""
AMBIENT = 0.45
"""Share of the light that does not depend on the slope."""


def surface_sides(surface: tuple[TriangleMesh, np.ndarray] | None, source: SourceFrame) -> list[dict[str, object]]:
    """For the page: each side's name, its axes in the model frame, and the surface (model frame, ``(V, 3)`` RGB) on it.

    ``box`` is where the picture lies: left, lower, right and upper end, in mm from the pivot along the axes.
    """
    right, up, towards = source.cam_from_model[:3, :3] * np.array([[1], [-1], [-1]])
    return [
        {"name": name, "across": right.tolist(), "up": axis.tolist()}
        | _picture(surface, source.pivot_model, right, axis)
        for name, axis in (("from the source frame", up), ("from the side", towards))
    ]


def _picture(
    surface: tuple[TriangleMesh, np.ndarray] | None, pivot: np.ndarray, across: np.ndarray, up: np.ndarray
) -> dict[str, object]:
    if surface is None:
        return {"picture": None, "box": None}
    mesh, colours = surface
    places = (mesh.vertices - pivot) @ np.stack([across, up], axis=1)
    low, high = places.min(axis=0), places.max(axis=0)
    size = np.maximum(high - low, 1e-6)
    width, height = (max(1, round(SIDE_PX * side)) for side in size / size.max())
    distance = AWAY * float(size.max())
    towards = np.cross(across, up)
    middle = pivot + (low + high) / 2 @ np.stack([across, up])
    rotation = np.stack([across, -up, -towards])
    camera = PinholeCamera(
        width, height, distance * width / size[0], distance * height / size[1], (width - 1) / 2, (height - 1) / 2
    )
    face = rasterise_depth(mesh, camera, rigid(rotation, -rotation @ (middle + distance * towards))).face
    shade = AMBIENT + (1 - AMBIENT) * np.abs(mesh.face_normals @ towards)
    painted = colours[mesh.faces].mean(axis=1) * shade[:, None]
    image = np.zeros((height, width, 4), np.uint8)
    image[face >= 0] = np.column_stack([painted[face[face >= 0], ::-1], np.full((face >= 0).sum(), 255)]).round()
    return {"picture": base64_text(webp(image, 82)), "box": [*low.tolist(), *high.tolist()]}
