"""How far the RGB of a pack is from that of its dataset, as sums that add up over views and shards."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass

import numpy as np

from ..errors import InputError

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
    def from_json(cls, content: object, where: str) -> "ColourLoss":
        """Read it again.

        Raises
        ------
        InputError
            Something else.
        """
        names = tuple(cls.__dataclass_fields__)
        if not isinstance(content, Mapping) or not all(_is_count(content.get(name)) for name in names):
            raise InputError(f"{where}: expected the loss of JPEG as whole numbers, found {content!r}")
        return cls(**{name: content[name] for name in names})


def total_loss(losses: Iterable[ColourLoss]) -> ColourLoss:
    """That of all of them together."""
    return sum(losses, ColourLoss())


def _is_count(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= LARGEST_SUM
