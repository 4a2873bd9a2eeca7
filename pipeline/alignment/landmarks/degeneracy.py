"""When pairs cannot determine a pose: the reasons, as sentences for the person who picks them."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from ...errors import InputError
from ...files.numbers import format_two_digits
from .covariance import PoseUncertainty
from .hypotheses import Hypothesis
from .reprojection import Correspondences

Kind = Literal[
    "few",
    "identical",
    "collinear",
    "coplanar",
    "clustered",
    "ambiguous",
    "contradictory",
    "mirrored",
    "behind",
    "no fit",
]

LARGEST_TURN_DEG, LARGEST_DEPTH = 5.0, 0.1
"""Standard deviations beyond which no pose is given: of any rotation, and of the depth relative to itself."""


MISFIT = 8.0
"""Residuals of more than so many times the stated noise: no pose fits."""

MIRROR_CERTAIN, MIRROR_FITS = 1e6, 3.0
"""If the mirror image of the points explains the pairs so many times better, and to so many times the stated noise, the
mesh is taken to be mirrored."""

LEAST_AGREEING = 0.6
"""Part of the pairs that must agree on a pose."""

THICK_SIGMAS = 10.0
"""Points whose spread across a line or a plane is less than so much click noise do not get off it."""


class UndeterminedPose(InputError):
    """The enabled pairs do not determine a pose; the message says why and what to do.

    Attributes
    ----------
    kind
        The reason in a word or two.
    candidates
        Poses ``(4, 4)`` cam_from_model that were considered, the most probable first; possibly none.
    """

    def __init__(self, kind: Kind, message: str, candidates: Sequence[np.ndarray] = ()) -> None:
        super().__init__(message)
        self.kind = kind
        self.candidates = tuple(candidates)


def check_correspondences(points_model: np.ndarray, pixels: np.ndarray, names: Sequence[str]) -> None:
    """Refuse pairs that no solver can use.

    Raises
    ------
    UndeterminedPose
        Fewer than 4 pairs, fewer than 4 different points or 3 different pixels, all points on a line.
    """
    count = len(points_model)
    if count < 4:
        raise UndeterminedPose(
            "few", f"landmarks: expected at least 4 enabled pairs, found {count}; add {4 - count} more, 6 are better"
        )
    extent = float(np.ptp(points_model, axis=0).max())
    same_point = _groups(points_model, 1e-6 * extent)
    different = len(set(same_point))
    if different < 4 or len(set(_groups(pixels, 1e-3))) < 3:
        repeated = next(
            f"{names[first]!r} and {names[second]!r} have the same "
            for group in (same_point, _groups(pixels, 1e-3))
            for second, first in enumerate(group)
            if first != second
        )
        which = "surface point" if different < 4 else "pixel"
        raise UndeterminedPose(
            "identical",
            f"landmarks: expected at least 4 different pairs, found {min(different, count)}: {repeated}{which}; "
            "pick other features for the repeated ones",
        )
    spread = np.linalg.svd(points_model - points_model.mean(axis=0), compute_uv=False)
    if spread[1] < 1e-4 * spread[0]:
        raise UndeterminedPose("collinear", _collinear(count))


def repeated_correspondences(points_model: np.ndarray, pixels: np.ndarray) -> list[tuple[int, int]]:
    """Places of pairs that have point and pixel in common: the first, and each further one."""
    both = np.hstack([points_model, pixels])
    return [(first, index) for index, first in enumerate(_groups(both, 0.0)) if first != index]


def _groups(values: np.ndarray, tolerance: float) -> list[int]:
    """For each row the first row that is the same."""
    return [int(np.argmax(np.abs(values - row).max(axis=1) <= tolerance)) for row in values]


def _collinear(count: int) -> str:
    return (
        f"landmarks: expected points that span an area, found all {count} on one line, about which the surface could "
        "turn freely; add pairs well beside this line"
    )


def check_fit(
    pairs: Correspondences, found: list[Hypothesis], mirrored: Hypothesis | None, click_sigma_px: float
) -> None:
    """Refuse pairs that no pose explains.

    Parameters
    ----------
    found
        What explains them, the most probable first.
    mirrored
        What explains the mirror image of the points, if that is much better.

    Raises
    ------
    UndeterminedPose
        The mirror image fits so much better that the mesh must be mirrored, no pose puts the points in front of the
        camera, residuals beyond :data:`MISFIT`, too few pairs that agree.
    """
    count = len(pairs)
    candidates = [each.pose.matrix(0, pairs.pivot_model) for each in found]
    if mirrored is not None and mirrored.noise_px <= MIRROR_FITS * click_sigma_px:
        gain = mirrored.log_evidence - found[0].log_evidence if found else np.inf
        if gain > np.log(MIRROR_CERTAIN):
            raise UndeterminedPose(
                "mirrored",
                f"landmarks: no pose fits these {count} pairs as well as their mirror image does, to "
                f"{format_two_digits(mirrored.noise_px)} px: the mesh is mirrored, or the points are; "
                "mirror it in one of its axes",
                candidates,
            )
    if found:
        agreeing = int(found[0].inliers.sum())
        few, far = agreeing < LEAST_AGREEING * count, found[0].noise_px > MISFIT * click_sigma_px
        if not few and not far:
            return
        best = f"only {agreeing} agree on one" if few else f"the best leaves residuals like {found[0].noise_px:.0f} px"
    else:
        best = "every pose that they suggest has points behind the camera"
    raise UndeterminedPose(
        "no fit" if found else "behind",
        f"landmarks: no pose fits these {count} pairs, {best}; check that every pixel shows its point, that K belongs "
        "to this frame, and that the mesh is this one and not mirrored",
        candidates,
    )


def ambiguity(
    pairs: Correspondences, possible: list[Hypothesis], turn_deg: float, names: Sequence[str], click_sigma_px: float
) -> UndeterminedPose:
    """The refusal of pairs that fit several poses nearly equally, the most probable first."""
    candidates = [each.pose.matrix(0, pairs.pivot_model) for each in possible]
    best, second = possible[0], possible[1]
    fits = f"landmarks: the pairs fit {len(possible)} poses, up to {format_two_digits(turn_deg)}° apart, nearly equally"
    if not np.array_equal(best.inliers, second.inliers):
        doubtful = [repr(names[index]) for index in np.flatnonzero(best.inliers != second.inliers).tolist()]
        advice = f"they differ on {', '.join(doubtful)}, at least one of which is wrong; check these, or add pairs"
        return UndeterminedPose("contradictory", f"{fits}: {advice}", candidates)
    distance = float(np.linalg.norm(best.pose.positions[0]))
    if _spread_px(pairs, distance)[2] < THICK_SIGMAS * click_sigma_px:
        advice = "their points lie nearly on one plane, which may tilt either way; add a pair well above or below it"
        return UndeterminedPose("coplanar", f"{fits}: {advice}", candidates)
    advice = "add a pair, best where the surface rises or falls most" if len(pairs) < 6 else "check the pairs"
    return UndeterminedPose("ambiguous", f"{fits}: {advice}", candidates)


def check_uncertainty(
    pairs: Correspondences, cam_from_model: np.ndarray, uncertainty: PoseUncertainty, click_sigma_px: float
) -> None:
    """Refuse a pose that could as well be quite another.

    Raises
    ------
    UndeterminedPose
        A standard deviation beyond :data:`LARGEST_TURN_DEG` or :data:`LARGEST_DEPTH`; told by its cause: points on
        nearly a line, a small part of the image, points on nearly a plane.
    """
    turn_deg, depth = uncertainty.largest_rotation_deg, uncertainty.relative_depth
    if turn_deg <= LARGEST_TURN_DEG and depth <= LARGEST_DEPTH:
        return
    count = len(pairs)
    found = (
        f"± {format_two_digits(turn_deg)}° of rotation"
        if turn_deg > LARGEST_TURN_DEG
        else f"± {format_two_digits(100 * depth)} % of distance"
    )
    kind, cause = _cause(pairs, float(np.linalg.norm(uncertainty.pivot_cam)), click_sigma_px)
    raise UndeterminedPose(
        kind, f"landmarks: {count} pairs leave the pose undetermined ({found}): {cause}", [cam_from_model]
    )


def _cause(pairs: Correspondences, distance: float, click_sigma_px: float) -> tuple[Kind, str]:
    width, height = np.ptp(pairs.pixels, axis=0)
    spread_px = _spread_px(pairs, distance)
    if max(width, height) < 25 * click_sigma_px:
        return "clustered", (
            f"they span {width:.0f} x {height:.0f} px, too little against clicks that are {click_sigma_px:g} px "
            "uncertain; add pairs towards all sides of the image"
        )
    if spread_px[1] < THICK_SIGMAS * click_sigma_px:
        return "collinear", "their points lie nearly on one line; add pairs well beside this line"
    if spread_px[2] < THICK_SIGMAS * click_sigma_px:
        return "coplanar", "their points lie nearly on one plane; add pairs well above or below it"
    return "ambiguous", "they contradict each other or lie badly; check them, and add pairs towards all sides"


def _spread_px(pairs: Correspondences, distance: float) -> np.ndarray:
    """``(3,)`` standard deviations of the points along their main axes, as large as they look at their distance."""
    px_per_mm = np.sqrt(pairs.camera.fx * pairs.camera.fy) / distance
    values = np.linalg.svd(pairs.offsets - pairs.offsets.mean(axis=0), compute_uv=False)
    return px_per_mm * values / np.sqrt(len(pairs))
