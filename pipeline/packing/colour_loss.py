"""RGB as JPEG, and what that loses, as sums that add up over views and shards."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import cv2
import numpy as np

from ..dataset.decoding import Shape, decoded_rgb
from ..files.numbers import whole_number

LARGEST_SUM = 1 << 62


@dataclass(frozen=True)
class ColourLoss:
    """Differences of code values (0..255), over all three channels of all pixels.

    Attributes
    ----------
    values
        How many were compared.
    absolute, squared
        Sums of their absolute values and of their squares.
    largest
        The largest.
    """

    values: int = 0
    absolute: int = 0
    squared: int = 0
    largest: int = 0

    @classmethod
    def between(cls, one: np.ndarray, other: np.ndarray) -> "ColourLoss":
        """That of two uint8 images of one shape."""
        counts = np.bincount(np.abs(one.astype(np.int16) - other).ravel(), minlength=1)
        sizes = np.arange(len(counts))
        return cls(one.size, int(sizes @ counts), int(sizes**2 @ counts), int(np.flatnonzero(counts)[-1]))

    def __add__(self, other: "ColourLoss") -> "ColourLoss":
        return ColourLoss(
            self.values + other.values,
            self.absolute + other.absolute,
            self.squared + other.squared,
            max(self.largest, other.largest),
        )

    @property
    def mean(self) -> float:
        """Mean absolute difference."""
        return self.absolute / self.values if self.values else 0.0

    @property
    def psnr_db(self) -> float:
        """Peak signal-to-noise ratio; infinite without a difference."""
        return 10 * math.log10(255**2 * self.values / self.squared) if self.squared else math.inf

    def __str__(self) -> str:
        return f"mean error {self.mean:.2f} of 255, largest {self.largest}, PSNR {self.psnr_db:.1f} dB"

    def to_json(self) -> dict[str, object]:
        """The JSON object in the manifest."""
        return asdict(self)

    @classmethod
    def from_json(cls, content: Mapping[str, int]) -> "ColourLoss":
        """Read it again; raises KeyError, TypeError or ValueError for something else."""
        return cls(**{name: whole_number(content[name], LARGEST_SUM) for name in cls.__dataclass_fields__})


def as_jpeg(png: bytes, quality: int, shape: Shape, where: str) -> tuple[bytes, ColourLoss]:
    """The JPEG file of a PNG file's RGB, of a quality from 1 to 100, and its loss.

    Raises
    ------
    InputError
        Damaged, or of another size; ``where`` names the file.
    """
    rgb = decoded_rgb(png, shape, where)
    bgr = np.ascontiguousarray(rgb[..., ::-1])
    data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
    return data, ColourLoss.between(rgb, decoded_rgb(data, shape, where))


def jpeg_loss(jpeg: bytes, png: bytes, shape: Shape, where: str) -> ColourLoss:
    """The loss of a JPEG file against the PNG file that it was made from; raises as :func:`as_jpeg`."""
    return ColourLoss.between(decoded_rgb(jpeg, shape, where), decoded_rgb(png, shape, where))
