"""Check before decoding that an image file is complete, of a sensible size, and the same image in every program.

That is a PNG of 8 or 16 bits or a JPEG: grey or RGB in sRGB, without or with straight alpha, upright, one picture a
file. Everything else is refused by its name: decoders read it in different ways, or fill with black what they cannot
read. Sources: PNG (W3C 2025), 11.2 and 11.3; JPEG (ITU T.81), B.2.2; Exif 2.32, 4.6; ICC.1:2022, 7 and 10.
"""

import struct
import zlib
from contextlib import suppress
from pathlib import Path

from ..errors import InputError
from ..files.content import read_content

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_SIGNATURE = b"\xff\xd8\xff"

LARGEST_IMAGE, LARGEST_FRAME = 1 << 26, 25_000_000
"""Pixels of the largest image that is decoded, and of the largest frame, which Blender opens in 1 GB; 4K has 8.3
million."""

_BEGINNINGS = {
    PNG_SIGNATURE: "PNG", JPEG_SIGNATURE: "JPEG", **dict.fromkeys((b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), "TIFF"),
    b"BM": "BMP", b"GIF8": "GIF", b"\x76\x2f\x31\x01": "OpenEXR", b"\0\0\0\x0cJXL ": "JPEG XL",
    b"\xff\x0a": "JPEG XL", b"\0\0\0\x0cjP  ": "JPEG 2000", b"\xff\x4f\xff\x51": "JPEG 2000", b"8BPS": "PSD",
    **{b"P%d" % kind: "PNM" for kind in range(1, 8)},
}  # fmt: skip
_BRANDS = {b"avif": "AVIF", b"avis": "AVIF", **dict.fromkeys((b"heic", b"heix", b"heim", b"heis", b"mif1"), "HEIC")}

_FRAMES = {0xC0, 0xC1, 0xC2}
"""Markers of JPEG's frames that every decoder reads: baseline, extended, progressive."""
_OTHER_FRAMES = {*range(0xC3, 0xD0), 0xF7} - {0xC4, 0xC8, 0xCC}

_BRIGHTNESS, _HOLE = 0x10, bytes(64)
"""Table of a JPEG's codes for details of brightness; bytes that a failed sector or a sparse copy leaves."""

_SRGB_GAMMA, _SRGB_CHROMATICITIES = 45455, (31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)
"""Of PNG's gAMA and cHRM, in 1/100 000."""

_EXIF_NUMBERS, _ORIENTATION, _EXIF_PART, _EXIF_COLOURS = {3: "H", 4: "I"}, 274, 34665, 40961
"""Types of EXIF's whole numbers, and its tags: the place of the second directory, and a colour space."""

_OTHER_PROFILES = ("Display P3", "Adobe RGB", "ProPhoto", "2020", "DCI", "Dot Gain", "Gray Gamma")
"""Names of profiles that messages show: others may hold anything."""

_PROFILE_PRIMARIES = {
    b"rXYZ": (0.4360, 0.2225, 0.0139),
    b"gXYZ": (0.3851, 0.7169, 0.0971),
    b"bXYZ": (0.1431, 0.0606, 0.7141),
}
"""Of sRGB, adapted to D50."""

_MIDDLE_LIGHT = 0.2140
"""Linear light of the middle code value."""

_PROFILE_TOLERANCE = 0.0025


def image_kind(start: bytes) -> str | None:
    """The name of an image format, such as ``"WebP"``, by the first bytes of a file; ``None`` if it is none."""
    if start[4:8] == b"ftyp":
        return _BRANDS.get(start[8:12])
    if start[:4] == b"RIFF":
        return "WebP" if start[8:12] == b"WEBP" else None
    return next((kind for beginning, kind in _BEGINNINGS.items() if start.startswith(beginning)), None)


def check_image_file(path: Path, where: str, *, most_pixels: int = LARGEST_IMAGE) -> bytes:
    """Check that an image file exists, is complete, of a sensible size, and the same image in every program.

    Decoders, Blender's among them, silently fill missing pixels with black. Some, such as OpenCV's, apply the EXIF
    orientation and others, such as Blender's, do not: the same pixel coordinates then mean different pixels. And a file
    of some hundred kilobytes can announce more pixels than fit in memory.

    It gives the bytes that were checked; ``where`` begins the messages.
    """
    data = read_content(path, "an image file", where)
    check_image(data, where, most_pixels=most_pixels)
    return data


