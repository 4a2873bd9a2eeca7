"""Sweeps of the colouring on real photographs: a wrong pose, and grazing angles.

The surface gets its colours from one photograph and is judged by the next one. The two differ in light and exposure,
and their poses are not exact: an error is what comes on top of that of the same pair at the published pose, or of that
where the frame saw the surface from the front.
"""

import itertools
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from oneframe.colour.colour_doubts import MAX_STATED_ERROR_PX
from oneframe.colour.ray_tracer import best_traced
from oneframe.colour.source_view import MAX_INCIDENCE_DEG
from oneframe.evaluation.scores.view_scores import FEWEST_PIXELS, colour_gain, corrected
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.transforms import inverse_rigid, rigid, transform_points

from ..alignment.refinement_scenes import RefinementScene
from .cells import Cell, Limit, Outcome, Task
from .colouring import INCIDENCES_DEG, POSE_ERRORS_PX, WRONG_CODES, reference

SERIES = "photographs"


def measure_pose_error(pairs: Sequence[tuple[RefinementScene, RefinementScene]], seed: int) -> list[Cell]:
    """Colour error of poses that are off by a shift in the image, in random directions; nobody states it."""
    rng = np.random.default_rng([seed, 2])
    shifts_px = (0.0, *POSE_ERRORS_PX[4:])
    errors = []
    for frame, judge in pairs:
        angle = rng.uniform(0, 2 * np.pi)
        mm_per_px = frame.middle_cam[2] / frame.camera.fx * np.array([np.cos(angle), np.sin(angle), 0.0])
        found = (
            _errors(frame, rigid(translation=shift * mm_per_px) @ frame.cam_from_model, judge) for shift in shifts_px
        )
        errors.append([float(np.nanmean(each)) for each in found])
    return _cells("pose error", shifts_px, errors, Limit("MAX_STATED_ERROR_PX", MAX_STATED_ERROR_PX))


def measure_incidence(pairs: Sequence[tuple[RefinementScene, RefinementScene]]) -> list[Cell]:
    """Colour error of the surface that the frame saw at angles between two values; ``x`` is their middle."""
    bins = list(itertools.pairwise(INCIDENCES_DEG[:7]))
    errors = []
    for frame, judge in pairs:
        found, angles = _errors(frame, frame.cam_from_model, judge), _incidence_deg(frame, judge)
        parts = (found[~np.isnan(found) & (angles >= low) & (angles < high)] for low, high in bins)
        errors.append([float(part.mean()) if len(part) >= FEWEST_PIXELS else np.nan for part in parts])
    middles = [(low + high) / 2 for low, high in bins]
    return _cells("incidence", middles, errors, Limit("MAX_INCIDENCE_DEG", MAX_INCIDENCE_DEG))


def tasks(scenes: Sequence[RefinementScene], seed: int, *, quick: bool) -> Iterator[Task]:
    """All measurements, on each photograph and the next one; ``quick`` takes one pair."""
    pairs = list(itertools.pairwise([*scenes, scenes[0]]))[: 1 if quick else None]
    yield partial(measure_pose_error, pairs, seed)
    yield partial(measure_incidence, pairs)


def _errors(frame: RefinementScene, cam_from_model: np.ndarray, judge: RefinementScene) -> np.ndarray:
    """``(H, W)`` mean colour errors of 255 of the photograph at equal exposure; NaN where the frame saw nothing."""
    source = reference(frame.mesh, frame.image, frame.camera, cam_from_model)
    view = best_traced(source.mesh, frame.camera, source.views, rays=source.rays)(judge.cam_from_model)
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
    """Of all values but the first, whose errors are taken off."""
    excess = (np.array(errors) - np.array(errors)[:, :1]).T
    return [
        Cell.of(sweep, SERIES, x, [Outcome("works", e, e > WRONG_CODES) for e in row if not np.isnan(e)], limit=limit)
        for x, row in list(zip(values, excess, strict=True))[1:]
    ]
