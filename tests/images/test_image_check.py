"""Image files: what every program reads alike is accepted; what programs read in their own ways is refused by name."""

import io
import struct
import zlib
from collections.abc import Callable

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image, ImageCms

from oneframe.errors import InputError
from oneframe.images.image_check import check_image

ORIENTATION, MAKER, COLOURS = 0x0112, 0x010F, 0xA001
TURNED = range(2, 9)
PIXELS = np.random.default_rng(2).integers(0, 256, (48, 64, 3), np.uint8)
DISPLAY_P3 = struct.pack(">8I", 31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000)
P3_FRACTIONS = (68, 100, 32, 100, 265, 1000, 69, 100, 15, 100, 6, 100)
DEFLATED, ZSTD = (struct.pack("<HHII", 259, 3, 1, number) for number in (8, 50000))
SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def saved(kind: str, image: np.ndarray = PIXELS, mode: str = "", **how: object) -> bytes:
    """By Pillow."""
    buffer = io.BytesIO()
    picture = Image.fromarray(image)
    (picture.convert(mode) if mode else picture).save(buffer, kind, **how)
    return buffer.getvalue()


def tiff(image: np.ndarray = PIXELS, **how: object) -> bytes:
    """By tifffile: several pictures by a list of its arguments."""
    buffer = io.BytesIO()
    options = {name: how.pop(name) for name in ("byteorder", "bigtiff") if name in how}
    with tifffile.TiffWriter(buffer, **options) as file:
        for page in how.pop("pages", [{}]):
            file.write(**{"data": image, "photometric": "rgb", **how, **page})
    return buffer.getvalue()


def changed_tag(number: int, at: int, value: bytes) -> bytes:
    """A TIFF, with other bytes in the entry of a tag."""
    whole = tiff(byteorder="<")
    begin = whole.index(struct.pack("<HH", number, 3 if number == 258 else 4)) + at
    return whole[:begin] + value + whole[begin + len(value) :]


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


