"""Frames are read as their code values, whatever the file's name; a PNG by OpenCV as by Blender."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from oneframe.blender.bridge.image import decode
from oneframe.errors import InputError
from oneframe.images.image_reader import read_image

WIDTH, HEIGHT = 40, 30


def codes(channels: int, bits: int) -> np.ndarray:
    """Noise with the darkest and the brightest value; alpha 0 in one corner, and anything above elsewhere."""
    rng = np.random.default_rng(channels)
    image = rng.integers(0, 2**bits, (HEIGHT, WIDTH, channels)).astype(f"uint{bits}")
    image[0, :2, 0] = 0, 2**bits - 1
    if channels in (2, 4):
        image[..., -1] = np.maximum(image[..., -1], 2 ** (bits - 8))
        image[20:, :10, -1] = 0
    return image


def expected(image: np.ndarray, bits: int) -> tuple[np.ndarray, np.ndarray]:
    colours = image[..., :3] if image.shape[2] >= 3 else np.repeat(image[..., :1], 3, axis=2)
    valid = image[..., -1] > 0 if image.shape[2] in (2, 4) else np.ones((HEIGHT, WIDTH), bool)
    return colours / (2**bits - 1), valid


def assert_read(path: Path, image: np.ndarray, bits: int) -> None:
    colours, valid = read_image(path)
    wanted, wanted_valid = expected(image, bits)
    assert colours.dtype == np.float32
    np.testing.assert_allclose(colours, wanted, atol=1e-6)
    assert np.array_equal(valid, wanted_valid)
    by_blender = decode(path.read_bytes(), "")
    assert np.array_equal(colours, np.broadcast_to(by_blender[..., : min(3, by_blender.shape[2])], colours.shape))


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("bits", [8, 16])
def test_grey_colour_and_alpha_of_8_and_16_bit(tmp_path, channels, bits):
    image = codes(channels, bits)
    path = tmp_path / "FRAME.PNG"
    bgr = image if channels == 1 else image[..., [2, 1, 0, 3][:channels]]
    path.write_bytes(cv2.imencode(".png", np.ascontiguousarray(bgr))[1].tobytes())
    assert_read(path, image, bits)


def test_grey_with_alpha_and_a_palette_whatever_the_name(tmp_path):
    grey, few = codes(2, 8), codes(3, 8) // 128 * 255
    palette = Image.fromarray(few).convert("P", palette=Image.Palette.ADAPTIVE, colors=8)
    for image, picture in ((grey, Image.fromarray(grey, "LA")), (few, palette)):
        picture.save(tmp_path / "frame.jpg", "PNG")
        assert_read(tmp_path / "frame.jpg", image, 8)


@pytest.mark.parametrize("mode", ["L", "RGB"])
def test_jpeg_as_any_other_reader(tmp_path, mode):
    smooth = cv2.GaussianBlur(codes(3, 8), (0, 0), 4)
    path = tmp_path / "FRAME.JPEG"
    Image.fromarray(smooth).convert(mode).save(path, quality=98)
    wanted = np.asarray(Image.open(path).convert("RGB"))
    colours, _ = read_image(path)
    assert np.abs(colours * 255 - wanted).max() < 3


@pytest.mark.parametrize("kind", ["a hole", "the end lost"])
def test_what_the_decoder_could_not_read_is_no_picture(tmp_path, kind):
    """Decoders fill it, and say so on the standard error alone."""
    whole = cv2.imencode(".jpg", cv2.GaussianBlur(codes(3, 8), (0, 0), 4), [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    begin = len(whole) - 200
    damaged = whole[:begin] + (bytes(60) + whole[begin + 60 :] if kind == "a hole" else b"\xff\xd9")
    (tmp_path / "frame.jpg").write_bytes(damaged)
    with pytest.raises(InputError, match=r"frame.jpg: expected a whole image.*damaged; copy it again"):
        read_image(tmp_path / "frame.jpg")


@pytest.mark.parametrize("bits", [8, 10, 12, 14])
def test_codes_of_a_sensor_stored_in_16_bits_are_refused(tmp_path, bits):
    cv2.imwrite(str(tmp_path / "frame.png"), codes(3, 16) >> (16 - bits))
    with pytest.raises(InputError, match=f"the brightest is {2**bits - 1} of 65535.*stretch them"):
        read_image(tmp_path / "frame.png")


def test_what_follows_the_end_of_a_jpeg_does_not_count(tmp_path, rng):
    whole = cv2.imencode(".jpg", cv2.GaussianBlur(codes(3, 8), (0, 0), 4))[1].tobytes()
    path = tmp_path / "frame.jpg"
    path.write_bytes(whole)
    wanted, _ = read_image(path)
    path.write_bytes(whole + bytes(rng.integers(0, 255, 200_000, np.uint8)))
    assert np.array_equal(read_image(path)[0], wanted)
    # nor is the mark of the end, if all rows are there
    path.write_bytes(whole[:-2])
    assert np.array_equal(read_image(path)[0], wanted)
    path.write_bytes(whole[:-20] + bytes(200_000))
    with pytest.raises(InputError, match="a part of it is zeros; copy it again"):
        read_image(path)
