"""Poses of photographs by a trained network beside the true ones, and refined from there by render and flow."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from oneframe.case.frame import PosedFrame, load_posed_frame
from oneframe.case.loaded_case import LoadedCase
from oneframe.colour.reference_view import reference_view
from oneframe.registration.flow_refinement import refined_by_flow
from oneframe.registration.further_frames import small_frame
from oneframe.registration.known_views import KnownViews, grey_codes
from oneframe.registration.pose_list import read_photographs
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import camera_centre

from ..alignment.refinement_scenes import visible_points
from ..alignment.registration_trials import pose_errors

FARTHEST_DEG = 60
"""Between the directions from which frame and photograph look; farther ones show too little that the frame saw."""
RESAMPLES = 2000
"""Bootstrap samples of seeds and photographs."""


class Training(NamedTuple):
    """What a network was trained on, and for how long."""

    scene: str
    dataset: str
    views: int
    steps: int
    seed: int


@dataclass(frozen=True)
class PoseTrial:
    """A photograph's errors by one training, see :func:`errors`.

    ``seconds`` is the processor time of the training.
    """

    scene: str
    dataset: str
    views: int
    steps: int
    seed: int
    seconds: float
    photograph: str
    angle_deg: float
    percent: float
    px: float

    @property
    def training(self) -> Training:
        """The training that made the network."""
        return Training(self.scene, self.dataset, self.views, self.steps, self.seed)


def errors(pose: np.ndarray | None, photograph: PosedFrame, mesh: TriangleMesh) -> tuple[float, float, float]:
    """How far a pose is from a photograph's, see :func:`.pose_errors`: infinite if there is none."""
    if pose is None:
        return np.inf, np.inf, np.inf
    return pose_errors(pose, photograph.cam_from_model, mesh, photograph.camera)


def photographs_of(loaded: LoadedCase, listed: Path) -> list[PosedFrame]:
    """The photographs of a list that are near enough; errors as :func:`.read_photographs`."""
    own = loaded.frame
    middle = visible_points(loaded.surface.mesh, own.camera, own.cam_from_model).mean(axis=0)

    def direction(frame: PosedFrame) -> np.ndarray:
        ray = camera_centre(frame.cam_from_model) - middle
        return ray / np.linalg.norm(ray)

    unread = read_photographs(listed, loaded.case)[0]
    frames = [small_frame(load_posed_frame(each, loaded.surface.mesh_from_model, name=listed.name)) for each in unread]
    return [frame for frame in frames if direction(frame) @ direction(own) > np.cos(np.radians(FARTHEST_DEG))]


def known_views(loaded: LoadedCase) -> KnownViews:
    """What the case's frame shows, for the refinement."""
    view = reference_view(replace(loaded, frames=(small_frame(loaded.frame),)))
    return KnownViews(view.mesh, view.view)


def refined(views: KnownViews, photograph: PosedFrame, pose: np.ndarray | None) -> np.ndarray | None:
    """The pose refined by render and flow."""
    fit = None if pose is None else refined_by_flow(views, grey_codes(photograph.image), photograph.valid, pose)
    return None if fit is None else fit.cam_from_model


def summary(trials: Sequence[PoseTrial]) -> str:
    """A line with the medians of one training."""
    names = "angle_deg", "percent", "px"
    medians = [float(np.median([getattr(trial, name) for trial in trials])) for name in names]
    return (
        "{}, {}, {} views, {} steps, seed {}: ".format(*trials[0].training)
        + "{:.2f}°, {:.2f} %, {:.2f} px".format(*medians)
        + f" (medians of {len(trials)} photographs; {trials[0].seconds:.0f} s)"
    )


def median_errors(
    trials: Sequence[PoseTrial], training: Training, score: str, beside: Training | None = None
) -> tuple[float, float, float]:
    """Median over the photographs and all seeds of a training, and the ends of its 95 % bootstrap interval.

    With another training ``beside`` it, of the same photographs: how many times the median of that one.
    """
    rng = np.random.default_rng(0)

    def medians(training: Training) -> np.ndarray:
        own = [trial for trial in trials if trial.training._replace(seed=0) == training._replace(seed=0)]
        errors = np.array([getattr(trial, score) for trial in own]).reshape(len({trial.seed for trial in own}), -1)
        seeds = rng.integers(len(errors), size=(RESAMPLES, len(errors), 1))
        # the same photographs for both
        photographs = np.random.default_rng(0).integers(errors.shape[1], size=(RESAMPLES, 1, errors.shape[1]))
        return np.append(np.median(errors), np.median(errors[seeds, photographs], axis=(1, 2)))

    found = medians(training) / (1.0 if beside is None else medians(beside))
    low, high = np.quantile(found[1:], [0.025, 0.975], method="nearest")
    return float(found[0]), float(low), float(high)
