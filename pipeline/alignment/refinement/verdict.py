"""The verdict on a refined pose: accepted, or refused with the reason.

It is accepted if it explains the image better than the rough pose, has a low second peak ratio, agrees between two
halves of the image, and has a small estimated error (:mod:`.verification`).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...case.pose_record import PoseRecord
from ...files.numbers import format_two_digits
from ...transforms import rotation_angle_deg
from ..pose_uncertainty import PoseUncertainty
from .image_pyramid import PyramidLevel
from .local_search import score
from .verification import ImageAgreement, Verification, jackknife, mean_distance_px, verify

MIN_SCORE = 0.1
"""Squared correlation of the refined pose."""

MAX_SECOND_PEAK_RATIO = 0.5

MAX_ROTATION_DEG = 15.0
"""Rotations beyond it are refused: slanted views begin to fit anything."""

MAX_SPLIT_HALF_PX, MAX_SPLIT_HALF_LEVEL_PX = 4.0, 1.4
"""In pixels of the full image, and of the finest level; the larger bound applies. Halves differ by twice the error of
the whole: of the sample's refinements with 3 to 3.6 px both were right, of those with 4.1 to 7.1 px none."""

MAX_ERROR_PX, MAX_ERROR_LEVEL_PX = 2.0, 0.7
"""Estimated error, in pixels of the full image and of the finest level; the larger bound applies."""

MAX_ERROR_DEG, MAX_ERROR_RELATIVE_DEPTH = 1.0, 0.01
"""Standard deviations of the rotation about its least certain axis, and of the distance. On small objects pixels hide
both: of 20 refinements on LM-O that pixels alone accepted, from 3 degrees off, 14 ended more than 3.5 degrees from the
truth; of the 9 that these bounds accept, one did. The sample and bloster state at most 0.6 degrees."""


@dataclass(frozen=True)
class Refinement:
    """The outcome of a refinement.

    Attributes
    ----------
    cam_from_model
        ``(4, 4)`` the refined pose if accepted, else the rough one.
    accepted
        Whether the refined pose passed the verification and has a higher score than the rough one.
    before, after
        Agreement of the rough and of the refined pose with the image, whether accepted or not. If ``found`` failed the
        verification, the error of the rough pose is unknown, and that of ``found`` a lower bound.
    message
        Why the refined pose was accepted or refused, with numbers.
    objection
        The reason alone if it was refused, otherwise empty.
    found
        ``(4, 4)`` the refined pose, also if it was refused.
    verified
        Whether ``found`` passed the verification; if so and not accepted, the rough pose was as good.
    moved_px, rotation_deg
        From the rough pose to ``found``: mean shift of the visible points, and angle of rotation.
    verification
        Measures of the verification; ``None`` if there was no refined pose to test.
    uncertainty
        Uncertainty of ``found``; ``None`` if there is none, or if the image does not determine it.
    """

    cam_from_model: np.ndarray
    accepted: bool
    before: ImageAgreement
    after: ImageAgreement
    message: str
    objection: str
    found: np.ndarray
    verified: bool
    moved_px: float
    rotation_deg: float
    verification: Verification | None
    uncertainty: PoseUncertainty | None

    @property
    def can_be_taken(self) -> bool:
        """Whether it was refused, but found a pose to look at and to take all the same."""
        return not self.accepted and not self.verified and self.verification is not None

    def record(self, start: PoseRecord, tool: str, date: str) -> PoseRecord:
        """The record of ``found``; ``start`` is that of the initial pose, ``date`` a day in ISO 8601."""
        # a pose that failed the verification may be anywhere: standard deviations would promise too much
        uncertainty = self.uncertainty if self.verified else None
        return PoseRecord(
            method="refined",
            tool=tool,
            date=date,
            refused="" if self.accepted else self.objection,
            start_method=start.method,
            error_px=known(self.after.error_px),
            start_error_px=known(self.before.error_px),
            explained=known(self.after.score),
            moved_px=known(self.moved_px),
            moved_deg=known(self.rotation_deg),
            **({} if uncertainty is None else uncertainty.deviations()),
        )


def known(value: float) -> float | None:
    """A finite number as such, else ``None``."""
    return float(value) if np.isfinite(value) else None


def refused_unsearched(start: np.ndarray, reason: str) -> Refinement:
    """The refusal of a rough pose that could not be refined."""
    none = ImageAgreement(0.0, np.nan)
    message = f"Refused, the pose is unchanged: {reason}."
    return Refinement(start, False, none, none, message, reason, start, False, 0.0, 0.0, None, None)


