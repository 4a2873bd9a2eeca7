"""The folder that ``oneframe surface`` leaves: the names of its files, and its record, read strictly."""

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
    try:
        # another program's JSON has neither
        _ = record["threshold_hu"], record["volume"]
        structures = tuple(
            Structure(_text(name), _file(folder, entry), _colour(*_numbers(entry["colour"], 3)))
            for name, entry in record.get("structures", {}).items()
        )
        mesh, part = _file(folder, record["surface"]), record.get("focus")
        focus = Ball(np.array(_numbers(part["centre_mm"], 3)), *_numbers([part["radius_mm"]], 1)) if part else None
    except (AttributeError, KeyError, TypeError, ValueError):
        raise InputError(f"{path}: expected the report of oneframe surface, found something else; {ADVICE}") from None
    return SurfaceFolder(mesh, structures, focus if focus and focus.radius_mm > 0 else None, is_lps=True)


def _text(value: Any) -> str:
    if not isinstance(value, str) or not value or "\0" in value:
        raise ValueError(value)
    return value


def _file(folder: Path, entry: dict[str, Any]) -> Path:
    """A file of the folder itself."""
    name = PurePosixPath(_text(entry["file"]))
    if name.is_absolute() or ".." in name.parts:
        raise ValueError(name)
    return folder / name


def _colour(red: float, green: float, blue: float) -> tuple[float, float, float]:
    if not 0 <= min(red, green, blue) <= max(red, green, blue) <= 1:
        raise ValueError(red, green, blue)
    return red, green, blue


def _numbers(values: Any, count: int) -> list[float]:
    if not isinstance(values, list) or len(values) != count or not all(map(is_number, values)):
        raise ValueError(values)
    return [float(each) for each in values]
