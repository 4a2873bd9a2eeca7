"""The folder that ``oneframe surface`` leaves: the names of its files, and its record, read strictly."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from ..errors import InputError
from ..files.content import LARGEST_FILE, read_content
from ..files.numbers import is_number
from ..files.outputs import made_folder, writing
from ..files.tables import parsed_json
from ..surface.mesh import Ball, TriangleMesh, ball_around
from ..surface.mesh_writer import safe_name, write_ply
from ..surface.structure_colour import structure_colour
from .case_file import Structure

SURFACE, RECORD, STRUCTURES = "surface.ply", "surface.json", "structures"

ADVICE = "run oneframe surface again, or give a mesh file"


@dataclass(frozen=True)
class SurfaceFolder:
    """A checked folder, or a mesh alone.

    Attributes
    ----------
    mesh
        The surface's file.
    structures
        With their names and colours, in the order of the labels.
    focus
        The ball around what was drilled, or else around the known structures; ``None`` if there was neither.
    is_lps
        Whether all meshes are in LPS, mm: those of a folder are.
    """

    mesh: Path
    structures: tuple[Structure, ...] = ()
    focus: Ball | None = None
    is_lps: bool = False

    def focus_of(self, mesh: TriangleMesh) -> Ball | None:
        """What an initial pose looks at: the focus or all of the surface (frame of its file), whose axes it needs."""
        return ball_around(mesh) if self.is_lps and self.focus is None else self.focus


def write_meshes(folder: Path, surface: TriangleMesh, structures: Mapping[str, TriangleMesh]) -> dict[str, Path]:
    """Write the surface and the structures in their colours; gives their files by name, the surface's as ``""``."""
    paths = {"": folder / SURFACE} | {name: folder / structure_file(name) for name in structures}
    for name, path in paths.items():
        mesh, shades = surface, None
        if name:
            mesh = structures[name]
            shade = np.rint(np.array(structure_colour(name)) * 255).astype(np.uint8)
            shades = np.tile(shade, (len(mesh.vertices), 1))
        with writing(made_folder(path)):
            write_ply(path, mesh, colours=shades, space="LPS")
    return paths


def structure_file(name: str) -> str:
    """The file of a structure, relative to the folder, with a name that every program reads."""
    return f"{STRUCTURES}/{safe_name(name)}.ply"


def focus_table(focus: Ball) -> dict[str, object]:
    """The part that matters, as the record holds it."""
    rounded = focus.rounded()
    return {"centre_mm": rounded.centre.tolist(), "radius_mm": rounded.radius_mm}


def read_surface_folder(folder: Path) -> SurfaceFolder:
    """Read the record of a folder."""
    path = folder / RECORD
    if not path.exists():
        raise InputError(
            f"{folder}: expected a folder of oneframe surface, or a mesh file; there is no {RECORD} in it; {ADVICE}"
        )
    data = read_content(path, "the report of a surface", str(path), most=LARGEST_FILE)
    record = parsed_json(data, str(path))
    if not (isinstance(record, dict) and record.keys() >= {"threshold_hu", "surface", "volume"}):
        raise InputError(f"{path}: expected the report of oneframe surface, found another file; {ADVICE}")
    surface = _table(record["surface"], f"{path}: surface")
    mesh = _file(folder, surface, f"{path}: surface")
    structures = []
    for name, value in _table(record.get("structures", {}), f"{path}: structures").items():
        if not name:
            raise InputError(f"{path}: structures: expected a name for each, found an empty one; {ADVICE}")
        where = f"{path}: structures: {name}"
        entry = _table(value, where)
        colour = _numbers(entry.get("colour"), 3, f"{where}: colour")
        if not all(0 <= part <= 1 for part in colour):
            raise InputError(f"{where}: colour: expected three numbers 0..1, found {colour}; {ADVICE}")
        structures.append(Structure(name, _file(folder, entry, where), (colour[0], colour[1], colour[2])))
    return SurfaceFolder(mesh, tuple(structures), _focus(record.get("focus"), f"{path}: focus"), is_lps=True)


def _focus(value: object, where: str) -> Ball | None:
    if value is None:
        return None
    table = _table(value, where)
    centre = _numbers(table.get("centre_mm"), 3, f"{where}: centre_mm")
    (radius,) = _numbers([table.get("radius_mm")], 1, f"{where}: radius_mm")
    return Ball(np.array(centre), radius) if radius > 0 else None


def _file(folder: Path, entry: dict[str, Any], where: str) -> Path:
    name = entry.get("file")
    if not isinstance(name, str) or not name or "\0" in name:
        raise InputError(f"{where}: file: expected the name of a mesh, found {json.dumps(name)}; {ADVICE}")
    if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
        raise InputError(f"{where}: file: expected a file in this folder, found {name!r}; {ADVICE}")
    return folder / name


def _table(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{where}: expected a table, found {json.dumps(value)[:100]}; {ADVICE}")
    return value


def _numbers(value: Any, count: int, where: str) -> list[float]:
    values = value if isinstance(value, list) else []
    if len(values) != count or not all(map(is_number, values)):
        raise InputError(f"{where}: expected {count} numbers, found {json.dumps(value)[:100]}; {ADVICE}")
    return [float(each) for each in values]