def judged(
    start: np.ndarray,
    pose: np.ndarray,
    before: float,
    levels: list[PyramidLevel],
    points: np.ndarray,
    camera: PinholeCamera,
) -> Refinement:
    """Verify a refined pose, and accept or refuse it.

    Parameters
    ----------
    start, pose
        ``(4, 4)`` the rough and the refined pose.
    before
        Score of the rough pose on the finest level.
    levels
        Coarse to fine.
    points
        ``(N, 3)`` visible points, mm, model frame.
    camera
        Intrinsics of the full image.
    """
    after = score(levels[-1], pose)
    tests = verify(levels[0], levels[-1], pose, points, camera)
    moved_px = mean_distance_px(camera, points, start, pose)
    rotation_deg = rotation_angle_deg(pose[:3, :3] @ start[:3, :3].T)
    uncertainty = jackknife(levels[-1], pose, points, camera)
    error_px = np.inf if uncertainty is None else uncertainty.root_mean_square_px(points, camera, pose)
    explained = f"the shape explains {after:.0%} of the image's variation ({before:.0%} before)"
    reasons = _objections(tests, levels[-1].px, after, rotation_deg, error_px, uncertainty)
    objection = next((f"{explained}, {reason}" for reason in reasons), "")
    accepted = not objection and after > before
    if objection:
        message = f"Refused, the pose is unchanged: {objection}; add landmarks, which decide without the image."
    elif accepted:
        message = (
            f"Refined by {moved_px:.1f} px and {rotation_deg:.2f}°: {explained}, two halves of the image agree within "
            f"{tests.split_half_px:.1f} px, and the next best place fits {tests.second_peak_ratio:.0%} as well. "
            f"The surface is off by about {format_two_digits(error_px)} px."
        )
    else:
        message = f"The pose is unchanged: the best pose nearby, {moved_px:.1f} px away, is no better ({explained})."
    return Refinement(
        cam_from_model=pose if accepted else start,
        accepted=accepted,
        before=ImageAgreement(before, np.nan if objection else float(np.hypot(moved_px, error_px))),
        after=ImageAgreement(after, error_px),
        message=message,
        objection=objection,
        found=pose,
        verified=not objection,
        moved_px=moved_px,
        rotation_deg=rotation_deg,
        verification=tests,
        uncertainty=uncertainty,
    )


def _objections(
    tests: Verification,
    level_px: float,
    score: float,
    rotation_deg: float,
    error_px: float,
    uncertainty: PoseUncertainty | None,
) -> Iterator[str]:
    """What speaks against a refined pose, the plainest first; ``level_px`` is the size of the finest level's pixels."""
    limit_error_px = max(MAX_ERROR_PX, MAX_ERROR_LEVEL_PX * level_px)
    limit_px = max(MAX_SPLIT_HALF_PX, MAX_SPLIT_HALF_LEVEL_PX * level_px)
    if score < MIN_SCORE:
        yield f"which is too little (at least {MIN_SCORE:.0%})"
    if tests.second_peak_ratio > MAX_SECOND_PEAK_RATIO:
        yield (f"but another place fits {tests.second_peak_ratio:.0%} as well (at most {MAX_SECOND_PEAK_RATIO:.0%})")
    if rotation_deg > MAX_ROTATION_DEG:
        yield f"but at a rotation of {rotation_deg:.0f}° (at most {MAX_ROTATION_DEG:.0f}°)"
    if tests.split_half_px > limit_px:
        yield (
            f"but the poses from two halves of the image differ by {tests.split_half_px:.1f} px "
            f"(at most {limit_px:.1f} px)"
        )
    if error_px > limit_error_px:
        moved = f"{format_two_digits(error_px)} px" if np.isfinite(error_px) else "any distance"
        yield f"but without parts of the image the surface would move by {moved} (at most {limit_error_px:.1f} px)"
    if uncertainty is None:
        return
    if uncertainty.largest_rotation_deg > MAX_ERROR_DEG:
        yield (
            f"but leaves a rotation uncertain by ± {format_two_digits(uncertainty.largest_rotation_deg)}° "
            f"(at most {MAX_ERROR_DEG:g}°)"
        )
    if uncertainty.relative_depth > MAX_ERROR_RELATIVE_DEPTH:
        distance_mm = float(np.linalg.norm(uncertainty.pivot_cam))
        yield (
            f"but leaves the distance uncertain by "
            f"± {format_two_digits(uncertainty.relative_depth * distance_mm)} mm "
            f"(at most {format_two_digits(MAX_ERROR_RELATIVE_DEPTH * distance_mm)} mm)"
        )
