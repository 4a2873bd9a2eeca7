"""What makes the colours of a run worse than the frame's: a pose that is off, views too near or too far."""

from ..case.pose_record import PoseRecord
from ..files.numbers import format_two_digits

MAX_STATED_ERROR_PX = 1.0
"""Error of the pose, stated in the case, up to which colours count as in place: each pixel of error costs 8/255 of
mean colour error on detail 18 px wide (``benchmark.py stability``)."""

MAX_MAGNIFICATION = 4.0
"""Enlargement of the frame's pixels in a view up to which views count as sharp: at twice that, detail 18 px wide in the
view is 15/255 off (measured there too)."""


MAX_REDUCTION = 8.0
"""Pixels of the frame, along a side, in one of a view with one ray: beyond it, views of detail down to the frame's
pixel are more than 3/255 off the mean over the pixel."""


def pose_doubt(record: PoseRecord) -> str:
    """A message if the record of the pose states an error of more than :data:`MAX_STATED_ERROR_PX`; else empty."""
    error_px = record.error_px
    if error_px is None or not error_px > MAX_STATED_ERROR_PX:
        return ""
    return (
        f"[alignment] states that the surface is off by about {format_two_digits(error_px)} px in the frame: colours "
        "are off by as much on the surface; refine the pose, or add landmarks"
    )


def magnification_doubt(view_focal_px: float, frame_focal_px: float, nearest: float = 1.0) -> str:
    """A message if views enlarge the frame more than :data:`MAX_MAGNIFICATION` times; else empty.

    ``nearest`` is the smallest distance of a view from the surface, relative to the frame's.
    """
    magnification = view_focal_px / (frame_focal_px * nearest)
    if magnification <= MAX_MAGNIFICATION:
        return ""
    return (
        f"views enlarge the frame up to {magnification:.3g} times: they are blurred, as it has no finer detail; use a "
        "smaller --scale, a larger --distance-min, or a larger frame"
    )


def reduction_doubt(view_focal_px: float, frame_focal_px: float, farthest: float, samples: int) -> str:
    """A message if views with one ray a pixel reduce the frame more than :data:`MAX_REDUCTION` times; else empty.

    ``farthest`` is the largest distance of a view from the surface, relative to the frame's.
    """
    reduction = frame_focal_px * farthest / view_focal_px
    if samples > 1 or reduction <= MAX_REDUCTION:
        return ""
    return (
        f"views reduce the frame up to {reduction:.3g} times with one ray a pixel, so fine detail turns into noise "
        "(aliasing); use --samples 4 or more"
    )
