"""The posterior from landmarks and image: coverage of the truth, and clicks at the marked places."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from oneframe.alignment.landmarks.degeneracy import UndeterminedPose
from oneframe.alignment.pose_uncertainty import PoseEvidence, PoseMode, PoseUncertainty
from oneframe.alignment.posterior.next_click import next_click, rough_mode
from oneframe.alignment.posterior.solve import pose_posterior
from oneframe.alignment.refinement.verification import QUARTERS_DOF
from oneframe.alignment.reprojection import apply_twist
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.landmarks import Landmark
from oneframe.transforms import transform_points

from .landmark_accuracy import ASSUMED_SIGMA_PX, COUNTS, DrawTrial, VisibleSurface
from .landmark_trials import LandmarkTrial

IMAGE_DEG, IMAGE_RELATIVE_DEPTH = 0.3, 0.003
"""Standard deviations of an image's pose: of rotations, of shifts by as much of 10 mm, and of the distance."""
WANTED_PX, MOST_CLICKS = 1.0, 40
APART = 0.02
"""Least distance between two clicks, in widths of the frame: another feature."""


def coverages(draw: DrawTrial, camera: PinholeCamera, trials: int, noise_px: Sequence[float]) -> Iterator[str]:
    """How often the 95 % region of any mode holds the truth, for landmarks alone and with the image, in words.

    Refused trials have no pose.
    """
    for sigma_px in noise_px:
        for count in COUNTS:
            for with_image in (False, True):
                rng, inside, refused = np.random.default_rng([count, int(10 * sigma_px), with_image]), [], 0
                for _ in range(trials):
                    trial = draw(rng, count, sigma_px)
                    image = _image(rng, trial.cam_from_model) if with_image else None
                    modes = _modes(trial, camera, image)
                    refused += not modes
                    if modes:
                        inside.append(_holds(modes, trial.cam_from_model))
                name = "landmarks and image" if with_image else "landmarks"
                share = np.mean(inside) if inside else np.nan
                yield f"  {name}, {count} pairs, {sigma_px:g} px: {share:.1%} of {trials} ({refused} refused)"


def clicks_needed(surface: VisibleSurface, trials: int, report: Callable[[str], None]) -> dict[str, int]:
    """Number of clicks until the surface is within :data:`WANTED_PX` in the median, at the marked or random places."""
    needed = {}
    for name in ("random", "marked"):
        errors = np.full((trials, MOST_CLICKS + 1), np.inf)
        for number in range(trials):
            _click_on(np.random.default_rng([5, number]), surface, errors[number], is_marked=name == "marked")
        medians = np.median(errors, axis=0)
        reached = np.flatnonzero(medians <= WANTED_PX)
        needed[name] = int(reached[0]) if len(reached) else MOST_CLICKS + 1
        texts = ", ".join(f"{count}: {medians[count]:.2f}" for count in range(4, MOST_CLICKS + 1, 2))
        report(f"  clicks at {name} places, median px after {texts}; {needed[name]} clicks to {WANTED_PX:g} px")
    return needed


def _click_on(rng: np.random.Generator, surface: VisibleSurface, errors: np.ndarray, *, is_marked: bool) -> None:
    camera, true = surface.camera, surface.cam_from_model
    points = surface.points[rng.choice(len(surface.points), min(1000, len(surface.points)), replace=False)]
    seen = camera.project(transform_points(true, points))
    pivot = points.mean(axis=0)
    rough = apply_twist(_deviations(3.0, 0.02, true, pivot) * rng.normal(size=6), true, pivot)
    landmarks: list[Landmark] = []
    free = np.ones(len(points), bool)
    modes: Sequence[PoseMode] = ()
    for count in range(1, MOST_CLICKS + 1):
        places = np.flatnonzero(free)
        if not len(places):
            return
        chosen = int(rng.choice(places))
        if is_marked:
            known = modes or [rough_mode(rough, landmarks, points, camera, ASSUMED_SIGMA_PX)]
            chosen = int(places[next_click(points[places], camera, known, ASSUMED_SIGMA_PX)])
        free &= np.linalg.norm(seen - seen[chosen], axis=1) > APART * camera.width
        pixel = seen[chosen] + rng.normal(scale=ASSUMED_SIGMA_PX, size=2)
        landmarks.append(Landmark(str(count), tuple(points[chosen].tolist()), tuple(pixel.tolist())))
        try:
            found = pose_posterior(landmarks, camera, click_sigma_px=ASSUMED_SIGMA_PX).estimate
            modes = [PoseMode(found.cam_from_model, found.uncertainty, 1.0, found.inliers)]
        except UndeterminedPose as refusal:
            modes = refusal.modes
        if modes:
            shown = camera.project(transform_points(modes[0].cam_from_model, points))
            errors[count] = np.linalg.norm(shown - seen, axis=1).mean()


def _modes(trial: LandmarkTrial, camera: PinholeCamera, image: PoseEvidence | None) -> Sequence[PoseMode]:
    pairs = zip(trial.points_model.tolist(), trial.pixels.tolist(), strict=True)
    landmarks = [Landmark(str(number), tuple(point), tuple(pixel)) for number, (point, pixel) in enumerate(pairs)]
    try:
        found = pose_posterior(landmarks, camera, image, click_sigma_px=ASSUMED_SIGMA_PX).estimate
    except UndeterminedPose as refusal:
        return refusal.modes
    return [PoseMode(found.cam_from_model, found.uncertainty, 1.0, found.inliers)]


def _holds(modes: Sequence[PoseMode], true: np.ndarray) -> bool:
    return any(mode.uncertainty.contains(true, mode.cam_from_model) for mode in modes)


def _image(rng: np.random.Generator, true: np.ndarray) -> PoseEvidence:
    """An image's pose; the scale of its covariance is estimated, with the degrees of freedom of a refinement."""
    deviations, pivot = _deviations(IMAGE_DEG, IMAGE_RELATIVE_DEPTH, true, np.zeros(3)), np.zeros(3)
    pose = apply_twist(deviations * rng.normal(size=6), true, pivot)
    scale = rng.chisquare(QUARTERS_DOF) / QUARTERS_DOF
    stated = PoseUncertainty(
        pivot, scale * np.diag(deviations**2), QUARTERS_DOF, np.nan, 10.0, transform_points(pose, pivot)
    )
    return PoseEvidence(pose, stated)


def _deviations(angle_deg: float, relative_depth: float, pose: np.ndarray, pivot: np.ndarray) -> np.ndarray:
    angle, distance = np.radians(angle_deg), float(np.linalg.norm(transform_points(pose, pivot)))
    return np.array([10 * angle, 10 * angle, relative_depth * distance, angle, angle, angle])
