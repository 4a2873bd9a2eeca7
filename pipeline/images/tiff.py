"""The directory of a TIFF file, and of EXIF, which has the same form: what it says of its picture, checked.

Blender decodes the picture; what its decoder cannot do it fills with black, and tells nobody. So only what it does in
full passes: one page in strips, without compression or deflated. Sources: TIFF 6.0; Exif 2.32, 4.6.
"""

import math
import struct
import zlib
from collections.abc import Mapping
from contextlib import suppress

from .colour_profile import check_profile

TIFF_SIGNATURES = (b"II*\0", b"MM\0*")
_HEADER_BYTES = 8

_FORMS = {1: "s", 2: "s", 3: "H", 4: "I", 5: "I", 7: "s"}
"""Type of a value -> letter of struct; type 5 are fractions, two numbers each."""

_MOST_VALUES = 1 << 20
"""Values of a tag that is looked at; others may hold megabytes."""

_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _COLOURS, _OFFSETS, _ORIENTATION = 256, 257, 258, 259, 262, 273, 274
_SAMPLES, _ROWS, _SIZES, _BRIGHTEST, _PAGES, _EXTRA, _PROFILE, _EXIF = 277, 278, 279, 281, 330, 338, 34675, 34665
_EXIF_COLOURS = 40961

_COMPRESSIONS = {
    5: "LZW", 7: "JPEG", 32773: "PackBits", 34712: "JPEG 2000", 34887: "LERC", 34925: "LZMA", 50000: "ZSTD",
    50001: "WebP",
}  # fmt: skip
_DEFLATED = (8, 32946)

_CHANNELS = {
    0: "inverted grey", 3: "a palette", 5: "CMYK", 6: "YCbCr", 8: "L*a*b*", 9: "L*a*b*", 10: "L*a*b*",
    32803: "a raw sensor",
}  # fmt: skip
_EXTRA_CHANNELS = {0: "a channel without a stated meaning", 1: "alpha that its colours are multiplied by"}

_PLAIN = {
    254: (0, "its first picture is a small or masked version of another one"),
    266: (1, "its bits are reversed"),
    284: (1, "its channels are stored one after the other"),
    339: (1, "its values are no whole numbers from 0"),
}
"""Tag -> the value that it has in a plain picture, which is its default, and what another one means."""

_SRGB = {318: (0.3127, 0.329), 319: (0.64, 0.33, 0.3, 0.6, 0.15, 0.06)}
"""Tags of the white point and of the primaries -> chromaticities of sRGB."""
_CURVE, _SRGB_MIDDLE = 301, 0.2158
"""Tag of the linear light of each code value, and that of the middle one in sRGB."""

_NUMBERS = {
    _WIDTH, _HEIGHT, _BITS, _COMPRESSION, _COLOURS, _OFFSETS, _SAMPLES, _ROWS, _SIZES, _BRIGHTEST, _EXTRA, _CURVE,
    *_PLAIN, *_SRGB,
}  # fmt: skip


