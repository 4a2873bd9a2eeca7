"""The content of a camera's file as dictionaries, lists, numbers and strings.

The format is told by content: a case file or other TOML, JSON (K or fx, fy, cx, cy; BOP's ``camera.json`` and
``scene_camera.json``, NeRF's ``transforms.json``), YAML of OpenCV, ROS and Kalibr, COLMAP's
``cameras.txt``. Anything else is refused.
"""

import re
from functools import lru_cache
from pathlib import Path

from ..errors import InputError
from ..files.content import decoded
from ..files.numbers import number_rows
from ..files.tables import parsed_json, parsed_toml

FORMATS = "JSON, a case file, YAML of OpenCV, ROS or Kalibr, COLMAP's cameras.txt"
COLMAP_PARAMETERS = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
}
"""Parameters of COLMAP's camera models, in the order of its files (src/colmap/sensor/models.h)."""


# a scene of BOP has a camera an image
@lru_cache(maxsize=1)
def content_table(data: bytes, path: Path) -> object:
    """The content of a file; another kind of file, or a damaged one, is an ``InputError``."""
    name, suffix, text = path.name, path.suffix.lower(), decoded(data)
    if text is None or (begin := text.lstrip()).startswith("<"):
        raise _unknown_format(name)
    # JSON is YAML, too; lists of YAML begin alike
    if begin.startswith("{") and suffix not in (".yaml", ".yml"):
        return parsed_json(text, name)
    if re.search(r"^[ \t]*\[camera\]", text, re.MULTILINE) or suffix == ".toml":
        return parsed_toml(text, name)
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if lines and all(re.match(r"\s*\d+\s+[A-Z_]+\s+\d+\s+\d+\s", line) for line in lines):
        return _colmap(lines, name)
    try:
        # a stock Blender has no PyYAML
        from .yaml_table import yaml_table
    except ModuleNotFoundError:
        raise InputError(
            f"{name}: expected the package PyYAML, which reads YAML, this Python has none; install OneFrame with "
            "pip, use a Blender in which the OneFrame extension is enabled, or write K as JSON"
        ) from None
    table = yaml_table(text, name)
    if not isinstance(table, dict):  # any text is YAML
        raise _unknown_format(name)
    return table


def _unknown_format(name: str) -> InputError:
    return InputError(
        f"{name}: expected a camera ({FORMATS}), found another kind of file; write its numbers as JSON: "
        '{"fx": …, "fy": …, "cx": …, "cy": …, "width": …, "height": …}'
    )


def _colmap(lines: list[str], name: str) -> object:
    """The cameras of ``cameras.txt``; COLMAP has (0, 0) at the corner of the top-left pixel."""
    cameras: dict[str, object] = {}
    for line in lines:
        number, model, width, height, *words = line.split()
        if model not in COLMAP_PARAMETERS:
            raise InputError(
                f"{name}: expected a COLMAP camera of model {', '.join(COLMAP_PARAMETERS)}, found {model}; "
                "undistort the images with COLMAP's image_undistorter, and give the camera of the result"
            )
        names = COLMAP_PARAMETERS[model]
        numbers = number_rows(" ".join(words))
        if numbers is None or len(numbers) != len(names):
            raise InputError(f"{name}: expected {len(names)} numbers for {model}, found {len(words)}")
        values = dict(zip(names, numbers.tolist(), strict=True))
        focal = values.pop("f", 0.0)
        size = {"width": float(width), "height": float(height), "pixel_origin": "corner"}
        cameras[f"camera {number}"] = {"fx": focal, "fy": focal, **values, **size}
    return cameras
