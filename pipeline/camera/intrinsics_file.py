"""Camera intrinsics from the files of calibration programs, or as a user types them, checked.

K and the distortion are found under the names that the formats have. A distortion that is overlooked moves every
projected point, and nothing shows it. So each key about a lens is read, or says that there is no distortion, or is
refused by its name.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..files.content import LARGEST_TEXT, read_content
from ..files.keys import described, file_and_place
from ..files.numbers import number_rows
from .calibration_content import content_table
from .distortion import Distortion, checked_distortion
from .pinhole import PinholeCamera

_ANY_SIZE = (65536, 65536)
"""Stands for an unknown size in the check of K; the largest that the check accepts."""
MATRICES = ("k", "cameramatrix", "intrinsicmatrix", "intrinsics", "camk")
SIZES = (("width", "height"), ("imagewidth", "imageheight"), ("w", "h"))
PAIRS = ("size", "resolution", "imagesize")
LISTS = re.compile(r"d|dist(ortion)?(coeff(icient)?s?|parameters)?")
"""Of coefficients in OpenCV's order."""
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3")
MODELS = ("", "none", "pinhole", "perspective", "plumbbob", "radtan", "radialtangential", "brownconrady", "opencv")
"""What a model of a lens may be called; ROS and Kalibr name theirs."""
LENS = re.compile(
    r"dist(?!ance)|radial|tangential|coeff|kappa|fish|omni|lens|skew|model|kannala|polynom|^(kc|k[1-6]|p[12]|xi|s[1-4])$"
)
NO_LENS = re.compile(r"error|std|flags|^num|cameraname|rectif|model(name|id)$|undist")
"""Keys that speak of a lens and bend no ray."""
PART = re.compile(
    r"^[ar]oi|roi$|regionof|window|crop|binning|decimat|(sub|down)s(ampl|cal)|offset([xy]|left|top)$|^[xy]offset$"
)
FEWER = re.compile(r"binning|decimat|(sub|down)s(ampl|cal)")
"""Keys that say that the image is a part of what K is for, or has fewer pixels; of the latter, 1 says nothing."""
CAMERA = re.compile(r"(^|\.)(f|[fc][xy]|pp[xy]|k)$|focal|principal|intrinsic|matrix|projection")
"""Keys that speak of K, under whatever name."""
MOST_NUMBERS, LONGEST = 100, 60
"""Numbers of a list; letters of a key that messages show."""


@dataclass(frozen=True)
class CameraFile:
    """The intrinsics read from a file.

    Attributes
    ----------
    path
        The file.
    fx, fy, cx, cy
        Pixels; (0, 0) is the centre of the top-left pixel.
    size
        (width, height) of the images that K is for; ``None`` if the file does not say.
    distortion
        k1, k2, p1, p2, k3; ``None`` if there is none.
    """

    path: Path
    fx: float
    fy: float
    cx: float
    cy: float
    size: tuple[int, int] | None
    distortion: tuple[float, float, float, float, float] | None

    @classmethod
    def of_matrix(
        cls,
        path: Path,
        matrix: object,
        size: Sequence[float] | None,
        distortion: tuple[float, ...],
        pixel_origin: Any = "center",
        *,
        where: str,
    ) -> "CameraFile":
        """Check what a file or a user states; ``where`` begins messages."""
        wh: Any = _ANY_SIZE if size is None else size
        camera = PinholeCamera.from_matrix(matrix, size=wh, pixel_origin=pixel_origin, where=where)
        centre, stated = (camera.cx, camera.cy), None if size is None else camera.size_wh
        return cls(path, camera.fx, camera.fy, *centre, stated, distortion or None)  # type: ignore[arg-type]

    def same_as(self, other: "CameraFile") -> bool:
        """Whether both state the same camera."""
        own, theirs = ([each.fx, each.fy, each.cx, each.cy] for each in (self, other))
        return (self.size, self.distortion) == (other.size, other.distortion) and np.allclose(own, theirs, rtol=1e-6)

    def camera(self, size_wh: tuple[int, int]) -> PinholeCamera:
        """The camera with this K, unchanged, for images of (width, height); see :mod:`oneframe.camera.plausibility`."""
        k = [[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]]
        return PinholeCamera.from_matrix(k, size=size_wh, where=f"{self.path.name}: K")

    def distortion_for(self, camera: PinholeCamera) -> Distortion | None:
        """The distortion for a camera of this file, ``None`` if there is none."""
        if self.distortion is None:
            return None
        return checked_distortion(self.distortion, camera, f"{self.path.name}: distortion")


