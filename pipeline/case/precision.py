"""Whether single precision is enough for a case: Blender's numbers, and those of most mesh files, have 24 bits.

A coordinate of size c is known to c times :data:`UNIT_ROUNDOFF`. Projected with f / z pixels per mm, that is a shift of
the edges in the views. The measurements of ``scripts/benchmarks/sweeps/camera.py`` agree with it.
"""

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..files.numbers import format_two_digits
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre, transform_points

EXACT_PX = 0.01
"""How far edges of views may be from where K says: what the documentation promises."""

UNIT_ROUNDOFF = 2.0**-24
"""Largest relative error of a number in single precision (IEEE 754)."""

LONGEST_EXACT_FOCAL_PX = EXACT_PX / UNIT_ROUNDOFF
"""Focal length beyond which edges may be further off, for a surface nearer to its middle than to the camera."""

STORED_EXACTLY = 1e-3
"""Share of a step of single precision: coordinates this near to one all come from it."""


def precision_doubts(
    name: str, camera: PinholeCamera, mesh: TriangleMesh, mesh_from_model: np.ndarray, cam_from_model: np.ndarray
) -> list[str]:
    """Messages about edges that may be more than :data:`EXACT_PX` off; empty if none are.

    Parameters
    ----------
    name
        Name of the surface's file.
    camera
        Intrinsics of the frame, px.
    mesh
        In the model frame, mm, with some of it in front of the camera.
    mesh_from_model, cam_from_model
        4x4, mm.
    """
    depth = transform_points(cam_from_model, mesh.vertices)[:, 2]
    px_per_mm = max(camera.fx, camera.fy) / float(np.median(depth[depth > 0]))
    messages = []
    shown_px = UNIT_ROUNDOFF * px_per_mm * max(float(np.linalg.norm(camera_centre(cam_from_model))), mesh.radius)
    if shown_px > EXACT_PX:
        messages.append(
            f"K: {px_per_mm:.3g} px per mm is more than Blender's single precision resolves: edges in views are off by "
            f"up to {format_two_digits(shown_px)} px, elsewhere {EXACT_PX:g} px; check the focal length"
        )
    given = mesh.vertices + mesh_from_model[:3, 3]
    farthest = float(np.abs(given).max())
    step = float(np.spacing(np.float32(farthest)))
    stored_px = UNIT_ROUNDOFF * px_per_mm * farthest
    if stored_px > EXACT_PX and np.abs(given - given.astype(np.float32)).max() <= STORED_EXACTLY * step:
        messages.append(
            f"{name}: the surface lies up to {farthest / 1000:.3g} m from the origin of its file, whose single "
            f"precision has steps of {format_two_digits(step)} mm there: edges in views are off by up to "
            f"{format_two_digits(stored_px)} px; export it nearer to the origin, or with more digits"
        )
    return messages
