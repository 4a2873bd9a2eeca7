"""Distances between two sets of images, FID and KID, from the features that InceptionV3 gives them. Needs ``cv2``.

FID (Heusel et al. 2017) is biased: it falls with the number of images, so only values of equal numbers compare, and
below :data:`FID_IMAGES` images not even those say much. KID (Bińkowski et al. 2018) is unbiased for any number, and has
a standard error. The user exports the network once, see the page on evaluation: nothing is downloaded.
"""

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..files.content import read_content

SIDE_PX = 299
FEATURES = 2048
"""Number of features: those of InceptionV3's last pooling layer ("pool3")."""
_PADDING = re.compile(rb"\x0a\x11count_include_pad\x18([\x00\x01])")
"""The attribute of an average pool in the file: whether its padding counts."""

FID_IMAGES = 2048
"""With fewer images than features the covariances of FID are singular; its authors demand at least this number."""
FEWEST_IMAGES = 3
"""Least size of each set; fewer have no covariance, or no standard error."""


@dataclass(frozen=True)
class Distances:
    """FID, and KID with its standard error, between ``n`` photographs and their views."""

    fid: float
    kid: float
    kid_error: float
    n: int


def frechet_distance(a: np.ndarray, b: np.ndarray) -> float:
    """FID: the squared Fréchet distance of two normal distributions fitted to ``(N, D)`` and ``(M, D)`` features.

    The trace of the square root of the product of both covariances is the sum of the singular values of ``A B^T``, with
    A and B the centred features over the square root of their degrees of freedom. So nothing is inverted, and no root
    of a singular matrix is taken.
    """
    a, b = a.astype(float), b.astype(float)
    means = a.mean(axis=0), b.mean(axis=0)
    centred = [(part - mean) / np.sqrt(len(part) - 1) for part, mean in zip((a, b), means, strict=True)]
    root = np.linalg.svd(centred[0] @ centred[1].T, compute_uv=False).sum()
    variances = sum(float((part**2).sum()) for part in centred)
    return float(((means[0] - means[1]) ** 2).sum() + variances - 2 * root)


def kernel_distance(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """KID and its standard error, of ``(N, D)`` features, three or more: unbiased, kernel ``(x.y / D + 1)^3``.

    Row i of both sets belongs to one photograph and its view. The standard error is that of a jackknife which leaves
    out one such pair at a time, so it takes into account that they resemble each other. It is never too small on
    average (Efron and Stein 1981): for sets that differ it is right, for equal distributions 1.4 times too large.

    """
    a, b = a.astype(float), b.astype(float)
    within_a, within_b, between = _kernel(a, a), _kernel(b, b), _kernel(a, b)
    for within in (within_a, within_b):
        np.fill_diagonal(within, 0)
    count = len(a)
    kid = _unbiased(within_a.sum(), within_b.sum(), between.sum(), count)
    left = _unbiased(
        within_a.sum() - 2 * within_a.sum(axis=1),
        within_b.sum() - 2 * within_b.sum(axis=1),
        between.sum() - between.sum(axis=0) - between.sum(axis=1) + np.diagonal(between),
        count - 1,
    )
    variance = (count - 1) / count * float(((left - left.mean()) ** 2).sum())
    return float(kid), float(np.sqrt(variance))


def _kernel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a @ b.T / a.shape[1] + 1) ** 3


def _unbiased(within_a: ArrayLike, within_b: ArrayLike, between: ArrayLike, count: int) -> np.ndarray:
    """From the sums of the kernel over all pairs, without those of an image with itself in ``within``."""
    return np.add(within_a, within_b) / (count * (count - 1)) - 2 * np.asarray(between) / count**2


def distances(pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> Distances:
    """FID and KID from the features of photographs and of their views."""
    real, rendered = (np.array(each) for each in zip(*pairs, strict=True))
    return Distances(frechet_distance(real, rendered), *kernel_distance(real, rendered), len(pairs))


class Inception:
    """A network in memory; call it with an image."""

    def __init__(self, path: Path) -> None:
        """Read the network and try it."""
        data = read_content(path, "an ONNX file of InceptionV3")
        self.name = f"{path.name} (SHA-256 {hashlib.sha256(data).hexdigest()})"
        expected = f"{path.name}: expected InceptionV3 as ONNX, 1x3x{SIDE_PX}x{SIDE_PX} -> {FEATURES} features"
        advice = "export it as the page on evaluation in the documentation says"
        try:
            self._network = cv2.dnn.readNetFromONNX(np.frombuffer(_with_padding_rule(data, path.name), np.uint8))
            given = self._features(np.zeros((SIDE_PX, SIDE_PX, 3), np.float32))
        except cv2.error as error:
            reason = " ".join(str(error.err or error).split())[:200]
            raise InputError(f"{expected}; OpenCV cannot run this one ({reason}); {advice}") from None
        if given.size != FEATURES:
            raise InputError(f"{expected}, found {given.size} values (shape {given.shape}); {advice}")
        if not np.isfinite(given).all():
            raise InputError(f"{expected}, found values that are not finite; {advice}")

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """``(H, W, 3)`` code values 0..1 -> ``(2048,)`` float32 features.

        A larger image is reduced by averaging over areas, which leaves no aliases (Parmar et al. 2022); the code values
        go to the network as -1..1.
        """
        larger = min(image.shape[:2]) > SIDE_PX
        shown = cv2.resize(image, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA if larger else cv2.INTER_LINEAR)
        return self._features(2 * shown.astype(np.float32) - 1).ravel()

    def _features(self, image: np.ndarray) -> np.ndarray:
        self._network.setInput(np.ascontiguousarray(image.transpose(2, 0, 1)[None]))
        return self._network.forward()


def _with_padding_rule(data: bytes, name: str) -> bytes:
    """The file with a producer for which OpenCV treats the padding of average pools as the file says.

    OpenCV 4 ignores the attribute: it counts the padding if the producer is "pytorch", and only then. PyTorch writes
    both kinds (torchvision's InceptionV3 counts it, that of FID does not), and the wrong one changes the features by
    1 to 8 %. A later producer in the file replaces the earlier one.
    """
    rules = set(_PADDING.findall(data))
    if len(rules) > 1:
        raise InputError(
            f"{name}: expected average pools that all count their padding or all leave it out, found both, which "
            "OpenCV cannot run; export InceptionV3 as the page on evaluation in the documentation says"
        )
    producer = b"pytorch" if rules == {b"\x01"} else b"oneframe"
    return data + bytes([0x12, len(producer)]) + producer
