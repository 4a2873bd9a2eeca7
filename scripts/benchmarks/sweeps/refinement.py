"""Sweeps of the refinement past the point where it fails: how far off it starts, and how bad the frame is.

A cell has one trial on each of a source's scenes: one rendered frame thrice, or real photographs. Needs ``cv2``.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import cv2
import numpy as np

from oneframe.alignment.refinement.refine import refine_pose
from oneframe.alignment.refinement.verdict import MAX_ROTATION_DEG
from oneframe.transforms import rotation_angle_deg, transform_points

from ..alignment.refinement_scenes import RefinementScene, displacement_px, disturbed_pose
from .cells import NO_LIMIT, Cell, Limit, Outcome, Task

TOPIC = "refinement"
RENDERED, TRIALS = "rendered", 3
"""The series of the built-in sample case, and trials of a setting."""
ANGLES_DEG, SHIFTS_PERCENT = (0.0, 5.0, 10.0, 15.0, 25.0), (0.0, 2.0, 5.0, 10.0)
START = 3.0, 4 / 3
"""Degrees and percent of the distance that the pose is off at the start of the trials with bad frames."""
STATED_RATIO = 2.0
"""Ratio of the true to the stated error up to which the software has said how far off the pose is."""
CONTRASTS = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.0)
OCCLUDED = (0.0, 0.05, 0.1, 0.2, 0.4, 0.6)
SPECULAR = (0.0, 0.05, 0.1, 0.2, 0.4, 0.7)
NOISES = (0.0, 0.05, 0.1, 0.2, 0.4, 0.8)
BLURS_PX = (0.0, 4.0, 8.0, 16.0, 32.0, 64.0)

Spoil = Callable[[np.ndarray, float, np.random.Generator], np.ndarray]
"""Makes a frame, ``(H, W, 3)`` float32 0..1, worse by an amount."""


def faded(image: np.ndarray, contrast: float, rng: np.random.Generator) -> np.ndarray:
    """The frame with its contrast reduced, in 8 bits, with the noise of a sensor (one code)."""
    return _coded(0.5 + contrast * (image - image.mean()) + rng.normal(0, 1 / 255, image.shape[:2])[..., None])


def occluded(image: np.ndarray, part: float, rng: np.random.Generator) -> np.ndarray:
    """The frame with grey instruments, strips from the border inwards, over this part of it."""
    height, width = image.shape[:2]
    covered = np.zeros((height, width), np.uint8)
    while covered.mean() < part:
        angle, thickness = rng.uniform(0, 2 * np.pi), int(rng.uniform(0.06, 0.14) * width)
        tip = rng.uniform([0.2, 0.2], [0.8, 0.8]) * [width, height]
        end = tip + 2 * width * np.array([np.cos(angle), np.sin(angle)])
        cv2.line(covered, tip.astype(int).tolist(), end.astype(int).tolist(), [1.0], thickness)
    metal = 0.55 + 0.25 * np.sin(np.arange(width) / 17.0)[None, :, None]
    return np.where(covered[..., None] > 0, metal, image).astype(np.float32)


def spoilt(scene: RefinementScene, spoil: Spoil, value: float, rng: np.random.Generator) -> np.ndarray:
    """The scene's image, made worse in the box of its surface; all of it where that fills nearly all."""
    pixels = scene.camera.project(transform_points(scene.cam_from_model, scene.points))
    (left, top), (right, bottom) = (
        np.clip(edge, 0, scene.camera.size_wh).astype(int) for edge in (pixels.min(axis=0), pixels.max(axis=0) + 2)
    )
    if (right - left) * (bottom - top) > 0.9 * scene.valid.size:
        return spoil(scene.image, value, rng)
    image = scene.image.copy()
    image[top:bottom, left:right] = spoil(image[top:bottom, left:right], value, rng)
    return image


def kept(image: np.ndarray, spoilt: np.ndarray) -> np.ndarray:
    """``(H, W)`` bool: pixels that are as they were."""
    return (image == spoilt).all(axis=2)


def specular(image: np.ndarray, part: float, rng: np.random.Generator) -> np.ndarray:
    """The frame with glare: white blots over this part of it, as of a wet surface."""
    height, width = image.shape[:2]
    field = cv2.GaussianBlur(rng.normal(size=(height, width)).astype(np.float32), (0, 0), width / 100)
    # glare is where the surface is bright, and where it happens to be wet
    field = field / field.std() + 0.5 * (image.mean(axis=2) - image.mean()) / image.std()
    return np.where((field > np.quantile(field, 1 - part))[..., None], np.float32(1), image) if part else image


def noisy(image: np.ndarray, sigma: float, rng: np.random.Generator) -> np.ndarray:
    """The frame with white noise of this standard deviation, code values 0..1."""
    return _coded(image + rng.normal(0, sigma, image.shape))


