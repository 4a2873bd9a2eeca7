"""A landmark: one feature, as a point on the surface and as a pixel of the frame."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Landmark:
    """One point of the surface and the pixel where it is seen; either may still be missing.

    `point` is in mm, in a `Case` in the frame `given`. `pixel` is in the UNDISTORTED frame, in px, with (0, 0) at the
    centre of the top-left pixel. A landmark that is not `enabled` is kept, but takes no part in the alignment.
    """

    name: str
    point: tuple[float, float, float] | None
    pixel: tuple[float, float] | None
    enabled: bool = True