def read_camera(path: Path) -> CameraFile:
    """Read intrinsics from any of the formats of :mod:`.calibration_content`.

    Of a file with several cameras, the key of one may stand after #: that of an image in BOP's ``scene_camera.json``,
    ``camera 3`` of COLMAP's ``cameras.txt``.
    """
    path, place = file_and_place(Path(path))
    content: Any = content_table(read_content(path, "a file with a camera", most=LARGEST_TEXT), path)
    if place and not (isinstance(content, dict) and place in content):
        raise InputError(f"{path.name}: expected a camera {place!r} in it, found none; write the key of one after #")
    return _the_camera(content[place] if place else content, path)


def _the_camera(table: object, path: Path) -> CameraFile:
    """The one camera in a table, at any depth; several are accepted if they are the same."""
    found = list(_cameras(table, (), {}, path))
    if not found:
        keys = list(_all_keys(table))
        seen = [key for key in keys if CAMERA.search(_plain(key))] or keys
        raise InputError(
            f"{path.name}: expected a camera: K, camera_matrix or cam_K of 3x3 numbers, or fx, fy, cx, cy; found "
            f"{', '.join(seen[:8]) or 'a list'}; write K in pixels, for the frame as it is, under one of these names"
        )
    (place, camera), *others = found
    if differing := [each for each, other in others if not camera.same_as(other)]:
        places = ", ".join(map(repr, (place, *differing[:3])))
        raise InputError(
            f"{path.name}: expected one camera, found {len(differing) + 1} that differ: {places}; "
            "write which after #, or leave only the frame's camera in the file"
        )
    return camera


def _cameras(table: object, keys: tuple[str, ...], around: Mapping, path: Path) -> Iterator[tuple[str, CameraFile]]:
    """All cameras with their places, depth first; ``around`` is what the enclosing tables hold beside cameras."""
    if not isinstance(table, Mapping):
        return
    own = _plain_keys(table)
    matrices = _matrices(own)
    if matrices:
        place, scope = ".".join(keys), {**around, **table}
        said, of_scope = f"{path.name}: {place}" if place else path.name, _plain_keys(scope)
        size = _size(of_scope)
        _check_whole(scope, size, said)
        distortion = _distortion(scope, said)
        # NeRF's transforms.json counts from the corner
        origin = str(own.get("pixelorigin", "corner" if "flx" in own else "center"))[:LONGEST]
        for name, matrix in matrices.items():
            yield (
                ".".join((*keys, name)) if len(matrices) > 1 else place,
                CameraFile.of_matrix(path, matrix, size, distortion, origin, where=f"{said}: K"),
            )
        return
    around = {**around, **{key: value for key, value in table.items() if not _holds_camera(value)}}
    for key, value in table.items():
        yield from _cameras(value, (*keys, str(key)[:LONGEST]), around, path)


def _holds_camera(value: object) -> bool:
    if not isinstance(value, Mapping):
        return False
    return bool(_matrices(_plain_keys(value))) or any(map(_holds_camera, value.values()))


def _all_keys(table: object) -> Iterator[str]:
    """Keys at any depth, those of the table itself first."""
    if isinstance(table, Mapping):
        yield from (str(key)[:LONGEST] for key in table)
        table = list(table.values())
    for part in table if isinstance(table, list) else ():
        yield from _all_keys(part)


def _check_whole(table: Mapping, size: tuple[float, float] | None, where: str) -> None:
    """Refuse a K for more than the image shows: ROS, for one, states that of the whole sensor beside a window of it."""
    whole = {} if size is None else dict(zip(("width", "height"), size, strict=True))
    for key, value in table.items():
        if not PART.search(_plain(key)):
            continue
        for name, part in (_plain_keys(value) if isinstance(value, Mapping) else {_plain(key): value}).items():
            nothing = {None, 0.0, 1.0 if FEWER.search(name) else 0.0, whole.get(name)}
            if not {_number(part), *(_numbers(part) or ())} <= nothing:
                raise InputError(
                    f"{where}: expected the K of the image itself, found {str(key)[:LONGEST]}: the image is a part of "
                    "what K is for, or has fewer pixels; subtract the offset of the part from cx and cy, divide K by "
                    "the binning, and write that K, with the image's width and height, without this key"
                )


def _plain_keys(table: Mapping) -> dict[str, Any]:
    return {_plain(key): value for key, value in table.items()}