def checked_tiff(data: bytes, most_pixels: int) -> tuple[int, int, int]:
    """Width, height and orientation of a TIFF that holds one whole picture in sRGB.

    Raises
    ------
    ValueError, struct.error, KeyError
        What else it is; or its header is damaged.
    """
    tags, following = _directory(data)
    for tag in _NUMBERS | {_PROFILE}:
        if tag in tags and not (tags[tag] and isinstance(tags[tag][0], int if tag in _NUMBERS else bytes)):
            raise KeyError(tag)
    width, height = tags[_WIDTH][0], tags[_HEIGHT][0]
    if following or tags.get(_PAGES):
        raise ValueError("it holds several pictures, of which programs show different ones")
    for tag, (plain, reason) in _PLAIN.items():
        if set(tags.get(tag, (plain,))) != {plain}:
            raise ValueError(reason)
    bits, samples = tags.get(_BITS, (1,)), tags.get(_SAMPLES, (1,))[0]
    colours, extra = tags[_COLOURS][0], tags.get(_EXTRA, ())
    if (colours, samples, extra) not in ((1, 1, ()), (2, 3, ()), (2, 4, (2,))):
        named = _CHANNELS.get(colours) or _EXTRA_CHANNELS.get(extra[0] if extra else 2) or f"{samples} channels"
        raise ValueError(f"it has {named}, not grey, RGB, or RGB with straight alpha")
    deep = max(bits)
    if deep not in (8, 16) or min(bits) != deep or min(tags.get(_BRIGHTEST, (1 << 16,))) < (1 << deep) - 1:
        raise ValueError(f"it has {deep} bits a channel, or less in use, not 8 or 16")
    if _PROFILE in tags:
        check_profile(tags[_PROFILE][0])  # type: ignore[arg-type]
    differences = [abs(tags[_CURVE][1 << (deep - 1)] / 65535 - _SRGB_MIDDLE)] if _CURVE in tags else []
    for tag in _SRGB.keys() & tags.keys():
        numbers = tags[tag]
        differences += [abs(numbers[2 * at] / (numbers[2 * at + 1] or 1) - own) for at, own in enumerate(_SRGB[tag])]
    if max(differences, default=0.0) > 0.005:
        raise ValueError("its colours are not sRGB, as its white point, primaries or transfer function say")
    if 0 < width * height <= most_pixels:
        _check_strips(data, tags, width * samples * deep // 8, height)
    return width, height, checked_exif(data)


def _check_strips(data: bytes, tags: Mapping[int, tuple[int, ...]], row_bytes: int, height: int) -> None:
    """That all strips are there, and as long as the picture needs them; deflated ones have a checksum."""
    compression = tags.get(_COMPRESSION, (1,))[0]
    if compression != 1 and compression not in _DEFLATED:
        name = _COMPRESSIONS.get(compression, f"of number {compression}")
        raise ValueError(f"its compression is {name}, which cannot be read with certainty")
    if _OFFSETS not in tags:
        raise ValueError("it is made of tiles")
    rows = min(tags.get(_ROWS, (height,))[0], height)
    if not rows or not len(tags[_OFFSETS]) == len(tags[_SIZES]) == math.ceil(height / rows):
        raise ValueError("its header is damaged")
    for strip, (begin, size) in enumerate(zip(tags[_OFFSETS], tags[_SIZES], strict=True)):
        if begin + size > len(data):
            raise ValueError("the file is cut off")
        if begin < _HEADER_BYTES:  # of a strip that was never written
            raise ValueError("the file is damaged")
        needed = row_bytes * min(rows, height - strip * rows)
        if compression in _DEFLATED:
            inflater = zlib.decompressobj()
            try:
                size = len(inflater.decompress(memoryview(data)[begin : begin + size], needed + 1))
            except zlib.error:
                size = 0
            size *= inflater.eof
        if size < needed:
            raise ValueError("the file is damaged")


def checked_exif(exif: bytes) -> int:
    """The orientation in an EXIF block, or in a TIFF; 1, upright, where it says nothing or is damaged.

    Raises
    ------
    ValueError
        Its colours are Adobe RGB: cameras need no profile to say so.
    """
    tags: dict[int, tuple[int, ...]] = {}
    inner: dict[int, tuple[int, ...]] = {}
    with suppress(struct.error, KeyError):
        tags, _ = _directory(exif)
        inner, _ = _directory(exif, (tags[_EXIF] or (0,))[0])
    # Exif has no number for it but DCF a text; some cameras write 2
    if inner.get(_EXIF_COLOURS) == (2,) or (inner.get(_EXIF_COLOURS) == (65535,) and b"R03\0" in exif[:65536]):
        raise ValueError("its colours are Adobe RGB, as its EXIF says, not sRGB")
    return (tags.get(_ORIENTATION) or (1,))[0]


def _directory(data: bytes, first: int | None = None) -> tuple[dict[int, tuple[int, ...]], int]:
    """The values of a directory's tags by number, a text or block as one, none if unreadable; where the next begins."""
    order = "<" if data[:2] == b"II" else ">"
    begin = struct.unpack_from(order + "I", data, 4)[0] if first is None else first
    (count,) = struct.unpack_from(order + "H", data, begin)
    tags: dict[int, tuple[int, ...]] = {}
    end = begin + 2 + 12 * count
    for entry in range(begin + 2, end, 12):
        tag, kind, values, offset = struct.unpack_from(order + "HHII", data, entry)
        if kind in _FORMS and 0 < values <= _MOST_VALUES:
            form = f"{order}{values * (2 if kind == 5 else 1)}{_FORMS[kind]}"
            at = entry + 8 if struct.calcsize(form) <= 4 else offset
            if at + struct.calcsize(form) <= len(data):
                tags.setdefault(tag, struct.unpack_from(form, data, at))
        # stated, but of another type, or beyond the end
        tags.setdefault(tag, ())
    return tags, int.from_bytes(data[end : end + 4], "little" if order == "<" else "big")
