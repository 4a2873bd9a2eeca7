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

_MIDDLE = 0.2140
"""Linear light of the middle code value."""

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
        differences += [abs(_middle(curve) - _MIDDLE) for curve in curves]
        is_srgb = max(differences) < _TOLERANCE
    except (struct.error, KeyError, IndexError):
        is_srgb = False
    if not is_srgb:
        texts = profile.replace(b"\0", b"")
        name = next((name for name in _OTHERS if name.encode() in texts), "another one than sRGB")
        raise ValueError(f"its colour profile is {name}, and colours are read as sRGB")


def _middle(curve: bytes) -> float:
    """Linear light of the middle code value, by a tag ``curv`` with a table, or ``para`` with a straight part."""
    (count,) = struct.unpack_from(">I", curve, 8)
    if curve[:4] == b"curv" and count > 2:
        below, above = struct.unpack_from(">2H", curve, 12 + 2 * ((count - 1) // 2))
        return (below if count % 2 else (below + above) / 2) / 65535
    gamma, scale, shift = (number / 65536 for number in struct.unpack_from(">3i", curve, 12))
    return float((scale / 2 + shift) ** gamma) if curve[:4] == b"para" and count >> 16 == 3 else 0.0
