"""Draws the uncertainty of the pose: confidence ellipses of surface points; its least certain direction in words."""

import bpy
import numpy as np

from ..pipeline.alignment.pose_uncertainty import PoseUncertainty, ellipse_outlines
from ..pipeline.blender.alignment.surface_object import visible_surface
from ..pipeline.camera.pinhole import PinholeCamera
from ..state import from_scene, pose_evidence
from ..ui.frame_view import FrameView
from ..ui.strokes import Colour, Strokes
from ..view.zoom import free_rectangle
from . import solve
from .marks import LandmarkView
from .solve import Solution

COLOUR: Colour = (0.87, 0.68, 1.0, 1.0)
SAMPLES = 7
"""Points of the visible surface at which the uncertainty is drawn, in addition to the landmarks and the pivot."""

EDGE_MARGIN = 0.08
"""Least distance of these from the edges of the frame, as a fraction of its size."""

LEGEND, LINE = (70.0, 34.0), 20.0
"""Lower left corner of the legend, and height of a line, in pixels at interface scale 1."""


def add_uncertainty(strokes: Strokes, scene: bpy.types.Scene, view: LandmarkView, solved: Solution) -> None:
    """Add a legend and, in the camera view, the ellipses, if the current pose's uncertainty is known."""
    found = current_uncertainty(scene, solved)
    if found is None:
        return
    uncertainty, points = found
    legend = [f"Least certain: {uncertainty.weakest}"]
    if view.frame is not None:
        samples = _samples(scene, view.cam_from_model)
        _add_ellipses(strokes, scene, view, view.frame, uncertainty, samples, width=1.0)
        _add_ellipses(strokes, scene, view, view.frame, uncertainty, points, width=1.5)
        legend.append("Ellipses: 95 % confidence regions of surface points")
    corner = np.array(LEGEND) * strokes.unit
    if bpy.context.area is not None:
        # above what else is drawn at the bottom
        corner[1] = max(corner[1], free_rectangle(bpy.context.area)[0][1] + LINE / 2 * strokes.unit)
    for number, text in enumerate(legend):
        strokes.text(corner + np.array([0, LINE * number]) * strokes.unit, text, COLOUR)


def current_uncertainty(scene: bpy.types.Scene, solved: Solution) -> tuple[PoseUncertainty, np.ndarray] | None:
    """The uncertainty of the current pose, and ``(N, 3)`` landmarks that it rests on; ``None`` if it is not known.

    It is that of the landmarks, or of the refinement, and holds for the pose that these have found alone.
    """
    refined = pose_evidence.remembered_uncertainty(scene)
    if refined is not None:
        return refined, np.empty((0, 3))
    if solved.alignment is not None and solve.is_current(scene, solved):
        return solved.alignment.estimate.uncertainty, solved.alignment.points
    return None


def _add_ellipses(
    strokes: Strokes,
    scene: bpy.types.Scene,
    view: LandmarkView,
    frame: FrameView,
    uncertainty: PoseUncertainty,
    points_model: np.ndarray,
    *,
    width: float,
) -> None:
    covariances = uncertainty.pixel_covariances(points_model, frame.camera, view.cam_from_model)
    outlines = ellipse_outlines(covariances, uncertainty.ellipse_scale())
    for centre, outline in zip(view.region_from_model(scene, points_model), outlines, strict=True):
        strokes.line(centre + outline * frame.scale, COLOUR, width=width, closed=True)


def _samples(scene: bpy.types.Scene, cam_from_model: np.ndarray) -> np.ndarray:
    """``(N, 3)`` visible surface points (model frame, mm), far from each other and from the edges of the frame."""
    camera = from_scene.camera(scene)
    seen = visible_surface(from_scene.surface_of(scene), camera, cam_from_model)
    inner = np.flatnonzero(is_inner(seen.pixels, camera))
    return seen.points_model[inner[_spread(seen.pixels[inner], SAMPLES)]]


def is_inner(pixels: np.ndarray, camera: PinholeCamera) -> np.ndarray:
    """``(N,)`` bool: which of ``(N, 2)`` pixels are not near the edges of the frame."""
    margin = EDGE_MARGIN * max(camera.size_wh)
    return ((pixels > margin) & (pixels < np.array(camera.size_wh) - margin)).all(axis=1)


def _spread(pixels: np.ndarray, count: int) -> list[int]:
    """Indices of points far from each other: each is the farthest from those already chosen (Gonzalez 1985)."""
    if len(pixels) == 0:
        return []
    chosen = [int(np.argmax(((pixels - pixels.mean(axis=0)) ** 2).sum(axis=1)))]
    nearest = np.full(len(pixels), np.inf)
    while len(chosen) < min(count, len(pixels)):
        nearest = np.minimum(nearest, ((pixels - pixels[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(np.argmax(nearest)))
    return chosen
