"""Features of images by the InceptionV3 that FID and KID are defined with, from an ONNX file. Needs ``cv2``.

The user exports the file once, see the page on evaluation in the documentation: nothing is downloaded.
"""

import re
from pathlib import Path

import cv2
import numpy as np

from ...errors import InputError
from ...files.content import read_content

SIDE_PX = 299
FEATURES = 2048
"""Number of features: those of InceptionV3's last pooling layer ("pool3")."""
_PADDING = re.compile(rb"\x0a\x11count_include_pad\x18([\x00\x01])")
"""The attribute of an average pool in the file: whether its padding counts."""


class Inception:
    """A network in memory; call it with an image."""

    def __init__(self, path: Path) -> None:
        """Read the network and try it."""
        self.name = path.name
        data = read_content(path, "an ONNX file of InceptionV3")
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
