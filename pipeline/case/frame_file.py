"""A frame and its mask, read by Blender, and as the file that a case folder keeps."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files.content import read_content
from ..images.image_check import JPEG_SIGNATURE
from ..images.image_reader import read_image
from ..images.masked_frame import encoded_frame, joined_mask, shown_by_mask
from .case_folder import KeptFile


@dataclass(frozen=True)
class Frame:
    """A frame in memory, as its file holds it: with the lens's distortion, before it has a camera or a pose.

    Attributes
    ----------
    name
        Of its file, for messages.
    colours, shown
        ``(H, W, 3)`` float32 code values 0..1, and ``(H, W)`` bool, False where it shows no surface.
    """

    name: str
    colours: np.ndarray
    shown: np.ndarray

    @property
    def size_wh(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.shown.shape[1], self.shown.shape[0]

    @property
    def masked(self) -> float:
        """Fraction of its pixels that show no surface, 0..1."""
        return float(1 - self.shown.mean())

    def with_mask(self, path: Path) -> "Frame":
        """The frame without what a mask's file hides, in addition to what its own alpha hides.

        Raises
        ------
        InputError
            No image without losses; an image in colour; one of another size; or one that hides all that is left.
        """
        if path.is_file() and read_content(path, "a mask", path.name).startswith(JPEG_SIGNATURE):
            raise InputError(f"{path.name}: expected a mask, found a JPEG, which blurs its zeros; make it as PNG")
        mask = shown_by_mask(*read_image(path, path.name), path.name)
        return replace(self, shown=joined_mask(self.shown, mask, self.name, path.name))

    def kept(self, target: Path) -> KeptFile:
        """The frame as a PNG of a case folder.

        Raises
        ------
        InputError
            It hides everything, or its values are not those of 8 or 16 bits.
        """
        if not self.shown.any():
            raise InputError(f"{self.name}: expected a frame that shows something, its alpha is 0 everywhere")
        return KeptFile(target, encoded_frame(self.colours, self.shown, self.name))


def read_frame(path: Path) -> Frame:
    """Read a frame.

    Raises
    ------
    InputError
        No usable image; see :func:`oneframe.blender.bridge.image.read_image`.
    """
    return Frame(path.name, *read_image(path, path.name))
