"""Whether a colour profile is sRGB's, as which every picture is read. Source: ICC.1:2022, 7 and 10."""

import struct

_OTHERS = ("Display P3", "Adobe RGB", "ProPhoto", "Rec. 2020", "Rec2020", "BT.2020", "DCI", "Dot Gain", "Gray Gamma")
"""Names of profiles that messages show: others may hold anything."""

_PRIMARIES = {
    b"rXYZ": (0.4360, 0.2225, 0.0139),
    b"gXYZ": (0.3851, 0.7169, 0.0971),
    b"bXYZ": (0.1431, 0.0606, 0.7141),
}
"""Of sRGB, adapted to D50."""

_CURVE = {0.25: 0.0509, 0.5: 0.2140, 0.75: 0.5225}
"""Code values -> linear light, in sRGB."""

_TOLERANCE = 0.0025


def check_profile(profile: bytes) -> None:
    """Check that an ICC profile has the primaries and the curve of sRGB; of grey, its curve.

    Raises
    ------
    ValueError
        It has others.
    """
    try:
        (count,) = struct.unpack_from(">I", profile, 128)
        entries = (struct.unpack_from(">4sII", profile, 132 + 12 * number) for number in range(min(count, 100)))
        tags = {name: profile[begin : begin + size] for name, begin, size in entries}
        primaries = {} if profile[16:20] == b"GRAY" else _PRIMARIES
        stated = [struct.unpack_from(">3i", tags[name], 8) for name in primaries]
        differences = [
            abs(number / 65536 - wanted)
            for numbers, own in zip(stated, primaries.values(), strict=True)
            for number, wanted in zip(numbers, own, strict=True)
        ]
        curves = [tags[name] for name in ((b"rTRC", b"gTRC", b"bTRC") if primaries else (b"kTRC",))]
        differences += [abs(_light(curve, code) - light) for curve in curves for code, light in _CURVE.items()]
        is_srgb = max(differences) < _TOLERANCE
    except (struct.error, KeyError, IndexError):
        is_srgb = False
    if not is_srgb:
        texts = profile.replace(b"\0", b"")
        name = next((name for name in _OTHERS if name.encode() in texts), "another one than sRGB")
        raise ValueError(f"its colour profile is {name}, and colours are read as sRGB")


def _light(curve: bytes, code: float) -> float:
    """Linear light of a code value well above black, by a tag of type ``curv`` or ``para``."""
    if curve[:4] == b"para":
        kind, gamma = struct.unpack_from(">H2xi", curve, 8)
        more = [number / 65536 for number in struct.unpack_from(f">{(0, 2, 3, 4, 6)[kind]}i", curve, 16)]
        scale, shift = more[:2] or (1.0, 0.0)
        offset = {2: more[2:3], 4: more[4:5]}.get(kind) or [0.0]
        return max(scale * code + shift, 0.0) ** (gamma / 65536) + offset[0]
    (count,) = struct.unpack_from(">I", curve, 8)
    if count < 2:
        return code ** (struct.unpack_from(">H", curve, 12)[0] / 256 if count else 1.0)
    values = struct.unpack_from(f">{min(count, 1 << 16)}H", curve, 12)
    place = code * (len(values) - 1)
    low = min(int(place), len(values) - 2)
    return (values[low] + (place - low) * (values[low + 1] - values[low])) / 65535
