"""Headers give the size that decoders find; what is announced is checked before anything is decoded."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.errors import InputError
from oneframe.images.image_check import MOST_SCANS, check_image
from oneframe.images.image_header import image_header

FORMATS = {".png": 16, ".jpg": 8, ".tif": 16, ".bmp": 8}


@pytest.mark.parametrize("suffix", FORMATS)
@given(shape=st.tuples(st.integers(1, 200), st.integers(1, 200)), channels=st.sampled_from([1, 3]), deep=st.booleans())
def test_the_size_is_the_decoders(suffix, shape, channels, deep):
    bits = FORMATS[suffix] if deep else 8
    image = np.zeros((*shape, channels), np.uint16 if bits == 16 else np.uint8)
    data = cv2.imencode(suffix, image)[1].tobytes()
    header = check_image(data, "frame")
    assert (header.height, header.width) == shape
    assert header.pixel_bytes == channels * bits / 8


def test_progressive_images_have_scans():
    image = np.random.default_rng(0).integers(0, 256, (60, 80, 3)).astype(np.uint8)
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    scans = image_header(data).scans
    assert 1 < scans < MOST_SCANS
    scan = data[data.index(b"\xff\xda") : data.index(b"\xff", data.index(b"\xff\xda") + 2)]
    with pytest.raises(
        InputError, match=rf"found one of 3 bytes a pixel in {scans + MOST_SCANS} scans; save it as PNG"
    ):
        check_image(data[:-2] + scan * MOST_SCANS + b"\xff\xd9", "frame")


@pytest.mark.parametrize(
    "begin", [b"II*\0", b"MM\0*", b"\xff\xd8\xff", b"BM", b"\x76\x2f\x31\x01", b"\x89PNG\r\n\x1a\n"]
)
@given(data=st.binary(max_size=200))
def test_any_header_is_a_size_or_a_sentence(begin, data):
    try:
        header = check_image(begin + data + b"\xff\xd9", "frame")
    except InputError as error:
        assert str(error).startswith("frame: expected a")  # noqa: PT017
    else:
        assert header.width * header.height * header.pixel_bytes > 0
