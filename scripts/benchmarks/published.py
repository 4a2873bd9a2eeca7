"""Published photographs with poses: as they are read, and as cases with held-out photographs for an evaluation.

"Bloster" (Fu et al., "Texture mapping for 3D reconstruction with RGB-D sensor", 2018) is a printed cushion in 14
photographs, LINEMOD-Occluded (Brachmann et al. 2014) has objects on a table that hide one another. Needs ``cv2``.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import Case
from oneframe.case.case_writer import write_case
from oneframe.errors import InputError
from oneframe.files.content import read_content
from oneframe.files.tables import parsed_json
from oneframe.files.writing import write_bytes_atomically
from oneframe.images.image_check import check_image_file
from oneframe.images.png import encode_png
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.mesh_reader import read_mesh
from oneframe.transforms import nearest_rotation, rigid

from .figures import expected

CaseFiles = tuple[Path, Path]
"""A case file and its list of photographs."""

LMO_OBJECTS = (1, 5, 6, 8, 9, 12)
"""The objects of LM-O without symmetry."""
LMO_NAMES = {1: "ape", 5: "can", 6: "cat", 8: "driller", 9: "duck", 12: "holepuncher"}
BLOSTER_SOURCES = (0, 7)
FEWEST_LMO_PX = 400
"""Pixels of an object that is hardly hidden; photographs with fewer are left out."""


def read_bloster(folder: Path) -> tuple[PinholeCamera, list[tuple[Path, np.ndarray]]]:
    """The camera, and each photograph with its pose in mm, under which the colours of all photographs agree.

    Parameters
    ----------
    folder
        With ``cameras.json``, ``mesh_7k.ply``, ``mesh_70k.ply`` and ``rgb/``; the meshes are in metres.
    """
    table = _table(folder / "cameras.json")
    with expected(folder, "the cameras.json of bloster", "check the folder"):
        frames = []
        for each in table["frames"]:
            pose = np.array(each["cam_from_world_refined"])
            frames.append((folder / each["color"], rigid(nearest_rotation(pose[:3, :3]), 1000 * pose[:3, 3])))
        return _camera(table["color"]), frames


def read_lmo(folder: Path) -> tuple[PinholeCamera, dict[int, dict[int, np.ndarray]]]:
    """The camera, and for each frame ``cam_from_model`` in mm by object; errors as :func:`read_bloster`.

    Parameters
    ----------
    folder
        With ``camera.json``, ``scene_gt.json``, ``rgb/`` and ``models/`` of one BOP scene.
    """
    k, truth = _table(folder / "camera.json"), _table(folder / "scene_gt.json")
    with expected(folder, "camera.json and scene_gt.json in BOP's format", "check the folder"):
        return _camera(k), {
            int(frame): {
                int(each["obj_id"]): rigid(
                    nearest_rotation(np.reshape(each["cam_R_m2c"], (3, 3))), np.array(each["cam_t_m2c"])
                )
                for each in reversed(entries)
            }
            for frame, entries in truth.items()
        }


def lmo_model(folder: Path, number: int) -> Path:
    """The file of an object."""
    return folder / f"models/obj_{number:06d}.ply"


def lmo_image(folder: Path, frame: int) -> Path:
    """The file of a frame."""
    return folder / f"rgb/{frame:06d}.png"


def bloster_cases(folder: Path, out: Path, *, most: int | None = None, mesh: str = "mesh_7k.ply") -> list[CaseFiles]:
    """Write two cases of bloster, from source frames 0 and 7; the coarse mesh by default.

    Parameters
    ----------
    folder
        As for :func:`read_bloster`.
    out
        Where the files go; created.
    most
        Largest number of photographs of a case; all others but the source if ``None``.
    mesh
        Name of the mesh.
    """
    camera, frames = read_bloster(folder)
    written = []
    for source in BLOSTER_SOURCES:
        image, pose = frames[source]
        case = Case(out / f"bloster_{source}.toml", 1000.0, image, camera, None, folder / mesh, pose)
        written.append(written_case(case, _spread([*frames[:source], *frames[source + 1 :]], most)))
    return written


def lmo_cases(folder: Path, out: Path, *, most: int | None = None) -> list[CaseFiles]:
    """Write a case for each object of LM-O without symmetry; what other objects hide is transparent in all images.

    The source is the frame that shows most of the object; the others are the photographs, where the object is in view.
    Options and errors as :func:`bloster_cases`.
    """
    camera, poses = read_lmo(folder)
    meshes = {n: read_mesh(lmo_model(folder, n))[0] for n in {n for placed in poses.values() for n in placed}}
    shown: dict[int, dict[int, tuple[np.ndarray, np.ndarray]]] = {number: {} for number in LMO_OBJECTS}
    for frame, placed in poses.items():
        for number, hidden in _hidden(meshes, camera, placed).items():
            shown[number][frame] = hidden
    written = []
    for number, frames in shown.items():
        usable = {
            frame: visible for frame, (visible, hidden) in frames.items() if np.count_nonzero(visible) >= FEWEST_LMO_PX
        }
        if not usable:
            continue
        clear = max(usable, key=lambda frame: np.count_nonzero(usable[frame]) - np.count_nonzero(frames[frame][1]))
        place = out / LMO_NAMES.get(number, f"object_{number}")
        place.mkdir(parents=True, exist_ok=True)
        others = _spread([frame for frame in usable if frame != clear], most)
        for frame in (clear, *others):
            alpha = np.where(frames[frame][1], 0, 255).astype(np.uint8)
            image = np.dstack([read_codes(lmo_image(folder, frame)), alpha])
            write_bytes_atomically(place / f"{frame:06d}.png", encode_png(image))
        case = Case(
            place / f"{place.name}.toml", 1.0, place / f"{clear:06d}.png", camera, None, lmo_model(folder, number),
            poses[clear][number],
        )  # fmt: skip
        written.append(written_case(case, [(place / f"{frame:06d}.png", poses[frame][number]) for frame in others]))
    if not written:
        raise InputError(f"{folder}: expected frames with objects of {LMO_OBJECTS} in view, found none")
    return written


Loader = Callable[..., list[CaseFiles]]
LOADERS: Mapping[str, Loader] = {"bloster": bloster_cases, "lmo": lmo_cases}
"""Name of a data set -> the function that writes its cases."""


def _hidden(
    meshes: Mapping[int, TriangleMesh], camera: PinholeCamera, placed: Mapping[int, np.ndarray]
) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """For each object of a frame that is evaluated: ``(H, W)`` bool where it is seen, and where another hides it."""
    nearness = {number: rasterise_depth(meshes[number], camera, pose).inverse_depth for number, pose in placed.items()}
    nearest = np.max(list(nearness.values()), axis=0)
    found = {}
    for number in set(placed) & set(LMO_OBJECTS):
        own = nearness[number]
        hidden = (own > 0) & (own < nearest)
        # the poses are some pixels off
        grown = cv2.dilate(((nearest > own) & (nearest > 0)).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
        found[number] = ((own > 0) & ~hidden, grown & (own > 0))
    return found


def written_case(case: Case, photographs: Sequence[tuple[Path, np.ndarray]]) -> CaseFiles:
    """Write a case and its photographs (file, pose in mm) beside it."""
    case.path.parent.mkdir(parents=True, exist_ok=True)
    write_case(case.path, replace(case, object_name=case.path.stem))
    entries = []
    for path, pose in photographs:
        listed = pose.copy()
        listed[:3, 3] /= case.mm_per_unit
        entries.append({"image": str(path.resolve()), "cam_from_mesh": listed.tolist()})
    listed_path = case.path.with_suffix(".json")
    write_bytes_atomically(listed_path, (json.dumps(entries, indent=1) + "\n").encode())
    return case.path, listed_path


def _spread(items: Sequence, most: int | None) -> list:
    if most is None or len(items) <= most:
        return list(items)
    return [items[round(number)] for number in np.linspace(0, len(items) - 1, most)]


def _camera(k: dict) -> PinholeCamera:
    return PinholeCamera(k["width"], k["height"], k["fx"], k["fy"], k["cx"], k["cy"])


def read_codes(path: Path) -> np.ndarray:
    """``(H, W, 3)`` uint8 RGB."""
    image = cv2.imdecode(np.frombuffer(check_image_file(path, str(path)), np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise InputError(f"{path}: expected an image, cannot decode it; save it as PNG")
    return np.ascontiguousarray(image[:, :, ::-1])


def _table(path: Path) -> dict:
    return parsed_json(read_content(path, "a table of poses"), str(path))