def _plain(key: object) -> str:
    """A key without case, spaces, hyphens and underscores."""
    return re.sub(r"[\s_-]", "", str(key)).lower()


def _number(value: Any) -> float | None:
    """A number, also where it is written as text; else ``None``."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        return float(value)
    except (OverflowError, ValueError):
        return None


def _numbers(value: Any) -> list[float] | None:
    """The numbers in lists, in OpenCV's ``{rows, cols, data}`` or in a text, flattened; else ``None``."""
    if isinstance(value, Mapping):
        value = value.get("data")
    if isinstance(value, str):
        # ROS writes lists without commas
        rows = number_rows(value) if any(sign.isdigit() for sign in value) else None
        return None if rows is None or not 1 < len(rows) <= MOST_NUMBERS else rows.tolist()
    if not isinstance(value, list):
        return None
    numbers: list[float] = []
    for part in value:
        number = _number(part)
        inner = [number] if number is not None else _numbers(part)
        if inner is None or len(numbers) + len(inner) > MOST_NUMBERS:
            return None
        numbers += inner
    return numbers


def _matrices(keys: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Each ``(3, 3)`` K that a table states, by the key that holds it."""
    stated = {name: numbers for name in MATRICES if len(numbers := _numbers(keys.get(name)) or ()) == 9}
    kalibr = _numbers(keys.get("intrinsics"))
    parts = [_number(keys.get(name, keys.get(other))) for name, other in (("fx", "flx"), ("fy", "fly"))]
    parts += [_number(keys.get(name)) for name in ("cx", "cy")]
    focal = {"intrinsics": kalibr} if keys.get("cameramodel") == "pinhole" and len(kalibr or ()) == 4 else {}
    if None not in parts:
        focal["fx"] = parts  # type: ignore[assignment]
    stated |= {name: [fx, 0, cx, 0, fy, cy, 0, 0, 1] for name, (fx, fy, cx, cy) in focal.items()}  # type: ignore[misc]
    return {name: np.array(numbers, dtype=np.float64).reshape(3, 3) for name, numbers in stated.items()}


def _size(keys: Mapping[str, Any]) -> tuple[float, float] | None:
    stated = [*([keys.get(name) for name in names] for names in SIZES), *map(keys.get, PAIRS)]
    pairs = (numbers for numbers in map(_numbers, stated) if numbers is not None and len(numbers) == 2)
    return next(((width, height) for width, height in pairs), None)


def _distortion(table: Mapping, where: str) -> tuple[float, ...]:
    """The coefficients beside K, in OpenCV's order; empty if there are none."""
    found: dict[str, float] = {}
    for key, value in table.items():
        plain, numbers, number = _plain(key), _numbers(value), _number(value)
        is_nothing = value in (None, False) or number == 0 or (numbers is not None and not any(numbers))
        # coefficients, where it is no K
        is_list = plain == "k" and (numbers is None or len(numbers) != 9)
        if not (LENS.search(plain) or LISTS.fullmatch(plain) or is_list):
            continue
        if is_nothing or NO_LENS.search(plain) or (plain == "d" and isinstance(value, str) and numbers is None):
            continue
        if isinstance(value, str) and numbers is None and number is None:
            if _plain(value) not in MODELS:
                raise _unread(where, key, value)
            continue
        if plain in COEFFICIENTS and number is not None:
            given = {plain: number}
        elif LISTS.fullmatch(plain) and numbers is not None and len(numbers) in (4, 5, 8, 12, 14):
            if any(numbers[5:]):
                raise _unread(where, key, numbers)
            given = dict(zip(COEFFICIENTS, numbers, strict=False))
        elif LISTS.fullmatch(plain) and isinstance(value, Mapping) and {*map(_plain, value)} <= {*COEFFICIENTS}:
            given = dict(zip(COEFFICIENTS, _distortion(value, where), strict=False))
        else:
            raise _unread(where, key, value)
        if differing := [name for name in given if name in found and found[name] != given[name]]:
            raise InputError(f"{where}: expected one distortion, found two {differing[0]}; leave one in the file")
        found |= given
    coefficients = tuple(found.get(name, 0.0) for name in COEFFICIENTS)
    return coefficients if any(coefficients) else ()


def _unread(where: str, key: object, value: object) -> InputError:
    return InputError(
        f"{where}: expected OpenCV's distortion [k1, k2, p1, p2, k3], found {str(key)[:LONGEST]} = {described(value)}; "
        "undistort the frame with the program that calibrated it, and give the K of the result; if the key bends no "
        "ray, remove it"
    )
