"""Which registered frames to colour a surface with: those that show most of it better than the ones before.

Where a frame shows something else than the surface, such as an instrument or glare, it colours nothing.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from ..camera.pinhole import PinholeCamera
from ..colour.source_view import SourceView
from ..projection.z_buffer import rasterise_depth
from ..surface.mesh import TriangleMesh
from .flow_refinement import FlowFit
from .register import RegisteredFrame
from .verdict import ACCEPTED

MOST_FACES = 30_000
MOST_CANDIDATES = 100
BLOCK_PX, LEAST_PIXELS, LEAST_SHARE = 16, 4, 0.5
"""Side of the blocks that show the surface or not, pixels that a block needs, and share of them that must agree."""
AGREEING_PX = 2.0


class Candidate(NamedTuple):
    """A registered frame: its number, its pose ``(4, 4)``, mm, how sharp it is, and its :func:`hidden_blocks`."""

    number: int
    cam_from_model: np.ndarray
    sharpness: float
    hidden: np.ndarray


def candidate_of(number: int, image: np.ndarray, found: RegisteredFrame) -> Candidate | None:
    """A registered frame, ``(H, W, 3)`` uint8, if it is accepted, so that it may colour the surface."""
    if found.fit is None or found.verdict.state != ACCEPTED:
        return None
    return Candidate(number, found.fit.cam_from_model, _sharpness(image), hidden_blocks(found.fit))


def _sharpness(image: np.ndarray) -> float:
    """Mean strength of the finest detail of ``(H, W, 3)`` uint8, relative to the image's brightness."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return float(np.abs(cv2.Laplacian(grey, cv2.CV_32F)).mean() / max(grey.mean(), 1.0))


def hidden_blocks(fit: FlowFit) -> np.ndarray:
    """``(h, w)`` bool: the blocks of a frame in which the surface that the aligned frame saw is not to be seen."""
    height, width = fit.camera.shape_hw
    agrees, known = (np.zeros((-(-height // BLOCK_PX), -(-width // BLOCK_PX))) for _ in range(2))
    u, v = (fit.pixels // BLOCK_PX).astype(int).T
    np.add.at(known, (v, u), 1.0)
    np.add.at(agrees, (v, u), fit.residuals_px < AGREEING_PX)
    hidden = (known >= LEAST_PIXELS) & (agrees < LEAST_SHARE * known)
    # what covers the surface is larger than a block, and ends inside of others
    opened = cv2.morphologyEx(hidden.astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    return cv2.dilate(opened, np.ones((3, 3), np.uint8)) > 0


def shown_pixels(hidden: np.ndarray, camera: PinholeCamera, size_wh: tuple[int, int]) -> np.ndarray:
    """``(H, W)`` bool of an image of that size: no part of hidden blocks, which are of the camera's pixels."""
    pixels = np.repeat(np.repeat(hidden, BLOCK_PX, axis=0), BLOCK_PX, axis=1)[: camera.height, : camera.width]
    return cv2.resize(pixels.astype(np.uint8), size_wh, interpolation=cv2.INTER_NEAREST) == 0


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

    def shown(cam_from_model: np.ndarray, hidden: np.ndarray | None = None) -> np.ndarray:
        inverse = rasterise_depth(mesh, camera, cam_from_model).inverse_depth.astype(np.float32)
        if hidden is not None:
            inverse[~shown_pixels(hidden, camera, camera.size_wh)] = 0
        image, valid = np.zeros((*camera.shape_hw, 3), np.float32), np.ones(camera.shape_hw, bool)
        view = SourceView(image, valid, camera, cam_from_model, inverse_depth=inverse)
        return np.where(view.observed(points, normals), view.resolution(points, normals), 0.0)

    few = candidates[:: max(1, -(-len(candidates) // MOST_CANDIDATES))]
    best = shown(source)
    left = {each.number: (shown(each.cam_from_model, each.hidden), each.sharpness) for each in few}
    sharpest = max((each.sharpness for each in few), default=1.0)
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
