"""Finds the camera in a table of keys and values, under the names that calibration programs use.

The table is the content of JSON, TOML, YAML or a dictionary of arrays: dictionaries, lists, numbers and strings.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError

MATRICES = ("k", "cameramatrix", "intrinsics", "intrinsic", "intrinsicmatrix", "cameraintrinsics", "camk", "mtx")
PARTS = {"fx": ("fx", "flx"), "fy": ("fy", "fly"), "cx": ("cx", "ppx"), "cy": ("cy", "ppy")}
SIDES = (("width", "height"), ("imagewidth", "imageheight"), ("canvaswidth", "canvasheight"), ("w", "h"))
SIZES = ("size", "resolution", "imagesize", "imgsize")
DISTORTIONS = ("distortion", "distortioncoefficients", "distortioncoeffs", "distcoeffs", "dist", "coeffs", "d")
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
MODELS = ("distortionmodel", "cameramodel", "model")
OTHER_MODELS = ("fisheye", "equidistant", "kannala", "inverse", "thin", "fov", "omni", "mei", "sphere", "theta")
"""Substrings of the names of distortion models other than OpenCV's for the pinhole camera."""

MOST_NUMBERS = 100
"""Of a list; no K, size or distortion has more."""

LONGEST_NAME = 60
"""Characters of a key or a model's name that messages show."""


@dataclass(frozen=True)
class Calibration:
    """The calibration of a camera as a file states it, unchecked.

    Attributes
    ----------
    place
        Keys that lead to it, joined by dots, such as ``"left"``.
    matrix
        K, ``(3, 3)``.
    size
        (width, height) or ``None``.
    distortion
        Coefficients in OpenCV's order; empty if there are none.
    pixel_origin
        "center", "corner", or ``None`` where the file does not say.
    messages
        What was corrected.
    """

    place: str
    matrix: np.ndarray
    size: tuple[float, float] | None
    distortion: tuple[float, ...]
    pixel_origin: str | None
    messages: tuple[str, ...] = ()

    def same_as(self, other: "Calibration") -> bool:
        """Whether both are equal except for their place."""
        same = (self.size, self.distortion) == (other.size, other.distortion)
        return same and self.pixel_origin == other.pixel_origin and np.array_equal(self.matrix, other.matrix)


def calibration_of(table: object, where: str) -> Calibration:
    """The one camera in a table, at any depth; several are accepted if they are the same.

    Raises
    ------
    InputError
        No camera, several that differ, or one with a distortion model other than OpenCV's.
    """
    found: list[Calibration] = []
    others = 0
    for each in _calibrations(table, (), (), where):
        if not found or not each.same_as(found[0]):
            others += bool(found)
            found = [*found, each][:4]
    if not found:
        raise InputError(
            f"{where}: expected a camera, found no K (or camera_matrix, intrinsics, cam_K) of 3x3 numbers "
            "and no fx, fy, cx, cy; export the intrinsics again"
        )
    if others:
        places = ", ".join(repr(each.place) for each in found)
        raise InputError(
            f"{where}: expected one camera, found {others + 1} that differ: {places}; "
            "leave only the frame's camera in the file"
        )
    return found[0]


def _calibrations(
    table: object, path: tuple[str, ...], outer: tuple[Mapping, ...], where: str
) -> Iterator[Calibration]:
    """All calibrations, depth first; ``outer`` are the enclosing tables, innermost first, which may hold the size."""
    if isinstance(table, list) and len(table) < 100_000:
        table = {str(index): entry for index, entry in enumerate(table) if isinstance(entry, Mapping | list)}
    if not isinstance(table, Mapping) or not table:
        return
    keys = {_plain_key(key): value for key, value in table.items()}
    scopes = (keys, *outer)
    matrix, messages = _matrix(keys)
    if matrix is not None:
        place = ".".join(path)
        distortion = _distortion(scopes, f"{where}: {place}" if place else where)
        yield Calibration(place, matrix, _size(scopes), distortion, _pixel_origin(scopes), messages)
        return
    for key, value in table.items():
        if isinstance(value, Mapping | list):
            yield from _calibrations(value, (*path, str(key)[:LONGEST_NAME]), scopes, where)


def _plain_key(key: object) -> str:
    return str(key).lower().replace("_", "").replace("-", "").replace(" ", "")


def _numbers(value: Any) -> list[float] | None:
    """The numbers in a list, in nested lists, or in OpenCV's ``{rows, cols, data}``, flattened; else ``None``."""
    if isinstance(value, Mapping):
        value = value.get("data")
    if not isinstance(value, list):
        return None
    numbers: list[float] = []
    for part in value:
        is_number = isinstance(part, int | float) and not isinstance(part, bool)
        found = [part] if is_number else _numbers(part)
        if found is None or len(numbers) + len(found) > MOST_NUMBERS:
            return None
        numbers += found
    return numbers


def _number(value: Any) -> float | None:
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    try:
        return float(value)
    except OverflowError:
        return None


def _matrix(keys: Mapping[str, Any]) -> tuple[np.ndarray | None, tuple[str, ...]]:
    for name in MATRICES:
        numbers = _numbers(keys.get(name))
        if numbers is not None and len(numbers) == 9:
            try:
                matrix = np.array(numbers, dtype=np.float64).reshape(3, 3)
            except OverflowError:
                return None, ()
            if not matrix[:2, 2].any() and matrix[2, :2].any() and matrix[2, 2] == 1:
                return matrix.T, ("the file holds K transposed (column by column); it was transposed back",)
            return matrix, ()
    parts = [next((keys[name] for name in names if name in keys), None) for names in PARTS.values()]
    fx, fy, cx, cy = (_number(part) for part in parts)
    if fx is None or cx is None or cy is None:
        return None, ()
    return np.array([[fx, 0, cx], [0, fx if fy is None else fy, cy], [0, 0, 1]]), ()


def _size(scopes: tuple[Mapping[str, Any], ...]) -> tuple[float, float] | None:
    for keys in scopes:
        for names in SIDES:
            width, height = (_number(keys.get(name)) for name in names)
            if width is not None and height is not None:
                return width, height
        for name in SIZES:
            numbers = _numbers(keys.get(name))
            if numbers is not None and len(numbers) == 2:
                return numbers[0], numbers[1]
    return None


def _distortion(scopes: tuple[Mapping[str, Any], ...], where: str) -> tuple[float, ...]:
    for keys in scopes:
        numbers = next((found for name in DISTORTIONS if (found := _numbers(keys.get(name)))), None)
        if numbers is None and "k1" in keys:
            numbers = [_number(keys.get(name, 0.0)) or 0.0 for name in COEFFICIENTS]
        if not numbers or not any(numbers):
            continue
        for name in MODELS:
            model = _text(keys.get(name, "")).lower()
            if any(other in model for other in OTHER_MODELS):
                raise InputError(
                    f"{where}: expected OpenCV's distortion [k1, k2, p1, p2, k3], found the model {model!r}; "
                    "undistort the frame with the program that calibrated it, and give the K of the result"
                )
        return tuple(numbers)
    return ()


def _pixel_origin(scopes: tuple[Mapping[str, Any], ...]) -> str | None:
    stated = next((keys["pixelorigin"] for keys in scopes if "pixelorigin" in keys), None)
    if stated is not None:
        return _text(stated)
    # NeRF's transforms.json
    return "corner" if "flx" in scopes[0] else None


def _text(value: object) -> str:
    """The beginning of a text, or what there is in its place."""
    return value[:LONGEST_NAME] if isinstance(value, str) else f"a {type(value).__name__}"
