"""A decoded frame as its film states that it looks: matrix, range and orientation. Needs ``av`` and ``cv2``."""

import cv2
import numpy as np
from av.video.frame import VideoFrame
from av.video.reformatter import Colorspace, Interpolation, VideoReformatter

HD_WIDTH, HD_HEIGHT = 1280, 577
"""From either on the matrix is that of BT.709 where the film states none, else that of BT.601: as mpv and VLC do it."""

_UNSTATED = (2, 3)
"""FFmpeg's AVCOL_SPC_UNSPECIFIED and AVCOL_SPC_RESERVED."""

_QUICK = Interpolation.BILINEAR
_EXACT = Interpolation.BILINEAR | Interpolation.FULL_CHR_H_INT | Interpolation.ACCURATE_RND
"""Colours within a code, and between two of them as where they lie; 40 instead of 8 ms for 1920x1080 px."""

_COMB_COLUMNS = 4
"""Every so many columns are looked at for combs."""


class Converter:
    """From frames of one film to RGB; keeps its tables from frame to frame."""

    def __init__(self) -> None:
        self._reformatter = VideoReformatter()
        self._matrix: list[list[float]] | None = None

    def rgb(self, frame: VideoFrame, *, exact: bool) -> np.ndarray:
        """``(H, W, 3)`` uint8 RGB, as coded: not yet upright; within two codes if it need not be exact."""
        matrix = None
        if frame.colorspace in _UNSTATED:
            is_hd = frame.width >= HD_WIDTH or frame.height >= HD_HEIGHT
            matrix = Colorspace.ITU709 if is_hd else Colorspace.ITU601
        how = _EXACT if exact else _QUICK
        found = self._reformatter.reformat(frame, format="rgb24", src_colorspace=matrix, interpolation=how)
        return found.to_ndarray()

    def upright(self, image: np.ndarray, frame: VideoFrame) -> np.ndarray:
        """An image turned and mirrored in steps of 90 degrees, as the display matrix of the film's first frame says."""
        if self._matrix is None:
            # a frame that was once asked for its side data is not freed
            found = frame.side_data.get("DISPLAYMATRIX")
            matrix = np.eye(3) if found is None else np.frombuffer(bytes(found), np.int32).reshape(3, 3)
            self._matrix = matrix[:2, :2].tolist()
        (a, b), (c, d) = self._matrix
        # a pixel (x, y) is shown at (a x + c y, b x + d y), its sign telling from which side that is counted
        if max(abs(b), abs(c)) > max(abs(a), abs(d)):
            image, a, d = image.swapaxes(0, 1), c, b
        return image[:: -1 if d < 0 else 1, :: -1 if a < 0 else 1]


def comb_ratio(plane: np.ndarray) -> float:
    """How much more neighbouring rows differ than rows of one field do: above 1 if the fields show other moments."""
    rows = plane[: len(plane) // 2 * 2, ::_COMB_COLUMNS]
    if len(rows) < 4:
        return 0.0
    upper, lower = np.ascontiguousarray(rows[0::2]), np.ascontiguousarray(rows[1::2])
    across = cv2.norm(upper, lower, cv2.NORM_L1) / upper.size
    within = cv2.norm(upper[1:], upper[:-1], cv2.NORM_L1) / upper[1:].size
    return float(across / (within + 0.5))
