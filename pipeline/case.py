"""The case file: one frame, its camera, surface and pose, read strictly from TOML.

Reading stops at paths and numbers; the files they name are opened by :mod:`pipeline.blender.loading`.
"""

import difflib
import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .camera import PinholeCamera
from .distortion import Distortion, checked_distortion
from .errors import InputError
from .frames import checked_rigid

MM_PER_UNIT = {"mm": 1.0, "m": 1000.0}

_TABLES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "frame": (("image",), ()),
    "camera": (("size", "K"), ("pixel_origin", "distortion")),
    "surface": (("mesh",), ()),
    "pose": (("cam_from_model",), ()),
    "structures": (("name", "mesh"), ("color",)),
}
"""Table -> its required and its optional keys."""


@dataclass(frozen=True)
class Structure:
    """An anatomical structure that overlays show: a name, a mesh file in the surface's frame, an sRGB colour 0..1."""

    name: str
    mesh: Path
    color: tuple[float, float, float]


@dataclass(frozen=True)
class Case:
    """A checked case file.

    Attributes
    ----------
    path
        The TOML file.
    mm_per_unit
        Factor from the units of meshes and translations to millimetres.
    image
        The frame's file.
    camera, distortion
        Intrinsics with the pixel origin at the centre of the top-left pixel; OpenCV distortion or ``None``.
    mesh
        The surface's file.
    cam_from_given
        4x4, mm: the pose as given, for the frame of the mesh file.
    structures
        What overlays show beside the surface.
    dataset
        The raw ``[dataset]`` table: options of the run, checked by :mod:`pipeline.options`.
    told
        Sentences about what was corrected.
    """

    path: Path
    mm_per_unit: float
    image: Path
    camera: PinholeCamera
    distortion: Distortion | None
    mesh: Path
    cam_from_given: np.ndarray
    structures: tuple[Structure, ...] = ()
    dataset: dict[str, object] = field(default_factory=dict)
    told: tuple[str, ...] = ()

    def input_files(self) -> dict[str, Path]:
        """All files that the results depend on, by a name that does not depend on where they lie."""
        files = {"case": self.path, "frame": self.image, "surface": self.mesh}
        return files | {f"structure {structure.name}": structure.mesh for structure in self.structures}


def read_case(path: Path) -> Case:
    """Read and check a case file.

    Raises
    ------
    InputError
        Missing or not TOML, an unknown or missing key, a value of the wrong kind.
    """
    table = _read_toml(path)
    name = path.name
    _check_keys(table, ("units", "frame", "camera", "surface", "pose"), ("structures", "dataset"), name, "")
    if not isinstance(table["units"], str) or table["units"] not in MM_PER_UNIT:
        raise InputError(f'{name}: expected units = "mm" or "m", found {table["units"]!r}')
    mm_per_unit = MM_PER_UNIT[table["units"]]
    frame, camera, surface, pose = (_table(table, key, name) for key in ("frame", "camera", "surface", "pose"))
    intrinsics = PinholeCamera.from_matrix(
        camera["K"],
        size=camera["size"],
        pixel_origin=camera.get("pixel_origin", "center"),
        where=f"{name}: [camera] K",
    )
    distortion = None
    if "distortion" in camera:
        distortion = checked_distortion(camera["distortion"], intrinsics, f"{name}: [camera] distortion")
    cam_from_given, told = checked_rigid(pose["cam_from_model"], f"{name}: [pose] cam_from_model")
    cam_from_given[:3, 3] *= mm_per_unit
    return Case(
        path=path,
        mm_per_unit=mm_per_unit,
        image=_path(path, frame["image"], f"{name}: [frame] image"),
        camera=intrinsics,
        distortion=distortion,
        mesh=_path(path, surface["mesh"], f"{name}: [surface] mesh"),
        cam_from_given=cam_from_given,
        structures=_structures(path, table.get("structures", [])),
        dataset=_dataset(table.get("dataset", {}), name),
        told=(told,) if told else (),
    )


def _read_toml(path: Path) -> dict:
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        _check_integers(table)
        return table
    except FileNotFoundError:
        raise InputError(f"{path}: expected a case file, it does not exist; correct the path") from None
    except OSError as error:
        raise InputError(f"{path}: cannot read the case file ({error.strerror})") from None
    except (ValueError, RecursionError) as error:  # tomllib's and the decoder's are ValueErrors
        raise InputError(f"{path.name}: expected TOML, found a mistake: {error}") from None


def _check_integers(value: object) -> None:
    """TOML's integers have 64 bits; Python reads longer ones, which no float can hold."""
    if isinstance(value, int) and abs(value) >= 2**63:
        raise ValueError("an integer of more than 64 bits")
    if isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            _check_integers(part)


def _table(table: dict, key: str, name: str) -> dict:
    if not isinstance(table[key], dict):
        raise InputError(f"{name}: expected a table [{key}], found {table[key]!r}")
    required, optional = _TABLES[key]
    _check_keys(table[key], required, optional, name, f"[{key}] ")
    return table[key]


def _structures(path: Path, entries: object) -> tuple[Structure, ...]:
    name = path.name
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InputError(f"{name}: expected a list of tables [[structures]], found {entries!r}")
    structures = []
    for index, entry in enumerate(entries):
        where = f"{name}: [[structures]] number {index + 1}: "
        _check_keys(entry, *_TABLES["structures"], name, f"[[structures]] number {index + 1}: ")
        if not isinstance(entry["name"], str) or not entry["name"]:
            raise InputError(f"{where}expected a name, found {entry['name']!r}")
        color = entry.get("color", "#ffffff")
        if not isinstance(color, str) or not re.fullmatch(r"#[0-9a-fA-F]{6}", color):
            raise InputError(f'{where}expected color = "#rrggbb", found {color!r}')
        red, green, blue = (int(color[at : at + 2], 16) / 255 for at in (1, 3, 5))
        structures.append(Structure(entry["name"], _path(path, entry["mesh"], f"{where}mesh"), (red, green, blue)))
    names = [structure.name for structure in structures]
    if len(set(names)) != len(names):
        raise InputError(f"{name}: expected a different name for each of the [[structures]], found {names}")
    return tuple(structures)


def _dataset(table: object, name: str) -> dict[str, object]:
    if not isinstance(table, dict):
        raise InputError(f"{name}: expected a table [dataset], found {table!r}")
    return table


def _path(case_path: Path, value: object, where: str) -> Path:
    if not isinstance(value, str) or not value or "\0" in value:
        raise InputError(f"{where}: expected a file name, found {value!r}")
    return case_path.parent / value


def _check_keys(table: dict, required: tuple[str, ...], optional: tuple[str, ...], name: str, where: str) -> None:
    known = required + optional
    for key in table:
        if key not in known:
            raise InputError(f"{name}: {where}unknown key {key!r}; {nearest_name(key, known)}")
    for key in required:
        if key not in table:
            raise InputError(f"{name}: {where}expected a key {key!r}, it is missing")


def nearest_name(name: str, known: tuple[str, ...]) -> str:
    """A hint for a misspelt name: the nearest known one, or all of them."""
    near = difflib.get_close_matches(name.lower(), [key.lower() for key in known], n=1, cutoff=0.5)
    if near:
        return f"did you mean {next(key for key in known if key.lower() == near[0])!r}?"
    return "known are " + ", ".join(repr(key) for key in known)
