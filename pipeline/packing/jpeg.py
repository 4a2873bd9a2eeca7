"""RGB as JPEG, and what that loses. The only part of packing that needs OpenCV."""

import cv2
import numpy as np

from ..errors import InputError
from .colour_loss import ColourLoss

VERSION: str = cv2.__version__
"""Version of OpenCV: another one may compress to other bytes."""


def as_jpeg(png: bytes, quality: int, where: str) -> tuple[bytes, ColourLoss]:
    """The JPEG file of a PNG file's RGB, and its loss.

    Parameters
    ----------
    png
        The file.
    quality
        1..100.
    where
        Names the file in messages.

    Raises
    ------
    InputError
        No image that OpenCV reads.
    """
    image = decoded_bgr(png, where)
    done, encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise InputError(f"{where}: expected an image that JPEG can hold, found one of {image.shape[:2]} px")
    data = encoded.tobytes()
    return data, ColourLoss.between(image, decoded_bgr(data, where))


def jpeg_loss(jpeg: bytes, png: bytes, where: str) -> ColourLoss | None:
    """The loss of a JPEG file against the PNG file that it was made from; ``None`` if their sizes differ.

    Raises
    ------
    InputError
        One of them is no image that OpenCV reads.
    """
    one, other = decoded_bgr(jpeg, where), decoded_bgr(png, where)
    return ColourLoss.between(one, other) if one.shape == other.shape else None


def decoded_bgr(data: bytes, where: str) -> np.ndarray:
    """The ``(H, W, 3)`` uint8 image, BGR.

    Raises
    ------
    InputError
        No image that OpenCV reads.
    """
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
    if image is None:
        raise InputError(f"{where}: expected an image, found a damaged file")
    return image