def check_image(data: bytes, where: str, *, most_pixels: int = LARGEST_IMAGE) -> tuple[int, int]:
    """Check the bytes of an image file, as :func:`check_image_file` does, and give its width and height."""
    kind = image_kind(data)
    if kind not in ("PNG", "JPEG"):
        raise InputError(
            f"{where}: expected an image as PNG or JPEG, found {kind or 'another kind of file'}; "
            "save it as PNG of 8 or 16 bits, in sRGB"
        )
    try:
        width, height, orientation = (_checked_png if kind == "PNG" else _checked_jpeg)(data)
    except (ValueError, struct.error, IndexError, KeyError, zlib.error) as error:
        reason = error if type(error) is ValueError else "its header is cut off or damaged"
        is_damaged = "damaged" in str(reason) or "cut off" in str(reason)
        advice = "copy it again, or save it as PNG" if is_damaged else "save it as PNG of 8 or 16 bits, in sRGB"
        raise InputError(f"{where}: expected an image, {reason}; {advice}") from None
    if 2 <= orientation <= 8:
        raise InputError(
            f"{where}: expected an upright image, found the EXIF orientation {orientation}, by which some programs "
            "turn or mirror it, and others do not; open it, save it as PNG, and give the K of the saved image"
        )
    if not 0 < width * height <= most_pixels:
        raise InputError(
            f"{where}: expected an image of at most {most_pixels / 1e6:.1f} million pixels, found {width}x{height}; "
            "crop it or scale it down, and give the K of the result"
        )
    return width, height


def image_size(data: bytes) -> tuple[int, int]:
    """Width and height in the header of a PNG or JPEG file, unchecked.

    Raises
    ------
    ValueError
        No such file, or a damaged header.
    """
    try:
        if data.startswith(PNG_SIGNATURE):
            width, height = struct.unpack_from(">II", data, 16)
            return width, height
        return _checked_jpeg(data)[:2]
    except (struct.error, IndexError):
        raise ValueError("its header is cut off or damaged") from None


def may_have_alpha(data: bytes) -> bool:
    """Whether a checked image file may have alpha, by its beginning: a JPEG and most PNG rule it out."""
    return data[25:26] in (b"\4", b"\6") if data.startswith(PNG_SIGNATURE) else not data.startswith(JPEG_SIGNATURE)


def _checked_png(data: bytes) -> tuple[int, int, int]:
    """Width, height and EXIF orientation of a PNG whose chunks are all there, undamaged, and a picture in sRGB."""
    position, kind, chunks = len(PNG_SIGNATURE), b"", dict[bytes, bytes]()
    view = memoryview(data)  # a slice of bytes would be a copy, of all pixels perhaps
    while kind != b"IEND":
        size = int.from_bytes(data[position : position + 4], "big")
        kind, body = data[position + 4 : position + 8], view[position + 8 : position + 8 + size]
        position += 12 + size
        if len(data) < position:
            raise ValueError("the file is cut off")
        if zlib.crc32(body, zlib.crc32(kind)) != int.from_bytes(data[position - 4 : position], "big"):
            raise ValueError("the file is damaged")
        if kind != b"IDAT":
            chunks.setdefault(kind, bytes(body))
    if next(iter(chunks)) != b"IHDR":  # Apple's own form begins otherwise
        raise ValueError("it is a PNG of a kind that few programs read")
    for chunk, reason in ((b"acTL", "it is an animation"), (b"tRNS", "one of its colours stands for transparent")):
        if chunk in chunks:
            raise ValueError(f"{reason}, which programs read in different ways")
    # the first of them counts
    if b"cICP" in chunks:
        is_srgb = chunks[b"cICP"] == b"\x01\x0d\x00\x01"
    elif b"iCCP" in chunks:
        _check_profile(zlib.decompressobj().decompress(chunks[b"iCCP"].partition(b"\0")[2][1:], 1 << 24))
        is_srgb = True
    else:
        gamma = int.from_bytes(chunks.get(b"gAMA", b""), "big") or _SRGB_GAMMA
        stated = struct.unpack(">8I", chunks[b"cHRM"]) if b"cHRM" in chunks else _SRGB_CHROMATICITIES
        differences = (abs(one - other) for one, other in zip(stated, _SRGB_CHROMATICITIES, strict=True))
        is_srgb = b"sRGB" in chunks or (abs(gamma - _SRGB_GAMMA) < 500 and max(differences) < 500)
    if not is_srgb:
        raise ValueError("its colours are not sRGB, as its chunk gAMA, cHRM or cICP says")
    return *struct.unpack_from(">II", data, 16), _checked_exif(chunks.get(b"eXIf", b""))