def blurred(image: np.ndarray, sigma_px: float, _rng: np.random.Generator) -> np.ndarray:
    """The frame out of focus."""
    return cv2.GaussianBlur(image, (0, 0), sigma_px) if sigma_px else image


def _coded(image: np.ndarray) -> np.ndarray:
    return (np.rint(np.clip(image, 0, 1) * 255) / 255).astype(np.float32)


FRAMES: dict[str, tuple[Spoil, tuple[float, ...]]] = {
    "texture-poor": (faded, CONTRASTS),
    "occluded": (occluded, OCCLUDED),
    "specular": (specular, SPECULAR),
    "noisy": (noisy, NOISES),
    "blurred": (blurred, BLURS_PX),
}
"""What makes a frame worse, and by which amounts."""
MASKED = ", masked"


class _Searched(Exception):
    """The refinement went on from the check of the contrast to its search."""


def least_contrast(scene: RefinementScene, seed: int) -> float:
    """The contrast, of the original's, at which the refinement begins to find detail: where its limit lies.

    By bisection, to a hundredth.
    """

    def stop(fraction: float) -> None:
        if fraction > 0:
            raise _Searched

    low, high = 1e-4, 1.0
    while high > 1.01 * low:
        middle = math.sqrt(low * high)
        image = faded(scene.image, middle, np.random.default_rng(seed))
        try:
            refine_pose(image, scene.valid, scene.camera, scene.mesh, scene.cam_from_model, progress=stop)
        except _Searched:
            high = middle
        else:
            low = middle
    return high


def outcome(scene: RefinementScene, start: np.ndarray) -> Outcome:
    """Refine a pose: the error is the displacement of the surface, px, the value its ratio to the stated error.

    An accepted pose counts as wrong if it is beyond the scene's limits, and further off than twice what was stated.
    """
    result = refine_pose(scene.image, scene.valid, scene.camera, scene.mesh, start)
    if not result.accepted:
        return Outcome("refuses", message=result.message)
    error_px = displacement_px(scene, result.cam_from_model)
    error_deg = rotation_angle_deg(result.cam_from_model[:3, :3] @ scene.cam_from_model[:3, :3].T)
    wrong = not error_px < scene.largest_px or (scene.largest_deg is not None and not error_deg < scene.largest_deg)
    ratio = error_px / result.after.error_px
    return Outcome("works", error_px, wrong and not ratio < STATED_RATIO, result.message, ratio)


def measure_basin(
    source: str, scenes: Sequence[RefinementScene], angle_deg: float, percent: float, key: int, seed: int
) -> list[Cell]:
    """A cell of the basin of convergence: ``x`` in degrees, ``y`` in percent of the distance."""
    rng = np.random.default_rng([seed, 0, key])
    outcomes = [outcome(scene, disturbed_pose(scene, angle_deg, percent, rng)) for scene in scenes]
    limit = Limit("MAX_ROTATION_DEG", MAX_ROTATION_DEG)
    return [Cell.of("basin", source, angle_deg, outcomes, y=percent, limit=limit)]


def measure_frame(
    series: str, scenes: Sequence[RefinementScene], name: str, value: float, key: tuple[int, int], seed: int
) -> list[Cell]:
    """A cell of one of :data:`FRAMES`, from :data:`START`; a series that :data:`MASKED` ends leaves out what is bad."""
    spoil, _ = FRAMES[name]
    limit = Limit("MIN_CONTRAST", least_contrast(scenes[0], seed)) if spoil is faded else NO_LIMIT
    rng = np.random.default_rng([seed, 1, *key])
    outcomes = []
    for scene in scenes:
        image = spoilt(scene, spoil, value, rng)
        valid = scene.valid & kept(scene.image, image) if series.endswith(MASKED) else scene.valid
        outcomes.append(outcome(replace(scene, image=image, valid=valid), disturbed_pose(scene, *START, rng)))
    return [Cell.of(name, series, value, outcomes, limit=limit)]


def tasks(scene: RefinementScene, seed: int, *, quick: bool) -> Iterator[Task]:
    """All measurements of the topic; ``quick`` takes four cells of the basin and one bad frame of a kind, once."""
    angles, shifts = (values[:4:3] if quick else values for values in (ANGLES_DEG, SHIFTS_PERCENT))
    scenes = [scene] * (1 if quick else TRIALS)
    for key, (percent, angle_deg) in enumerate(itertools.product(SHIFTS_PERCENT, ANGLES_DEG)):
        if angle_deg in angles and percent in shifts:
            yield partial(measure_basin, RENDERED, scenes, angle_deg, percent, key, seed)
    for number, (name, (_, values)) in enumerate(FRAMES.items()):
        for index, value in enumerate(values):
            if index == len(values) // 2 or not quick:
                yield partial(measure_frame, RENDERED, scenes, name, value, (number, index), seed)
                if name == "occluded" and value > 0:
                    yield partial(measure_frame, RENDERED + MASKED, scenes, name, value, (number, index), seed)
