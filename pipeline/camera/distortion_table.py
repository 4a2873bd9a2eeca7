"""Finds the distortion that goes with K in a table, and refuses what speaks of a lens in words that it cannot read.

A distortion that is overlooked moves every projected point, and nothing shows it. So each key about a lens is read, or
says that there is no distortion, or is an error.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from ..errors import InputError
from .table_values import LONGEST_NAME, number_of, numbers_of, plain_key

COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
"""In OpenCV's order, which lists of them have."""
LIST_LENGTHS = (4, 5, 8, 12, 14)
"""Lengths of OpenCV's lists of coefficients."""
BY_KIND = {"radial": ("k1", "k2", "k3", "k4", "k5", "k6"), "tangential": ("p1", "p2")}
"""What lists of one kind hold (MATLAB's among others)."""

_MODELS = (
    r"(camera|distortion|lens|projection|sensor|fisheye)?model(type|name)?|(camera|lens|projection)type|projection"
)
_BENDING = re.compile(
    r"dist(?!ance|rib)|radial|tangential|coeff|kappa|barrel|decent(er|re)|skew|"
    r"^(cam(era)?)?(d|kc?|k[1-6]|p[12]|s[1-4]|b[12]|tau[xy]|xi|alphac)$"
)
"""Keys of coefficients; ``k`` is one where it is no K."""
_LIST = re.compile(
    r"^(?!.*(poly|mapping|kappa|barrel|decent|inv|undist)).*(dist|(^|\.)(camera)?(d|kc|coeffs?|coefficients)(\.|$))"
)
"""Places of lists in OpenCV's order."""
_MATRIX_LENGTHS = {"k": 9, "camk": 9, "p1": 12, "p2": 12}
"""Numbers under keys of coefficients that are K and a stereo camera's projection instead."""
_LENS = re.compile(rf"{_BENDING.pattern}|fish|omni|equirect|lens|^({_MODELS})$")
_KIND = ("type", "kind", "name", "model")
"""In a table about a lens, keys that name its model."""
_OF_A_MATRIX = ("rows", "cols", "dt", "data")
"""Keys of OpenCV's matrices."""
_NO_PINHOLE = re.compile(r"(opencv)?fisheye|omni(directional)?|equidistant|equirectangular|kannalabrandt\d?|mei|ftheta")
"""What is no pinhole camera, whatever key says it."""
_ABOUT_NO_RAY = re.compile(
    r"undist(?!.*coeff)|error|std(?!ist)|deviation|sigma|^num|^estimate(?!d)|lens(position|aperture|focal|serial|mount)"
)
"""Keys that speak of a lens and bend no ray: what was removed, how it was found, how sure it is, its other values."""

_PINHOLE = (
    "pinhole", "simplepinhole", "perspective", "rectilinear", "plumbbob", "radtan", "radialtangential", "brown",
    "brownconrady", "opencv", "fullopencv", "rational", "rationalpolynomial", "radial", "simpleradial", "standard",
)  # fmt: skip
_PINHOLE_WITHOUT_COEFFICIENTS = ("inversebrownconrady", "modifiedbrownconrady", "thinprism", "division")
_NOTHING = ("", "none", "no", "false", "off", "null")