alpha = np.dstack([PIXELS, np.full(PIXELS.shape[:2], 128, np.uint8)])
wide = PIXELS.astype(np.uint16) * 257
small = {"data": PIXELS[::4, ::4], "subfiletype": 1}
ACCEPTED: dict[str, Callable[[], bytes]] = {
    "16-bit PNG": lambda: cv2.imencode(".png", wide)[1].tobytes(),
    "grey PNG with alpha": lambda: saved("PNG", mode="LA"),
    "PNG in the sRGB of ICC": lambda: saved("PNG", icc_profile=SRGB),
    "PNG with sRGB's gamma": lambda: png((b"gAMA", struct.pack(">I", 45455))),
    "PNG, sRGB before gamma": lambda: png((b"sRGB", b"\0"), (b"gAMA", struct.pack(">I", 100_000))),
    "PNG in the sRGB of video": lambda: png((b"cICP", b"\1\x0d\0\1")),
    "progressive JPEG in sRGB": lambda: saved("JPEG", progressive=True, icc_profile=SRGB, exif=exif(colours=1)),
    "grey JPEG": lambda: saved("JPEG", mode="L"),
    "TIFF": tiff,
    "16-bit big-endian TIFF": lambda: tiff(wide, byteorder=">"),
    "deflated TIFF with a predictor": lambda: cv2.imencode(
        ".tif", wide, [cv2.IMWRITE_TIFF_COMPRESSION, 8, cv2.IMWRITE_TIFF_PREDICTOR, 2]
    )[1].tobytes(),
    "TIFF with alpha": lambda: tiff(alpha, extrasamples=["unassalpha"], iccprofile=SRGB),
    "grey TIFF": lambda: tiff(wide[..., 0], photometric="minisblack", rowsperstrip=7),
}  # fmt: skip
REFUSED: dict[str, tuple[Callable[[], bytes], str]] = {
    "linear PNG": (lambda: png((b"gAMA", struct.pack(">I", 100_000))), "not sRGB"),
    "PNG of wide primaries": (lambda: png((b"cHRM", DISPLAY_P3)), "not sRGB"),
    "HDR PNG": (lambda: png((b"cICP", b"\x09\x10\0\1"), (b"sRGB", b"\0")), "not sRGB"),
    "wide profile": (lambda: saved("PNG", icc_profile=profile(0.6097, 2.2)), "colour profile"),
    "linear profile": (lambda: saved("JPEG", icc_profile=profile(0.436, 1.0)), "colour profile"),
    "damaged profile": (lambda: tiff(iccprofile=SRGB[:100]), "colour profile"),
    "camera's Adobe RGB": (lambda: saved("JPEG", exif=exif(colours=2)), "Adobe RGB"),
    "animation": (lambda: saved("PNG", save_all=True, append_images=[Image.fromarray(PIXELS[::-1])]), "animation"),
    "transparent colour": (lambda: saved("PNG", transparency=(1, 2, 3)), "transparent"),
    "CMYK": (lambda: saved("JPEG", mode="CMYK"), "CMYK"),
    "arithmetic JPEG": (lambda: saved("JPEG").replace(b"\xff\xc0", b"\xff\xc9", 1), "arithmetic"),
    "ZSTD": (lambda: tiff(compression="zlib").replace(DEFLATED, ZSTD), "ZSTD"),
    "LZW": (lambda: cv2.imencode(".tif", PIXELS)[1].tobytes(), "LZW"),
    "damaged strip": (lambda: flipped(tiff(compression="zlib"), 900), "damaged"),
    "cut off": (lambda: tiff(compression="zlib")[:-100], "cut off"),
    "cut off, uncompressed": (lambda: tiff(rowsperstrip=4, byteorder=">")[:-100], "cut off"),
    "thumbnail first": (lambda: tiff(pages=[small, {}]), "several pictures"),
    "thumbnail with its picture inside": (lambda: tiff(pages=[{**small, "subifds": 1}, {}]), "a small"),
    "a page a channel": (lambda: tiff(PIXELS[..., 0], photometric="minisblack", pages=[{}] * 3), "several pictures"),
    "BigTIFF": (lambda: tiff(bigtiff=True), "found BigTIFF"),
    "channel by channel": (lambda: tiff(np.moveaxis(PIXELS, 2, 0), planarconfig="separate"), "one after the other"),
    "a strip never written": (lambda: changed_tag(273, 8, bytes(4)), "damaged"),
    "no rows in a strip": (lambda: changed_tag(278, 8, bytes(4)), "damaged"),
    "bits of another type": (lambda: changed_tag(258, 2, b"\x08"), "header"),
    "primaries": (lambda: tiff(extratags=[(319, "2I", 6, P3_FRACTIONS, True)]), "white"),
    "linear": (lambda: tiff(extratags=[(301, "H", 256, tuple(range(0, 65536, 257)), True)]), "white"),
    "tiles": (lambda: tiff(tile=(16, 16)), "tiles"),
    "floats": (lambda: tiff(PIXELS.astype(np.float32)), "no whole numbers"),
    "12 bits in 16": (lambda: tiff(wide // 16, extratags=[(281, "H", 3, (4095,) * 3, True)]), "8 or 16"),
    "associated alpha": (lambda: tiff(alpha, extrasamples=["assocalpha"]), "multiplied"),
    "a fourth channel": (lambda: tiff(alpha, extrasamples=["unspecified"]), "without a stated meaning"),
    "inverted grey": (lambda: tiff(PIXELS[..., 0], photometric="miniswhite"), "inverted grey"),
    "palette": (lambda: saved("TIFF", mode="P"), "palette"),
    "L*a*b*": (lambda: saved("TIFF", mode="LAB"), r"L\*a\*b\*"),
    "1 bit": (lambda: saved("TIFF", mode="1"), "it has 1 bits"),
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


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF"])
@pytest.mark.parametrize("orientation", [None, 0, 1, 9, *TURNED])
def test_an_image_with_an_exif_orientation_is_refused(kind, orientation):
    data = saved(kind, exif=exif(orientation=orientation))
    if orientation not in TURNED:
        check_image(data, "frame")
        return
    with pytest.raises(InputError, match=rf"^frame: .*EXIF orientation {orientation}, .*save it as PNG"):
        check_image(data, "frame")
