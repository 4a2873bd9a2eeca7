"""Finds the camera in a table of keys and values, under the names that calibration programs use.

The table is the content of JSON, TOML, YAML or a dictionary of arrays: dictionaries, lists, numbers and strings.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from .distortion_table import distortion_of
from .table_values import LONGEST_NAME, number_of, numbers_of, plain_key, text_of

MATRICES = ("k", "cameramatrix", "intrinsics", "intrinsic", "intrinsicmatrix", "cameraintrinsics", "camk", "mtx")
PARTS = {"fx": ("fx", "flx"), "fy": ("fy", "fly"), "cx": ("cx", "ppx"), "cy": ("cy", "ppy")}
ANGLE = "cameraanglex"
SIDES = (("width", "height"), ("imagewidth", "imageheight"), ("canvaswidth", "canvasheight"), ("w", "h"))
SIZES = ("size", "resolution", "imagesize", "imgsize")
MATLAB = ("RadialDistortion", "TangentialDistortion")
"""Keys beside K that tell MATLAB's cameraParameters: pixels count from 1, and sizes are (rows, columns)."""


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
        No camera, several that differ, or one as :func:`.distortion_of` refuses it.
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
            "and no fx, fy, cx, cy (or camera_angle_x, w, h); export the intrinsics again"
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
    """All calibrations, depth first; ``outer`` are the enclosing tables, innermost first, without their cameras."""
    if isinstance(table, list) and len(table) < 100_000:
        table = {str(index): entry for index, entry in enumerate(table) if isinstance(entry, Mapping | list)}
    if not isinstance(table, Mapping) or not table:
        return
    matrix, messages = _matrix(_plain(table))
    if matrix is not None:
        place, tables = ".".join(path), (table, *outer)
        distortion = distortion_of(tables, f"{where}: {place}" if place else where)
        scopes = tuple(map(_plain, tables))
        size = _size(scopes)
        if all(key in table for key in MATLAB):
            matrix = matrix - [[0, 0, 1], [0, 0, 1], [0, 0, 0]]
            size = size and size[::-1]
            messages = (*messages, "MATLAB counts pixels from 1; the principal point was moved to count from 0")
        yield Calibration(place, matrix, size, distortion, _pixel_origin(scopes), messages)
        return
    around = ({key: value for key, value in table.items() if not _holds_camera(value)}, *outer)
    for key, value in table.items():
        if isinstance(value, Mapping | list):
            yield from _calibrations(value, (*path, str(key)[:LONGEST_NAME]), around, where)


def _plain(table: Mapping) -> dict[str, Any]:
    return {plain_key(key): value for key, value in table.items()}


def _holds_camera(value: object) -> bool:
    if isinstance(value, Mapping) and _matrix(_plain(value))[0] is not None:
        return True
    parts = value.values() if isinstance(value, Mapping) else value if isinstance(value, list) else ()
    return any(_holds_camera(part) for part in parts if isinstance(part, Mapping | list))


def _matrix(keys: Mapping[str, Any]) -> tuple[np.ndarray | None, tuple[str, ...]]:
    for name in MATRICES:
        numbers = numbers_of(keys.get(name))
        if numbers is not None and len(numbers) == 9:
            try:
                matrix = np.array(numbers, dtype=np.float64).reshape(3, 3)
            except OverflowError:
                return None, ()
            if not matrix[:2, 2].any() and matrix[2, :2].any() and matrix[2, 2] == 1:
                return matrix.T, ("the file holds K transposed (column by column); it was transposed back",)
            return matrix, ()
    parts = [next((keys[name] for name in names if name in keys), None) for names in PARTS.values()]
    fx, fy, cx, cy = (number_of(part) for part in parts)
    if fx is None and (fx := _focal_of_angle(keys, ANGLE, "w")) is not None:
        # NeRF's transforms.json, whose readers take square pixels and the middle
        fy = _focal_of_angle(keys, "cameraangley", "h") if fy is None else fy
        cx, cy = (_half(keys, side) if at is None else at for side, at in (("w", cx), ("h", cy)))
    kalibr = numbers_of(keys.get("intrinsics"))
    if keys.get("cameramodel") == "pinhole" and kalibr is not None and len(kalibr) == 4:
        fx, fy, cx, cy = kalibr
    if fx is None or cx is None or cy is None:
        return None, ()
    return np.array([[fx, 0, cx], [0, fx if fy is None else fy, cy], [0, 0, 1]]), ()


def _half(keys: Mapping[str, Any], side: str) -> float | None:
    pixels = number_of(keys.get(side))
    return None if pixels is None else pixels / 2


def _focal_of_angle(keys: Mapping[str, Any], name: str, side: str) -> float | None:
    angle, half = number_of(keys.get(name)), _half(keys, side)
    return None if half is None or angle is None or not 0 < angle < math.pi else half / math.tan(angle / 2)


def _size(scopes: tuple[Mapping[str, Any], ...]) -> tuple[float, float] | None:
    for keys in scopes:
        for names in SIDES:
            width, height = (number_of(keys.get(name)) for name in names)
            if width is not None and height is not None:
                return width, height
        for name in SIZES:
            numbers = numbers_of(keys.get(name))
            if numbers is not None and len(numbers) == 2:
                return numbers[0], numbers[1]
    return None


def _pixel_origin(scopes: tuple[Mapping[str, Any], ...]) -> str | None:
    stated = next((keys["pixelorigin"] for keys in scopes if "pixelorigin" in keys), None)
    if stated is not None:
        return text_of(stated)
    # NeRF's transforms.json
    return "corner" if {"flx", ANGLE} & scopes[0].keys() else None
