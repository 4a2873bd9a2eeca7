"""Image files: what every program reads alike is accepted; what programs read in their own ways is refused by name."""

import io
import struct
import zlib
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from PIL import Image, ImageCms

from oneframe.errors import InputError
from oneframe.images.image_check import check_image

ORIENTATION, MAKER, COLOURS = 0x0112, 0x010F, 0xA001
TURNED = range(2, 9)
PIXELS = np.random.default_rng(2).integers(0, 256, (48, 64, 3), np.uint8)
DISPLAY_P3 = struct.pack(">8I", 31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000)
SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def saved(kind: str, image: np.ndarray = PIXELS, mode: str = "", **how: object) -> bytes:
    """By Pillow."""
    buffer = io.BytesIO()
    picture = Image.fromarray(image)
    (picture.convert(mode) if mode else picture).save(buffer, kind, **how)
    return buffer.getvalue()


def png(*chunks: tuple[bytes, bytes]) -> bytes:
    """With chunks before its pixels."""
    whole = saved("PNG")
    made = (
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in chunks
    )
    return whole[:33] + b"".join(made) + whole[33:]


def exif(**of: object) -> Image.Exif:
    """An EXIF block with an orientation, or a number for its colours."""
    block = Image.Exif()
    block[MAKER] = "a maker"
    if of.get("orientation") is not None:
        block[ORIENTATION] = of["orientation"]
    if "colours" in of:
        block.get_ifd(0x8769)[COLOURS] = of["colours"]
    return block


def profile(red: float, gamma: float) -> bytes:
    """The profile of sRGB with another red, or another curve."""
    count = struct.unpack_from(">I", SRGB, 128)[0]
    result = bytearray(SRGB)
    for name, begin, _ in (struct.unpack_from(">4sII", SRGB, 132 + 12 * number) for number in range(count)):
        if name == b"rXYZ":
            struct.pack_into(">i", result, begin + 8, round(red * 65536))
        if name[1:] == b"TRC":
            struct.pack_into(">4s4xIH", result, begin, b"curv", 1, round(gamma * 256))
    return bytes(result)


def flipped(data: bytes, at: int) -> bytes:
    return data[:at] + bytes(byte ^ 0x5A for byte in data[at : at + 12]) + data[at + 12 :]


wide = PIXELS.astype(np.uint16) * 257
ACCEPTED: dict[str, Callable[[], bytes]] = {
    "16-bit PNG": lambda: cv2.imencode(".png", wide)[1].tobytes(),
    "grey PNG with alpha": lambda: saved("PNG", mode="LA"),
    "PNG in the sRGB of ICC": lambda: saved("PNG", icc_profile=SRGB),
    "PNG with sRGB's gamma": lambda: png((b"gAMA", struct.pack(">I", 45455))),
    "PNG, sRGB before gamma": lambda: png((b"sRGB", b"\0"), (b"gAMA", struct.pack(">I", 100_000))),
    "PNG in the sRGB of video": lambda: png((b"cICP", b"\1\x0d\0\1")),
    "progressive JPEG in sRGB": lambda: saved("JPEG", progressive=True, icc_profile=SRGB, exif=exif(colours=1)),
    "grey JPEG": lambda: saved("JPEG", mode="L"),
}  # fmt: skip
REFUSED: dict[str, tuple[Callable[[], bytes], str]] = {
    "linear PNG": (lambda: png((b"gAMA", struct.pack(">I", 100_000))), "not sRGB"),
    "PNG of wide primaries": (lambda: png((b"cHRM", DISPLAY_P3)), "not sRGB"),
    "HDR PNG": (lambda: png((b"cICP", b"\x09\x10\0\1"), (b"sRGB", b"\0")), "not sRGB"),
    "wide profile": (lambda: saved("PNG", icc_profile=profile(0.6097, 2.2)), "colour profile"),
    "linear profile": (lambda: saved("JPEG", icc_profile=profile(0.436, 1.0)), "colour profile"),
    "damaged profile": (lambda: saved("JPEG", icc_profile=SRGB[:100]), "colour profile"),
    "camera's Adobe RGB": (lambda: saved("JPEG", exif=exif(colours=2)), "Adobe RGB"),
    "animation": (lambda: saved("PNG", save_all=True, append_images=[Image.fromarray(PIXELS[::-1])]), "animation"),
    "transparent colour": (lambda: saved("PNG", transparency=(1, 2, 3)), "transparent"),
    "CMYK": (lambda: saved("JPEG", mode="CMYK"), "CMYK"),
    "arithmetic JPEG": (lambda: saved("JPEG").replace(b"\xff\xc0", b"\xff\xc9", 1), "arithmetic"),
    "JPEG-LS": (lambda: saved("JPEG").replace(b"\xff\xc0", b"\xff\xf7", 1), "lossless"),
    "Apple's PNG": (lambda: saved("PNG")[:8] + png((b"CgBI", b"1234"))[33:49] + saved("PNG")[8:], "few programs"),
    "TIFF": (lambda: saved("TIFF"), "found TIFF"),
    "BigTIFF": (lambda: b"II+\0" + bytes(100), "found TIFF"),
    "cut off": (lambda: saved("PNG")[:-100], "cut off"),
    "damaged": (lambda: flipped(saved("PNG"), 900), "damaged"),
    "JPEG with a hole": (lambda: saved("JPEG")[:-100] + bytes(64) + saved("JPEG")[-36:], "a part of it is zeros"),
    "progressive JPEG, cut off": (lambda: saved("JPEG", progressive=True)[:-100], "cut off"),
    "WebP": (lambda: saved("WEBP"), "found WebP"),
    "BMP": (lambda: saved("BMP"), "found BMP"),
    "OpenEXR": (lambda: b"\x76\x2f\x31\x01" + bytes(100), "found OpenEXR"),
    "AVIF": (lambda: b"\0\0\0\x20ftypavif" + bytes(100), "found AVIF"),
    "no image": (lambda: b"John Doe, 1970", "found another kind of file"),
}  # fmt: skip


@pytest.mark.parametrize("kind", ACCEPTED)
def test_what_every_program_reads_alike_is_accepted(kind):
    assert check_image(ACCEPTED[kind](), "frame") == (64, 48)


@pytest.mark.parametrize("kind", REFUSED)
def test_what_programs_read_in_their_own_ways_is_refused_by_name(kind):
    made, reason = REFUSED[kind]
    with pytest.raises(InputError, match=rf"^frame: expected an image.*{reason}.*save it as PNG") as refused:
        check_image(made(), "frame")
    assert "Doe" not in str(refused.value)


@pytest.mark.parametrize("kind", ["JPEG", "PNG"])
@pytest.mark.parametrize("orientation", [None, 0, 1, 9, *TURNED])
def test_an_image_with_an_exif_orientation_is_refused(kind, orientation):
    data = saved(kind, exif=exif(orientation=orientation))
    if orientation not in TURNED:
        check_image(data, "frame")
        return
    with pytest.raises(InputError, match=rf"^frame: .*EXIF orientation {orientation}, .*save it as PNG"):
        check_image(data, "frame")
