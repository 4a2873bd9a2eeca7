"""Which registered frames to colour a surface with: those that show most of it better than the ones before."""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from ..camera.pinhole import PinholeCamera
from ..colour.source_view import SourceView
from ..projection.z_buffer import rasterise_depth
from ..surface.mesh import TriangleMesh

MOST_FACES = 30_000


class Candidate(NamedTuple):
    """A registered frame: its number, its pose ``(4, 4)``, mm, and how sharp it is."""

    number: int
    cam_from_model: np.ndarray
    sharpness: float


def sharpness(image: np.ndarray) -> float:
    """Mean strength of the finest detail of ``(H, W, 3)`` uint8, relative to the image's brightness."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return float(np.abs(cv2.Laplacian(grey, cv2.CV_32F)).mean() / max(grey.mean(), 1.0))


def chosen_sources(
    mesh: TriangleMesh, camera: PinholeCamera, source: np.ndarray, candidates: Sequence[Candidate], count: int
) -> list[int]:
    """Choose frames one by one, by how much resolution each adds on the surface.

    Parameters
    ----------
    mesh
        The surface, model frame.
    camera
        Of all frames.
    source
        ``(4, 4)`` pose of the aligned frame, mm, which comes first.
    candidates
        The registered frames.
    count
        How many at most.

    Returns
    -------
    Numbers of the chosen frames, the best one first; frames that add nothing are left out.
    """
    faces = slice(None, None, max(1, len(mesh.faces) // MOST_FACES))
    points, normals = mesh.face_centres[faces], mesh.face_normals[faces]
    area = np.linalg.norm(mesh.face_cross[faces], axis=1)

    def shown(cam_from_model: np.ndarray) -> np.ndarray:
        inverse = rasterise_depth(mesh, camera, cam_from_model).inverse_depth.astype(np.float32)
        image, valid = np.zeros((*camera.shape_hw, 3), np.float32), np.ones(camera.shape_hw, bool)
        view = SourceView(image, valid, camera, cam_from_model, inverse_depth=inverse)
        return np.where(view.observed(points, normals), view.resolution(points, normals), 0.0)

    best, left = shown(source), {each.number: (shown(each.cam_from_model), each.sharpness) for each in candidates}
    sharpest = max((each.sharpness for each in candidates), default=1.0)
    found: list[int] = []
    while left and len(found) < count:
        gains = {
            number: sharp / sharpest * float(area @ np.maximum(resolution - best, 0.0))
            for number, (resolution, sharp) in left.items()
        }
        number = max(gains, key=lambda each: gains[each])
        if gains[number] <= 0:
            break
        best = np.maximum(best, left.pop(number)[0])
        found.append(number)
    return found
