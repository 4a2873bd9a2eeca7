"""Sweeps of the colouring on real photographs: a wrong pose, and grazing angles.

The surface gets its colours from one photograph and is judged by the next one. The two differ in light and exposure,
and their poses are not exact: an error is what comes on top of that of the same pair at the published pose, or of that
where the frame saw the surface from the front.
"""

import itertools
from collections.abc import Sequence

import numpy as np

from oneframe.colour.colour_doubts import MAX_STATED_ERROR_PX
from oneframe.colour.ray_tracer import RayTracer
from oneframe.colour.seen_frame import MAX_INCIDENCE_DEG
from oneframe.colour.shading import ColouredSurface
from oneframe.evaluation.view_scores import FEWEST_PIXELS, colour_gain, corrected
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.transforms import inverse_rigid, rigid, transform_points

from ..alignment.refinement_scenes import RefinementScene
from .cells import Cell, Limit, Outcome
from .colouring import INCIDENCES_DEG, POSE_ERRORS_PX, WRONG_CODES, reference

SERIES = "photographs"
SHIFTS_PX = (0.0, *POSE_ERRORS_PX[4::2])
BINS_DEG = list(itertools.pairwise(INCIDENCES_DEG[:7]))


def measure(scenes: Sequence[RefinementScene], seed: int) -> list[Cell]:
    """Colour error of each next photograph.

    By a shift of the pose in the image, in random directions, which nobody states; and by the angle at which the frame
    saw the surface: ``x`` is the middle of a bin.
    """
    rng = np.random.default_rng([seed, 2])
    by_shift, by_angle = [], []
    for frame, judge in itertools.pairwise([*scenes, scenes[0]]):
        angle = rng.uniform(0, 2 * np.pi)
        mm_per_px = frame.middle_cam[2] / frame.camera.fx * np.array([np.cos(angle), np.sin(angle), 0.0])
        moved = (rigid(translation=shift * mm_per_px) @ frame.cam_from_model for shift in SHIFTS_PX)
        exact, *others = (_errors(frame, pose, judge) for pose in moved)
        by_shift.append([float(np.nanmean(each)) for each in (exact, *others)])
        angles = _incidence_deg(frame, judge)
        parts = (exact[~np.isnan(exact) & (angles >= low) & (angles < high)] for low, high in BINS_DEG)
        by_angle.append([float(part.mean()) if len(part) >= FEWEST_PIXELS else np.nan for part in parts])
    middles = [(low + high) / 2 for low, high in BINS_DEG]
    return [
        *_cells("pose error", SHIFTS_PX, by_shift, Limit("MAX_STATED_ERROR_PX", MAX_STATED_ERROR_PX)),
        *_cells("incidence", middles, by_angle, Limit("MAX_INCIDENCE_DEG", MAX_INCIDENCE_DEG)),
    ]


def _errors(frame: RefinementScene, cam_from_model: np.ndarray, judge: RefinementScene) -> np.ndarray:
    """``(H, W)`` mean colour errors of 255 of the photograph at equal exposure; NaN where the frame saw nothing."""
    source = reference(frame.mesh, frame.image, frame.camera, cam_from_model)
    view = RayTracer(ColouredSurface(source.mesh, source.views), frame.camera).render(judge.cam_from_model)
    matched = corrected(view.rgb, colour_gain(judge.image, view.rgb, view.observed))
    return np.where(view.observed, 255 * np.abs(matched - judge.image).mean(axis=2), np.nan)


def _incidence_deg(frame: RefinementScene, judge: RefinementScene) -> np.ndarray:
    """``(H, W)`` angles at which a frame sees what is in a photograph's pixels; NaN beside the surface."""
    raster = rasterise_depth(judge.mesh, judge.camera, judge.cam_from_model)
    shown = raster.face >= 0
    points_cam = judge.camera.rays_cam(judge.camera.pixel_grid())[shown] / raster.inverse_depth[shown][:, None]
    points = transform_points(inverse_rigid(judge.cam_from_model), points_cam)
    towards = inverse_rigid(frame.cam_from_model)[:3, 3] - points
    normals = judge.mesh.face_normals[raster.face[shown]]
    cosines = (normals * towards).sum(axis=1) / np.linalg.norm(towards, axis=1)
    angles = np.full(judge.camera.shape_hw, np.nan)
    angles[shown] = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    return angles


def _cells(sweep: str, values: Sequence[float], errors: Sequence[Sequence[float]], limit: Limit) -> list[Cell]:
    """The cells of all values but the first, whose errors are taken off."""
    excess = (np.array(errors) - np.array(errors)[:, :1]).T
    return [
        Cell.of(sweep, SERIES, x, [Outcome("works", e, e > WRONG_CODES) for e in row if not np.isnan(e)], limit=limit)
        for x, row in list(zip(values, excess, strict=True))[1:]
    ]
