"""The refinement's basin of convergence, and how often it accepts a wrong pose. Needs ``cv2``.

The initial pose is the true one, rotated about the middle of the visible surface and translated by a percentage of its
distance, both in random directions, on a grid of sizes. Wrong images are the scene's own, mirrored, upside down and
rotated by 90 degrees: the refinement must refuse all of them.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from oneframe.alignment.refinement.refine import refine_pose
from oneframe.transforms import rigid, rotation_angle_deg, rotation_from_vector, transform_points, turned_about

from .refinement_scenes import RefinementScene

WRONG_IMAGES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "mirrored": lambda image: image[:, ::-1],
    "upside down": lambda image: image[::-1],
    "quarter turn": lambda image: cv2.resize(np.rot90(image), image.shape[1::-1]),
}
RIGHT_IMAGE = "right"
WRONG_START = 2.0, 2.0
"""Size of the disturbance for wrong images: degrees, and percent of the distance."""


@dataclass(frozen=True)
class Disturbance:
    """The start of a trial: the scene's image or a wrong one, and the error of the initial pose.

    Attributes
    ----------
    image
        :data:`RIGHT_IMAGE`, or a key of :data:`WRONG_IMAGES`.
    angle_deg, percent
        Angle of the rotation; length of the translation in percent of the distance to the surface.
    """

    image: str
    angle_deg: float
    percent: float


@dataclass(frozen=True)
class RefinementTrial:
    """One refinement: a row of the table.

    Attributes
    ----------
    scene, image, angle_deg, percent
        The scene's name and the :class:`Disturbance`.
    start_px, error_deg, error_px
        Mean displacement of the visible surface at the initial pose; rotation error and mean displacement after the
        refinement, accepted or not.
    right
        Whether the refined pose is within the scene's limits and the image is not a wrong one.
    accepted, message
        The refinement's own verdict and its reason.
    estimated_px_after
        The refinement's own estimate of ``error_px``; NaN where it gives none.
    seconds
        Processor time.
    """

    scene: str
    image: str
    angle_deg: float
    percent: float
    start_px: float
    error_deg: float
    error_px: float
    right: bool
    accepted: bool
    estimated_px_after: float
    seconds: float
    message: str


# --- trials ----------------------------------------------------------------------------------------------------------


def disturbances(
    angles_deg: Sequence[float], percents: Sequence[float], trials: int, wrong: int
) -> tuple[Disturbance, ...]:
    """The grid of angles and percentages ``trials`` times, then each of :data:`WRONG_IMAGES` ``wrong`` times."""
    grid = [Disturbance(RIGHT_IMAGE, angle, percent) for angle in angles_deg for percent in percents]
    return tuple(grid * trials + [Disturbance(name, *WRONG_START) for name in WRONG_IMAGES] * wrong)


def disturbed_pose(scene: RefinementScene, angle_deg: float, percent: float, rng: np.random.Generator) -> np.ndarray:
    """``(4, 4)`` true pose, rotated about the middle of the visible surface and shifted by a part of its distance.

    Both in random directions.
    """
    shift_mm = percent / 100 * np.linalg.norm(scene.middle_cam)
    axis, direction = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    turned = turned_about(scene.middle_cam, rotation_from_vector(np.radians(angle_deg) * axis))
    return rigid(translation=shift_mm * direction) @ turned @ scene.cam_from_model


def run_trials(
    scenes: Sequence[RefinementScene], planned: Sequence[Disturbance], seed: int
) -> Iterator[RefinementTrial]:
    """Refine from each disturbance, cycling through the scenes; trial ``i`` depends on the seed and ``i`` alone."""
    for index, disturbance in enumerate(planned):
        yield run_trial(scenes[index % len(scenes)], disturbance, np.random.default_rng([seed, index]))


def run_trial(scene: RefinementScene, disturbance: Disturbance, rng: np.random.Generator) -> RefinementTrial:
    """Refine one disturbed pose and compare the result with the truth."""
    start = disturbed_pose(scene, disturbance.angle_deg, disturbance.percent, rng)
    wrong = WRONG_IMAGES.get(disturbance.image)
    image = np.ascontiguousarray(wrong(scene.image)) if wrong else scene.image
    began = time.process_time()
    result = refine_pose(image, scene.valid, scene.camera, scene.mesh, start, colours=scene.colours)
    seconds = time.process_time() - began
    error_deg = rotation_angle_deg(result.found[:3, :3] @ scene.cam_from_model[:3, :3].T)
    error_px = displacement_px(scene, result.found)
    close = error_px < scene.largest_px and (scene.largest_deg is None or error_deg < scene.largest_deg)
    return RefinementTrial(
        scene=scene.name,
        image=disturbance.image,
        angle_deg=disturbance.angle_deg,
        percent=disturbance.percent,
        start_px=displacement_px(scene, start),
        error_deg=error_deg,
        error_px=error_px,
        right=close and wrong is None,
        accepted=result.accepted,
        estimated_px_after=result.after.error_px,
        seconds=seconds,
        message=" ".join(result.message.split()),
    )


def displacement_px(scene: RefinementScene, cam_from_model: np.ndarray) -> float:
    """Mean distance in the image between the visible points at a pose and at the true pose, px."""
    found, true = (
        scene.camera.project(transform_points(pose, scene.points)) for pose in (cam_from_model, scene.cam_from_model)
    )
    return float(np.linalg.norm(found - true, axis=1).mean())


# --- results ---------------------------------------------------------------------------------------------------------


def tally(trials: Sequence[RefinementTrial]) -> list[str]:
    """How many trials are right; accepted though wrong; and of wrong images accepted, if there are any."""
    grid, wrong = ([trial for trial in trials if (trial.image == RIGHT_IMAGE) is right] for right in (True, False))
    accepted = [trial for trial in grid if trial.accepted]
    said = [
        f"right {sum(trial.right for trial in grid)} of {len(grid)}, of these refused "
        f"{sum(trial.right and not trial.accepted for trial in grid)}",
        f"accepted though wrong: {sum(not trial.right for trial in accepted)} of {len(accepted)} accepted",
    ]
    if wrong:
        said.append(f"accepted on wrong images: {sum(trial.accepted for trial in wrong)} of {len(wrong)}")
    return said


def summary(trials: Sequence[RefinementTrial]) -> list[str]:
    """Lines on success, false verdicts, errors, what the refinement says of these, and time."""
    lines = tally(trials)
    accepted = [trial for trial in trials if trial.accepted and trial.image == RIGHT_IMAGE]
    if accepted:
        figures = [(trial.error_px, trial.error_deg, trial.estimated_px_after) for trial in accepted]
        px, deg, estimated = np.array(figures).T
        (middle_px, most_px), (middle_deg, most_deg) = (np.quantile(each, [0.5, 0.95]) for each in (px, deg))
        lines.append(
            f"error where accepted, median / 95 %: {middle_px:.2f} / {most_px:.2f} px, "
            f"{middle_deg:.2f} / {most_deg:.2f}°"
        )
        ratios = np.quantile(estimated / np.maximum(px, 0.01), [0.05, 0.5, 0.95])
        lines.append("estimated / true error, 5 / 50 / 95 %: " + " / ".join(f"{ratio:.2f}" for ratio in ratios))
        farther = sum(trial.error_px > trial.start_px for trial in accepted)
        lines.append(f"accepted though farther off than before: {farther} of {len(accepted)} accepted")
    seconds = [trial.seconds for trial in trials]
    lines.append(f"processor time, median / largest: {np.median(seconds):.1f} / {max(seconds):.1f} s")
    return lines