def distortion_of(tables: tuple[Mapping, ...], where: str) -> tuple[float, ...]:
    """The coefficients that go with K, in OpenCV's order; empty if there are none.

    Parameters
    ----------
    tables
        The table in which K was found, and those around it, innermost first, each without other cameras.
    where
        Begins messages.

    Raises
    ------
    InputError
        Another model than OpenCV's for the pinhole camera, two distortions, or a key about a lens that is not read.
    """
    found: dict[str, float] = {}
    further: list[float] = []
    models: list[tuple[str, str]] = []
    for key, value in (entry for table in tables for entry in _lens_entries(table, "")):
        plain, numbers = plain_key(key.rpartition(".")[2]), numbers_of(value)
        number = number_of(value)
        if value is None or value is False or number == 0 or (numbers is not None and not any(numbers)):
            continue
        if numbers is not None and _MATRIX_LENGTHS.get(plain) == len(numbers):
            continue
        if (isinstance(value, str) and numbers is None and number is None) or re.search("fish|omni|model", plain):
            models.append((key, str(value)))
            continue
        names = next((names for kind, names in BY_KIND.items() if kind in plain), None)
        if number is not None and plain in COEFFICIENTS:
            read = {plain: number}
        elif numbers is not None and names is not None and len(numbers) <= len(names):
            read = dict(zip(names, numbers, strict=False))
        elif numbers is not None and names is None and len(numbers) in LIST_LENGTHS and _LIST.search(plain_key(key)):
            read, further = dict(zip(COEFFICIENTS, numbers, strict=False)), numbers[len(COEFFICIENTS) :]
        else:
            raise _unread(where, key, value)
        if differing := [name for name in read if name in found and found[name] != read[name]]:
            raise InputError(f"{where}: expected one distortion, found two {differing[0]}; leave one in the file")
        found |= read
    coefficients = (*(found.get(name, 0.0) for name in COEFFICIENTS), *further)
    for key, model in models:
        name = re.sub(r"[^a-z0-9]", "", model.lower()).removeprefix("distortion")
        if name not in (*_PINHOLE, *_NOTHING) and (any(coefficients) or name not in _PINHOLE_WITHOUT_COEFFICIENTS):
            raise InputError(
                f"{where}: expected OpenCV's distortion [k1, k2, p1, p2, k3], found {key} = {model[:LONGEST_NAME]!r}; "
                "undistort the frame with the program that calibrated it, and give the K of the result; if this is no "
                "model of a lens, remove it"
            )
    return coefficients if any(coefficients) else ()


def _lens_entries(table: object, path: str, *, within: str = "") -> Iterator[tuple[str, Any]]:
    """Keys about a lens, with those that lead to them, and their values.

    ``within`` is the key about a lens that the table stands under: there names of models count, and under one of
    coefficients all numbers. What stands under such a key, and holds nothing of that, is an entry as a whole.
    """
    bending = bool(_BENDING.search(within))
    entries = table.items() if isinstance(table, Mapping) else enumerate(table) if isinstance(table, list) else ()
    for key, value in entries:
        if isinstance(table, list) and not bending and not isinstance(value, Mapping | list):
            continue
        is_container = isinstance(value, Mapping | list) and numbers_of(value) is None
        plain, place = plain_key(key), f"{path}{str(key)[:LONGEST_NAME]}"
        about_lens = bool(_LENS.search(plain)) and not _ABOUT_NO_RAY.search(plain)
        if isinstance(value, Mapping) and not is_container:
            further = {key: part for key, part in value.items() if key not in _OF_A_MATRIX}
            yield from _lens_entries(further, f"{place}.", within=plain if about_lens else within)
        if is_container:
            inside = list(_lens_entries(value, f"{place}.", within=plain if about_lens else within))
            yield from inside
            if value and not inside and about_lens and _BENDING.search(plain):
                yield place, value
        elif about_lens or (
            (within and plain in _KIND)
            or (bending and (isinstance(value, list | Mapping) or number_of(value) is not None))
            or (isinstance(value, str) and _NO_PINHOLE.fullmatch(plain_key(value)))
        ):
            yield place, value


def _unread(where: str, key: str, value: object) -> InputError:
    numbers = numbers_of(value)
    found = f"{len(numbers)} numbers" if numbers else repr(value)[:LONGEST_NAME]
    return InputError(
        f"{where}: expected OpenCV's distortion [k1, k2, p1, p2, k3], found {key} with {found}, which means nothing "
        "here; write the coefficients as distortion_coefficients, or remove the key if it bends no ray"
    )
