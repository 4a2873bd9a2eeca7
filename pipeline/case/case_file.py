"""The case file: a frame, its camera, surface and pose, and further frames, read strictly from TOML.

This module reads paths and numbers; :func:`.load_case` opens the files that they name.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..camera.distortion import Distortion, checked_distortion
from ..camera.pinhole import PinholeCamera
from ..errors import InputError
from ..files.content import LARGEST_TEXT, read_content
from ..files.keys import check_keys, described
from ..files.numbers import MM_PER_UNIT, millimetres
from ..files.tables import parsed_toml
from ..light.lens_light import LensLight, checked_lens_light
from ..poses.pose_file import POSE_KEY
from ..surface.structure_colour import structure_colour
from ..transforms import checked_rigid
from .frame import UnreadFrame
from .landmarks import Landmark, checked_name, landmarks_from_tables
from .pose_record import UNKNOWN, PoseRecord

_TABLES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "frame": (("image",), ("video", "video_frame", "refused")),
    "camera": (("size", "K"), ("pixel_origin", "distortion")),
    "surface": (("mesh",), ("name",)),
    "pose": ((POSE_KEY,), ()),
    "structures": (("name", "mesh"), ("color",)),
    "frames": (("image", POSE_KEY), ("camera",)),
}
"""Table -> its required and its optional keys."""
LONGEST_NAME = 100
MOST_FRAMES = 255
"""A dataset names the frame of a pixel in 8 bits."""


@dataclass(frozen=True)
class Structure:
    """An anatomical structure for overlays: name, mesh file in the frame of the surface's file, sRGB colour 0..1."""

    name: str
    mesh: Path
    colour: tuple[float, float, float]


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
    cam_from_mesh, posed
        4x4, mm: the pose in the file, from the frame of the mesh file, or the identity; whether it has one.
    frames
        Further frames of the surface, which colour what those before did not see.
    structures
        What overlays show in addition to the surface.
    dataset
        The raw ``[dataset]`` table: options of the run, checked by :mod:`oneframe.dataset.options`.
    object_name
        Name of the surface in the tables of a dataset, or ``None`` for that of its file.
    messages
        Messages about what was corrected.
    landmarks
        Points of the surface (mm, ``mesh``) with their pixels in the undistorted frame.
    alignment
        Origin of the pose: see :mod:`oneframe.case.pose_record`.
    video
        Origin of the frame: the name of the film that it was taken from, and its number there, from 0.
    refused
        Why a person has refused the frame, which is not rendered then; else empty.
    light
        The lamp at the lens, or ``None`` if none is known.
    """

    path: Path
    mm_per_unit: float
    image: Path
    camera: PinholeCamera
    distortion: Distortion | None
    mesh: Path
    cam_from_mesh: np.ndarray
    frames: tuple[UnreadFrame, ...] = ()
    structures: tuple[Structure, ...] = ()
    dataset: dict[str, object] = field(default_factory=dict)
    object_name: str | None = None
    messages: tuple[str, ...] = ()
    landmarks: tuple[Landmark, ...] = ()
    alignment: PoseRecord = UNKNOWN
    video: tuple[str, int] | None = None
    refused: str = ""
    posed: bool = True
    light: LensLight | None = None

    @property
    def every_frame(self) -> tuple[UnreadFrame, ...]:
        """The frame, and the further ones."""
        return UnreadFrame(self.image, self.camera, self.distortion, self.cam_from_mesh), *self.frames

    @property
    def lens_light(self) -> LensLight:
        """The lamp at the lens, for views in its light."""
        if self.light is None:
            raise InputError(
                f"{self.path.name}: expected the lamp at the lens, a table [light], found none; "
                f"find it by oneframe light {self.path.name}, or render with --light none"
            )
        return self.light

    def input_files(self) -> dict[str, Path]:
        """All files that the results depend on, by a name that does not depend on their location."""
        files = {"case": self.path, "frame": self.image, "surface": self.mesh}
        files |= {f"frame {number}": frame.image for number, frame in enumerate(self.frames, start=2)}
        return files | {f"structure {structure.name}": structure.mesh for structure in self.structures}


def read_case(path: Path | str, *, posed: bool = True) -> Case:
    """Read and check a case file.

    ``posed`` is whether it must have a pose: not before the alignment.
    """
    path = Path(path)
    case = case_from_text(read_content(path, "a case file", most=LARGEST_TEXT), path)
    if posed and not case.posed:
        raise InputError(
            f"{path.name}: expected a pose, found no [pose]; align the frame first, in Blender or by align"
        )
    return case


def case_from_text(text: str | bytes, path: Path) -> Case:
    """Check a case from the text of its file; file names in it are relative to the folder of ``path``."""
    name = path.name
    table = parsed_toml(text, name)
    check_keys(
        table, ("units", "frame", "camera", "surface"),
        ("pose", "frames", "structures", "landmarks", "alignment", "light", "dataset"), f"{name}: ",
    )  # fmt: skip
    if not isinstance(table["units"], str) or table["units"] not in MM_PER_UNIT:
        raise InputError(f'{name}: expected units = "mm" or "m", found {described(table["units"])}')
    mm_per_unit = MM_PER_UNIT[table["units"]]
    frame, camera, surface = (_table(table, key, name) for key in ("frame", "camera", "surface"))
    intrinsics, distortion = checked_camera(camera, f"{name}: [camera]")
    cam_from_mesh = np.eye(4)
    messages: list[str] = []
    if "pose" in table:
        pose = _table(table, "pose", name)
        cam_from_mesh, messages = _pose(pose[POSE_KEY], mm_per_unit, f"{name}: [pose] {POSE_KEY}")
    frames = []
    listed = _tables(table.get("frames", []), "frames", name)
    if len(listed) >= MOST_FRAMES:
        raise InputError(f"{name}: expected at most {MOST_FRAMES - 1} [[frames]], found {len(listed)}; leave some out")
    for number, entry in enumerate(listed, start=1):
        where = f"{name}: [[frames]] number {number}: "
        check_keys(entry, *_TABLES["frames"], where)
        lens = intrinsics, distortion
        if "camera" in entry:
            lens = checked_camera(_table(entry, "camera", where), f"{where}camera")
        pose_of_frame, said = _pose(entry[POSE_KEY], mm_per_unit, f"{where}{POSE_KEY}")
        frames.append(UnreadFrame(_path(path, entry["image"], f"{where}image"), *lens, pose_of_frame))
        messages += said
    return Case(
        path=path,
        mm_per_unit=mm_per_unit,
        image=_path(path, frame["image"], f"{name}: [frame] image"),
        camera=intrinsics,
        distortion=distortion,
        mesh=_path(path, surface["mesh"], f"{name}: [surface] mesh"),
        object_name=_object_name(surface.get("name"), f"{name}: [surface] name"),
        cam_from_mesh=cam_from_mesh,
        frames=tuple(frames),
        structures=_structures(path, table.get("structures", [])),
        dataset=_raw_table(table.get("dataset", {}), "dataset", name),
        messages=tuple(messages),
        landmarks=landmarks_from_tables(
            table.get("landmarks", []),
            f"{name}: [[landmarks]]",
            mm_per_unit=mm_per_unit,
            pixel_origin=camera.get("pixel_origin", "center"),
        ),
        alignment=PoseRecord.of_table(table.get("alignment", {}), f"{name}: [alignment]"),
        video=_video(frame, f"{name}: [frame]"),
        refused=_text(frame.get("refused", ""), f"{name}: [frame] refused"),
        posed="pose" in table,
        light=_light(table, name),
    )


def checked_camera(table: dict, where: str) -> tuple[PinholeCamera, Distortion | None]:
    """The camera of a table ``[camera]`` with valid keys; pixel origin at the centre of the top-left pixel."""
    camera = PinholeCamera.from_matrix(
        table["K"], size=table["size"], pixel_origin=table.get("pixel_origin", "center"), where=f"{where} K"
    )
    if "distortion" not in table:
        return camera, None
    return camera, checked_distortion(table["distortion"], camera, f"{where} distortion")


def _pose(rows: Any, mm_per_unit: float, where: str) -> tuple[np.ndarray, list[str]]:
    """``cam_from_mesh`` in mm, from the unit of the file, and messages about what was corrected."""
    cam_from_mesh, message = checked_rigid(rows, where)
    cam_from_mesh[:3, 3] = [millimetres(row[3], mm_per_unit) for row in rows[:3]]
    if not np.isfinite(cam_from_mesh).all():
        raise InputError(f"{where}: expected a translation that is finite in mm, it is too long")
    return cam_from_mesh, [] if message is None else [message]


def _tables(entries: object, key: str, name: str) -> list[dict]:
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InputError(f"{name}: expected a list of tables [[{key}]], found {described(entries)}")
    return entries


def _table(table: dict, key: str, name: str) -> dict:
    if not isinstance(table[key], dict):
        raise InputError(f"{name}: expected a table [{key}], found {described(table[key])}")
    required, optional = _TABLES[key]
    check_keys(table[key], required, optional, f"{name}: [{key}] ")
    return table[key]


def _light(table: dict, name: str) -> LensLight | None:
    if "light" not in table:
        return None
    if not isinstance(table["light"], dict):
        raise InputError(f"{name}: expected a table [light], found {described(table['light'])}")
    return checked_lens_light(table["light"], f"{name}: [light]")


def _text(value: object, where: str) -> str:
    if not isinstance(value, str):
        raise InputError(f"{where}: expected text, found {described(value)}")
    return value


def _object_name(value: object, where: str) -> str | None:
    if value is None:
        return None
    if not isinstance(value, str) or not value.strip() or not value.isprintable() or len(value) > LONGEST_NAME:
        raise InputError(
            f"{where}: expected a name of at most {LONGEST_NAME} printable characters, found {described(value)}"
        )
    return value


def _structures(path: Path, entries: object) -> tuple[Structure, ...]:
    name = path.name
    structures = []
    for index, entry in enumerate(_tables(entries, "structures", name)):
        where = f"{name}: [[structures]] number {index + 1}: "
        check_keys(entry, *_TABLES["structures"], where)
        label = checked_name(entry["name"], where)
        colour = entry.get("color")
        red, green, blue = structure_colour(label)
        if colour is not None:
            if not isinstance(colour, str) or not re.fullmatch(r"#[0-9a-fA-F]{6}", colour):
                raise InputError(f'{where}expected color = "#rrggbb", found {described(colour)}')
            red, green, blue = (int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5))
        structures.append(Structure(label, _path(path, entry["mesh"], f"{where}mesh"), (red, green, blue)))
    names = [structure.name for structure in structures]
    if len(set(names)) != len(names):
        raise InputError(f"{name}: expected a different name for each of the [[structures]], found {names}")
    return tuple(structures)


def _video(frame: Mapping[str, object], where: str) -> tuple[str, int] | None:
    video, number = frame.get("video"), frame.get("video_frame")
    if video is None and number is None:
        return None
    if not isinstance(video, str) or isinstance(number, bool) or not isinstance(number, int) or number < 0:
        raise InputError(
            f"{where}: expected video, the name of a film, and video_frame, a number from 0, together, "
            f"found {described(video)} and {number!r}"
        )
    return str(video), int(number)


def _raw_table(table: object, key: str, name: str) -> dict[str, object]:
    if not isinstance(table, dict):
        raise InputError(f"{name}: expected a table [{key}], found {described(table)}")
    return {key: _with_plain_floats(value) for key, value in table.items()}


def _with_plain_floats(value: object) -> object:
    if isinstance(value, dict):
        return {key: _with_plain_floats(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_with_plain_floats(part) for part in value]
    return float(value) if isinstance(value, float) else value


def _path(case_path: Path, value: object, where: str) -> Path:
    if not isinstance(value, str) or not value or "\0" in value:
        raise InputError(f"{where}: expected a file name, found {described(value)}")
    return case_path.parent / value
