"""A decoded frame as its film states that it looks: matrix, range and orientation. Needs ``av`` and ``cv2``."""

import cv2
import numpy as np
from av.video.frame import VideoFrame
from av.video.reformatter import Colorspace, Interpolation, VideoReformatter

from ..errors import InputError

HD_WIDTH, HD_HEIGHT = 1280, 577
"""From either on the matrix is that of BT.709 where the film states none, else that of BT.601: as mpv and VLC do it."""

_UNSTATED = (2, 3)
"""FFmpeg's AVCOL_SPC_UNSPECIFIED and AVCOL_SPC_RESERVED."""

_QUICK = Interpolation.BILINEAR
_EXACT = Interpolation.BILINEAR | Interpolation.FULL_CHR_H_INT | Interpolation.ACCURATE_RND
"""Colours within a code, and between two of them as where they lie; 40 instead of 8 ms for 1920x1080 px."""

_COMB_COLUMNS = 4
"""Every so many columns are looked at for combs."""


_HALVES: dict[int, str | None] = {0: None, 1: "two eyes side by side", 2: "two eyes, one over the other"}
"""By FFmpeg's AVStereo3DType; of a film for one eye, its pictures are looked at."""

_CROPS = {"two eyes, one over the other": "iw:ih/2:0:0"}

_LOOKED_AT_PX, _LEAST_DETAIL = 160, 2.0
"""Side of the square in which halves are compared, and contrast below which it shows nothing, code values."""

_LEAST_LIKENESS, _LEAST_LEAD = 0.6, 0.2
"""Correlation of one half with the other, and by how much more than with other parts, of what repeats itself."""


class Converter:
    """From frames of one film to RGB; keeps its tables from frame to frame."""

    def __init__(self) -> None:
        self._reformatter = VideoReformatter()
        self._matrix: list[list[float]] | None = None
        self._halves: str | None = None

    def rgb(self, frame: VideoFrame, *, exact: bool) -> np.ndarray:
        """``(H, W, 3)`` uint8 RGB, as coded: not yet upright; within two codes if it need not be exact."""
        matrix = None
        if frame.colorspace in _UNSTATED:
            is_hd = frame.width >= HD_WIDTH or frame.height >= HD_HEIGHT
            matrix = Colorspace.ITU709 if is_hd else Colorspace.ITU601
        how = _EXACT if exact else _QUICK
        found = self._reformatter.reformat(frame, format="rgb24", src_colorspace=matrix, interpolation=how)
        return found.to_ndarray()

    @property
    def turned(self) -> str:
        """How :meth:`upright` shows the film differently from how it is stored; empty if it does not."""
        (a, b), (c, d) = self._matrix or [[1, 0], [0, 1]]
        if max(abs(b), abs(c)) > max(abs(a), abs(d)):
            return "rotated by 90°" if b * c < 0 else "mirrored and rotated by 90°"
        return {(1, -1): "mirrored top to bottom", (-1, 1): "mirrored left to right", (-1, -1): "rotated by 180°"}.get(
            (1 if a >= 0 else -1, 1 if d >= 0 else -1), ""
        )

    def look_at(self, frame: VideoFrame) -> None:
        """Learn from the first frame that is decoded, be it shown or not, what a film states with key frames alone."""
        if self._matrix is None:
            # a frame that was once asked for its side data is not freed
            found = frame.side_data.get("DISPLAYMATRIX")
            matrix = np.eye(3) if found is None else np.frombuffer(bytes(found), np.int32).reshape(3, 3)
            self._matrix = matrix[:2, :2].tolist()
            stereo = frame.side_data.get("STEREO3D")
            kind = 0 if stereo is None else int(np.frombuffer(bytes(stereo), np.int32, 1)[0])
            self._halves = _HALVES.get(kind, "two eyes in one picture")

    def upright(self, image: np.ndarray) -> np.ndarray:
        """An image turned and mirrored in steps of 90 degrees, as the film's display matrix says.

        A film of two eyes is refused.
        """
        if self._halves is None:
            self._halves = repeated_halves(image)
        if self._halves:
            raise InputError(
                f"expected the film of one eye, found {self._halves}; crop it to the left eye, for example with ffmpeg "
                f"-vf crop={_CROPS.get(self._halves, 'iw/2:ih:0:0')}, and give the K of what is left"
            )
        (a, b), (c, d) = self._matrix or [[1, 0], [0, 1]]
        # a pixel (x, y) is shown at (a x + c y, b x + d y), its sign telling from which side that is counted
        if max(abs(b), abs(c)) > max(abs(a), abs(d)):
            image, a, d = image.swapaxes(0, 1), c, b
        return image[:: -1 if d < 0 else 1, :: -1 if a < 0 else 1]


def repeated_halves(image: np.ndarray) -> str | None:
    """Whether the halves of a picture show the same twice: what, or ``""``; ``None`` if it shows too little.

    What repeats itself at other distances too is a pattern.
    """
    side = _LOOKED_AT_PX
    grey = cv2.cvtColor(cv2.resize(image, (side, side), interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
    detail = grey - cv2.GaussianBlur(grey.astype(np.float32), (0, 0), side / 20)
    if detail.std() < _LEAST_DETAIL:
        return None
    margin, middle = side // 16, side // 2
    for number, across in ((1, detail), (2, np.ascontiguousarray(detail.T))):
        if all(_repeats(across, rows, margin) for rows in (slice(margin, middle), slice(middle, side - margin))):
            return _HALVES[number]
    return ""


def _repeats(detail: np.ndarray, rows: slice, margin: int) -> bool:
    """Whether what the left of these rows shows comes again half a picture to the right, and nowhere else."""
    side = len(detail)
    part = np.ascontiguousarray(detail[rows, margin : margin + side // 3])
    likeness = np.max(cv2.matchTemplate(detail, part, cv2.TM_CCOEFF_NORMED), axis=0)
    distance = np.arange(len(likeness)) - margin
    is_half = np.abs(distance - side // 2) <= margin
    half, others = np.max(likeness[is_half]), np.max(likeness[~is_half & (np.abs(distance) > margin)])
    return bool(half > _LEAST_LIKENESS and half > others + _LEAST_LEAD)


def comb_ratio(plane: np.ndarray) -> float:
    """How much more neighbouring rows differ than rows of one field do: above 1 if the fields show other moments."""
    rows = plane[: len(plane) // 2 * 2, ::_COMB_COLUMNS]
    if len(rows) < 4:
        return 0.0
    upper, lower = np.ascontiguousarray(rows[0::2]), np.ascontiguousarray(rows[1::2])
    across = cv2.norm(upper, lower, cv2.NORM_L1) / upper.size
    within = cv2.norm(upper[1:], upper[:-1], cv2.NORM_L1) / upper[1:].size
    return float(across / (within + 0.5))