def _checked_jpeg(data: bytes) -> tuple[int, int, int]:
    """Width, height and EXIF orientation of a JPEG in sRGB; segments end where its pixels begin."""
    position, marker, size, exif, profile, codes = 2, 0, None, b"", b"", dict[int, bytes]()
    while marker != 0xDA:
        marker, at = data[position + 1], position + 4
        if data[position] != 0xFF:
            raise ValueError("its header is damaged")
        if marker in (0x01, 0xFF):  # without content; padding
            position += 2 if marker == 0x01 else 1
            continue
        body = data[at : at - 2 + int.from_bytes(data[at - 2 : at], "big")]
        while marker == 0xC4 and body:  # tables of Huffman codes
            codes[body[0]], body = body[17:18], body[17 + sum(body[1:17]) :]
        if marker in _FRAMES:
            is_progressive = marker == 0xC2
            precision, height, width, components = struct.unpack_from(">BHHB", body)
            size = width, height
            if precision != 8 or components not in (1, 3):
                colours = "CMYK" if components == 4 else f"{components} channels"
                raise ValueError(f"it is a JPEG of {precision} bits and {colours}, not of 8 bits and grey or RGB")
        elif marker in _OTHER_FRAMES:
            raise ValueError("it is a JPEG of a kind (lossless, arithmetic) that few programs read")
        elif marker == 0xE1 and body.startswith(b"Exif\0\0"):
            exif = body[6:]
        elif marker == 0xE2 and body.startswith(b"ICC_PROFILE\0"):
            profile += body[14:]
        position += 2 + max(2, int.from_bytes(data[at - 2 : at], "big"))
    if size is None:
        raise ValueError("it has no size")
    # what follows the end, such as the film of a phone's moving picture, is not the image's; of one picture in one
    # scan, the decoder tells whether rows are lost
    end = data.find(b"\xff\xd9", position)
    if end < 0 and (is_progressive or body[0] < components):
        raise ValueError("the file is cut off")
    # unless the code of zeros ends a block of brightness, zeros say noise that no encoder writes
    is_plain = not is_progressive and body[0] == components and codes.get(_BRIGHTNESS, b"\0") != b"\0"
    if is_plain and data.find(_HOLE, position, end) >= 0:
        raise ValueError("the file is damaged, a part of it is zeros")
    if profile:
        _check_profile(profile)
    return *size, _checked_exif(exif)


def _checked_exif(exif: bytes) -> int:
    """The orientation in an EXIF block; 1, upright, where it says nothing or is damaged."""
    order = "<" if exif[:2] == b"II" else ">"
    numbers: dict[int, int] = {}
    with suppress(struct.error):
        numbers[_EXIF_PART] = struct.unpack_from(order + "I", exif, 4)[0]
        # its directory, and the one that this points to
        for _ in range(2):
            begin = numbers.pop(_EXIF_PART, len(exif))
            for entry in range(struct.unpack_from(order + "H", exif, begin)[0]):
                tag, kind, count = struct.unpack_from(order + "HHI", exif, begin + 2 + 12 * entry)
                if kind in _EXIF_NUMBERS and count == 1:
                    (number,) = struct.unpack_from(order + _EXIF_NUMBERS[kind], exif, begin + 10 + 12 * entry)
                    numbers.setdefault(tag, number)
    # Exif has no number for it but DCF a text; some cameras write 2
    colours = numbers.get(_EXIF_COLOURS)
    if colours == 2 or (colours == 65535 and b"R03\0" in exif[:65536]):
        raise ValueError("its colours are Adobe RGB, as its EXIF says, not sRGB")
    return numbers.get(_ORIENTATION, 1)


def _check_profile(profile: bytes) -> None:
    """Check that an ICC profile has the primaries and the curve of sRGB; of grey, its curve."""
    try:
        (count,) = struct.unpack_from(">I", profile, 128)
        entries = (struct.unpack_from(">4sII", profile, 132 + 12 * number) for number in range(min(count, 100)))
        tags = {name: profile[begin : begin + size] for name, begin, size in entries}
        primaries = {} if profile[16:20] == b"GRAY" else _PROFILE_PRIMARIES
        stated = [struct.unpack_from(">3i", tags[name], 8) for name in primaries]
        differences = [
            abs(number / 65536 - wanted)
            for numbers, own in zip(stated, primaries.values(), strict=True)
            for number, wanted in zip(numbers, own, strict=True)
        ]
        curves = [tags[name] for name in ((b"rTRC", b"gTRC", b"bTRC") if primaries else (b"kTRC",))]
        differences += [abs(_middle_of(curve) - _MIDDLE_LIGHT) for curve in curves]
        is_srgb = max(differences) < _PROFILE_TOLERANCE
    except (struct.error, KeyError, IndexError):
        is_srgb = False
    if not is_srgb:
        texts = profile.replace(b"\0", b"")
        name = next((name for name in _OTHER_PROFILES if name.encode() in texts), "another one than sRGB")
        raise ValueError(f"its colour profile is {name}, and colours are read as sRGB")


def _middle_of(curve: bytes) -> float:
    """Linear light of the middle code value, by a tag ``curv`` with a table, or ``para`` with a straight part."""
    (count,) = struct.unpack_from(">I", curve, 8)
    if curve[:4] == b"curv" and count > 2:
        below, above = struct.unpack_from(">2H", curve, 12 + 2 * ((count - 1) // 2))
        return (below if count % 2 else (below + above) / 2) / 65535
    gamma, scale, shift = (number / 65536 for number in struct.unpack_from(">3i", curve, 12))
    return float((scale / 2 + shift) ** gamma) if curve[:4] == b"para" and count >> 16 == 3 else 0.0
