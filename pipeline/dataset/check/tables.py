"""The tables of a dataset against the same made again from its records, value by value."""

import json
from pathlib import Path

from ...errors import InputError
from ...files.content import read_content
from ...files.temporary import temporary_folder, writing_temporary
from ...surface.mesh import TriangleMesh
from ..dataset_file import Description
from ..layout import SCENE_TABLES, TARGETS, scene_count, scene_folder
from ..tables.bop import write_camera
from ..tables.pose_tables import POSE_TABLE_COLUMNS
from ..tables.view_tables import write_view_tables
from .comparison import RELATIVE, numbers_of, read_rows, read_table, require_equal, shortened
from .findings import Findings

KIND = "tables that disagree"
SINGLE = 1e-6
"""Relative error of what is computed from the model, whose coordinates are stored in single precision."""


def check_tables(
    root: Path, description: Description, mesh: TriangleMesh, finest_scale: float, findings: Findings
) -> None:
    """Compare the tables that exist; all records have been read, and ``finest_scale`` is that of their depth images."""
    scenes = map(scene_folder, range(scene_count(description.count)))
    names = [f"{scene}/{table}" for scene in scenes for table in SCENE_TABLES]
    names += ["camera.json", "poses.csv", "transforms.json", TARGETS]
    scale = _depth_scale(root, finest_scale)
    with temporary_folder() as again:
        with writing_temporary():
            write_camera(again, description.camera, scale)
            write_view_tables(root, description, bounds=mesh.bounds, depth_scale=scale, out=again)
        for name in names:
            if (root / name).is_file():  # else its sum has told
                with findings.collecting(KIND):
                    _compare(root, again, name)


def _depth_scale(root: Path, finest: float) -> float:
    """That of ``camera.json``, which is at most the finest of a view; else this one."""
    try:
        scale = read_table(root, "camera.json")["depth_scale"]
        return float(scale) if 0 < scale <= finest else finest
    except (InputError, KeyError, TypeError):
        return finest


def _compare(root: Path, again: Path, name: str) -> None:
    if read_content(root / name, "a table of the dataset", name) == (again / name).read_bytes():
        return
    if name == "poses.csv":
        _compare_rows(root, again, name)
        return
    found, expected = read_table(root, name), json.loads((again / name).read_text())
    if name == "transforms.json" and isinstance(found, dict):
        for key in ("scale", "offset"):
            require_equal(found.get(key), expected[key], f"{name}: {key}", relative=SINGLE)
            expected[key] = found[key]
    require_equal(found, expected, name, relative=RELATIVE)


def _compare_rows(root: Path, again: Path, name: str) -> None:
    expected = read_rows(again, name, [*POSE_TABLE_COLUMNS])
    number = -1
    for number, row in enumerate(read_rows(root, name, [*POSE_TABLE_COLUMNS])):
        here, other = f"{name}: row {number}", next(expected, None)
        if other is None or row[:2] != other[:2]:
            raise InputError(f"{here}: expected {other and other[:2]}, found {shortened(row[:2])}")
        for part in (slice(2, 11), slice(11, 14), slice(14, None)):
            require_equal(numbers_of(row[part], here), numbers_of(other[part], here), here, relative=RELATIVE)
    if next(expected, None) is not None:
        raise InputError(f"{name}: expected a row for each view, found {number + 1}")
