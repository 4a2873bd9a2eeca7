"""When correspondences cannot determine a pose: the reasons, as messages for the user who picks them."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from ...errors import InputError
from ...files.numbers import format_two_digits
from ...transforms import rotation_angle_deg
from ..pose_uncertainty import PoseMode
from ..reprojection import Correspondences
from .hypotheses import Hypothesis

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

FEWEST_CORRESPONDENCES = 4
"""Three leave up to four poses (Grunert 1841, see Haralick et al. 1994)."""

COLLINEAR_RATIO = 1e-4
"""Extent of the points across a line, relative to that along it, below which they count as exactly on it."""

MAX_ROTATION_DEG, MAX_RELATIVE_DEPTH = 5.0, 0.1
"""Standard deviations beyond which a pose is refused: of any rotation, and of the depth relative to the depth."""

MAX_NOISE_RATIO = 8.0
"""Noise estimate over stated noise beyond which no pose fits."""

MIRROR_MIN_ODDS, MIRROR_MAX_NOISE_RATIO = 1e6, 3.0
"""The mesh counts as mirrored if the mirror image of the points is more probable by the first factor, and if its noise
estimate is at most the second times the stated noise."""

MIN_INLIER_FRACTION = 0.6
"""Fraction of the correspondences that must be inliers."""

MIN_SPREAD_SIGMAS = 10.0
"""Points that spread less than this across a line or a plane, in units of the click noise, count as lying on it."""


class UndeterminedPose(InputError):
    """The enabled correspondences do not determine a pose; the message says why and what to do.

    Attributes
    ----------
    kind
        The reason.
    candidates
        ``(4, 4)`` cam_from_model of the poses considered, the most probable first; possibly empty.
    modes
        The candidates with their uncertainties, where some fit; otherwise empty.
    """

    def __init__(
        self, kind: Kind, message: str, candidates: Sequence[np.ndarray] = (), modes: Sequence[PoseMode] = ()
    ) -> None:
        super().__init__(message)
        self.kind = kind
        self.candidates = tuple(candidates)
        self.modes = tuple(modes)

    @property
    def probabilities(self) -> tuple[float, ...]:
        """The probabilities of the candidates, where several fit; otherwise empty."""
        return tuple(mode.probability for mode in self.modes) if len(self.modes) > 1 else ()


def check_correspondences(points_model: np.ndarray, pixels: np.ndarray, names: Sequence[str]) -> None:
    """Refuse correspondences that no solver can use.

    ``(N, 3)`` mm and ``(N, 2)`` px are finite; ``names`` is what messages call them.

    Raises
    ------
    UndeterminedPose
        Fewer than 4 correspondences, fewer than 4 distinct points or 3 distinct pixels, all points on one line.
    """
    count = len(points_model)
    if count < FEWEST_CORRESPONDENCES:
        raise UndeterminedPose(
            "few",
            f"landmarks: expected at least {FEWEST_CORRESPONDENCES} enabled correspondences, found {count}; "
            f"add {FEWEST_CORRESPONDENCES - count} more, 6 are better",
        )
    extent = float(np.ptp(points_model, axis=0).max())
    same_point = _first_equal_rows(points_model, 1e-6 * extent)
    distinct = len(set(same_point))
    if distinct < FEWEST_CORRESPONDENCES or len(set(_first_equal_rows(pixels, 1e-3))) < 3:
        repeated = next(
            f"{names[first]!r} and {names[second]!r} have the same "
            for group in (same_point, _first_equal_rows(pixels, 1e-3))
            for second, first in enumerate(group)
            if first != second
        )
        which = "surface point" if distinct < FEWEST_CORRESPONDENCES else "pixel"
        raise UndeterminedPose(
            "identical",
            f"landmarks: expected at least 4 distinct correspondences, found {min(distinct, count)}: "
            f"{repeated}{which}; pick other features for the repeated ones",
        )
    spread = np.linalg.svd(points_model - points_model.mean(axis=0), compute_uv=False)
    if spread[1] < COLLINEAR_RATIO * spread[0]:
        raise UndeterminedPose("collinear", _collinear_message(count))


def repeated_correspondences(points_model: np.ndarray, pixels: np.ndarray) -> list[tuple[int, int]]:
    """Indices (first, repeated) of correspondences that share both point and pixel."""
    both = np.hstack([points_model, pixels])
    return [(first, index) for index, first in enumerate(_first_equal_rows(both, 0.0)) if first != index]


def _first_equal_rows(values: np.ndarray, tolerance: float) -> list[int]:
    """For each row of ``(N, D)`` the index of the first row equal to it within a tolerance."""
    return [int(np.argmax(np.abs(values - row).max(axis=1) <= tolerance)) for row in values]


def _collinear_message(count: int) -> str:
    return (
        f"landmarks: expected points that span an area, found all {count} on one line, about which the surface can "
        "rotate freely; add pairs well away from this line"
    )


def check_fit(
    correspondences: Correspondences, found: list[Hypothesis], mirrored: Hypothesis | None, click_sigma_px: float
) -> None:
    """Refuse correspondences that no pose explains.

    Parameters
    ----------
    found
        Hypotheses, the most probable first.
    mirrored
        The best hypothesis for the mirror image of the points, if it is much more probable than ``found[0]``.
    click_sigma_px
        Stated click noise.

    Raises
    ------
    UndeterminedPose
        The mesh is mirrored, no pose has the points in front of the camera, the residuals exceed
        :data:`MAX_NOISE_RATIO`, or there are too few inliers.
    """
    count = len(correspondences)
    candidates = [each.pose.matrix(0, correspondences.pivot_model) for each in found]
    if mirrored is not None and mirrored.noise_px <= MIRROR_MAX_NOISE_RATIO * click_sigma_px:
        gain = mirrored.log_evidence - found[0].log_evidence if found else np.inf
        if gain > np.log(MIRROR_MIN_ODDS):
            raise UndeterminedPose(
                "mirrored",
                f"landmarks: no pose fits these {count} correspondences as well as one fits their mirror image, to "
                f"{format_two_digits(mirrored.noise_px)} px: the pixels are mirrored (u and v exchanged, "
                "or v counted from below), or the mesh is: correct the pixels, or take a mesh that is not mirrored",
                candidates,
            )
    if found:
        inliers = int(found[0].inliers.sum())
        too_few, too_noisy = inliers < MIN_INLIER_FRACTION * count, found[0].noise_px > MAX_NOISE_RATIO * click_sigma_px
        if not too_few and not too_noisy:
            return
        best = f"only {inliers} agree on one" if too_few else f"the best leaves residuals of {found[0].noise_px:.0f} px"
    else:
        best = "every candidate has points behind the camera"
    raise UndeterminedPose(
        "no fit" if found else "behind",
        f"landmarks: no pose fits these {count} correspondences, {best}; check that every pixel shows its point, "
        "that K belongs to this frame, and that the mesh is the right one and not mirrored",
        candidates,
    )


def ambiguous_pose(
    correspondences: Correspondences,
    possible: list[Hypothesis],
    modes: Sequence[PoseMode],
    names: Sequence[str],
    click_sigma_px: float,
) -> UndeterminedPose:
    """The error for correspondences that fit several poses nearly equally well.

    ``possible`` are at least two hypotheses, the most probable first, ``modes`` the same with their uncertainties.
    """
    candidates = [mode.cam_from_model for mode in modes]
    rotation_deg = max(rotation_angle_deg(pose[:3, :3] @ candidates[0][:3, :3].T) for pose in candidates)
    best, second = possible[0], possible[1]
    differ = f"which differ by up to {format_two_digits(rotation_deg)}°"
    fits = f"landmarks: the correspondences fit {len(possible)} poses nearly equally well, {differ}"
    if not np.array_equal(best.inliers, second.inliers):
        doubtful = [repr(names[index]) for index in np.flatnonzero(best.inliers != second.inliers).tolist()]
        advice = f"at least one of {', '.join(doubtful)} is wrong; check these, or add pairs"
        return UndeterminedPose("contradictory", f"{fits}: {advice}", candidates, modes)
    distance = float(np.linalg.norm(best.pose.positions[0]))
    if _principal_spread_px(correspondences, distance)[2] < MIN_SPREAD_SIGMAS * click_sigma_px:
        advice = "their points lie nearly on one plane, which can tilt either way; add a pair well above or below it"
        return UndeterminedPose("coplanar", f"{fits}: {advice}", candidates, modes)
    advice = (
        "add a pair, ideally where the surface rises or falls most" if len(correspondences) < 6 else "check the pairs"
    )
    return UndeterminedPose("ambiguous", f"{fits}: {advice}", candidates, modes)


def check_uncertainty(correspondences: Correspondences, mode: PoseMode, click_sigma_px: float) -> None:
    """Refuse a pose that is too uncertain.

    Raises
    ------
    UndeterminedPose
        A standard deviation beyond :data:`MAX_ROTATION_DEG` or :data:`MAX_RELATIVE_DEPTH`. The message names the cause:
        points in a small part of the image, nearly on one line, or nearly on one plane.
    """
    uncertainty = mode.uncertainty
    rotation_deg, depth = uncertainty.largest_rotation_deg, uncertainty.relative_depth
    if rotation_deg <= MAX_ROTATION_DEG and depth <= MAX_RELATIVE_DEPTH:
        return
    count = len(correspondences)
    found = (
        f"± {format_two_digits(rotation_deg)}° of rotation"
        if rotation_deg > MAX_ROTATION_DEG
        else f"± {format_two_digits(100 * depth)} % of the distance"
    )
    kind, cause = _diagnose(correspondences, float(np.linalg.norm(uncertainty.pivot_cam)), click_sigma_px)
    message = f"landmarks: {count} correspondences leave the pose undetermined ({found}): {cause}"
    raise UndeterminedPose(kind, message, [mode.cam_from_model], [mode])


def _diagnose(correspondences: Correspondences, distance: float, click_sigma_px: float) -> tuple[Kind, str]:
    """The reason why correspondences leave a pose undetermined, and what to do."""
    width, height = np.ptp(correspondences.pixels, axis=0)
    spread_px = _principal_spread_px(correspondences, distance)
    if max(width, height) < 25 * click_sigma_px:
        return "clustered", (
            f"they span {width:.0f} x {height:.0f} px, too little for a click noise of {click_sigma_px:g} px; "
            "add pairs towards all sides of the image"
        )
    if spread_px[1] < MIN_SPREAD_SIGMAS * click_sigma_px:
        return "collinear", "their points lie nearly on one line; add pairs well away from this line"
    if spread_px[2] < MIN_SPREAD_SIGMAS * click_sigma_px:
        return "coplanar", "their points lie nearly on one plane; add pairs well above or below it"
    return "ambiguous", "they contradict each other or are badly placed; check them, and add pairs towards all sides"


def _principal_spread_px(correspondences: Correspondences, distance: float) -> np.ndarray:
    """``(3,)`` standard deviations of the points along their principal axes, in px at ``distance`` mm."""
    px_per_mm = np.sqrt(correspondences.camera.fx * correspondences.camera.fy) / distance
    values = np.linalg.svd(correspondences.offsets - correspondences.offsets.mean(axis=0), compute_uv=False)
    return px_per_mm * values / np.sqrt(len(correspondences))
