"""Image files: those that some programs turn and some do not are refused, all others are none of its business."""

import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from pipeline.errors import InputError
from pipeline.images.image_check import check_image_file
from pipeline.images.pixel_values import to_uint8

TURNED = {
    2: "mirrored",
    3: "180",
    4: "top to bottom",
    5: "mirrored",
    6: "90 degrees cl",
    7: "90",
    8: "counter-clockwise",
}
FORMATS = ("JPEG", "PNG", "TIFF")
ORIENTATION, MAKER, COPYRIGHT = 0x0112, 0x010F, 0x8298


def encoded(kind: str, orientation: int | None, **tags: str) -> bytes:
    exif = Image.Exif()
    exif[MAKER], exif[COPYRIGHT] = "a maker", "nobody"
    if orientation is not None:
        exif[ORIENTATION] = orientation
    buffer = io.BytesIO()
    Image.fromarray(np.zeros((48, 64, 3), np.uint8)).save(buffer, kind, exif=exif)
    return buffer.getvalue()


def check(folder: Path, data: bytes) -> None:
    (folder / "FRAME.JPG").write_bytes(data)
    check_image_file(folder / "FRAME.JPG", "case.toml: image")


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("orientation", TURNED)
def test_an_image_that_is_to_be_turned_is_refused(tmp_path, kind, orientation):
    with pytest.raises(InputError, match=rf"^case.toml: image: .* to be .*{TURNED[orientation]}.*save it anew as PNG"):
        check(tmp_path, encoded(kind, orientation))


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("orientation", [None, 0, 1, 9])
def test_an_upright_image_is_taken(tmp_path, kind, orientation):
    check(tmp_path, encoded(kind, orientation))


def test_the_other_byte_order_is_read(tmp_path):
    big = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    with pytest.raises(InputError, match="turned by 90 degrees clockwise"):
        check(tmp_path, big)


@given(data=st.binary(max_size=60), begin=st.sampled_from([b"II*\0", b"MM\0*", b"\xff\xd8\xff\xe1\0\x1eExif\0\0II*\0"]))
def test_any_bytes_are_taken_or_refused(tmp_path_factory, data, begin):
    try:
        check(tmp_path_factory.getbasetemp(), begin + data + b"\xff\xd9")
    except InputError as error:
        assert "to be" in str(error)  # noqa: PT017


def test_codes_are_the_nearest(rng):
    values = rng.uniform(-0.5, 1.5, (50, 3))
    codes = to_uint8(values)
    assert codes.dtype == np.uint8
    assert np.abs(codes - np.clip(values, 0, 1) * 255).max() <= 0.5
    assert np.array_equal(to_uint8(np.arange(256, dtype=np.float32) / 255), np.arange(256))
