"""Label maps: read as nnU-Net, 3D Slicer and ITK-SNAP write them.

Names of the labels come from a JSON file beside it (nnU-Net's ``dataset.json``, also one folder up, or
``labels.json``), or from ITK-SNAP's label descriptions as text. Those in the file itself (``Segment0_Name`` of a
``.seg.nrrd``) stand before them where they name anatomy; other words of a header may name the patient.
"""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...files.content import LARGEST_TEXT, decoded, read_content
from ...files.tables import parsed_json
from ...transforms import transform_points
from ..bone.structures import anatomical_name, is_bone
from ..volume import LabelMap, Volume, VoxelGrid, box_around, box_corners
from .volume_header import read_header, volume_suffix
from .volume_reader import file_voxels

LONGEST_NAME = 80

_SNAP_LINE = re.compile(r'\s*(\d+)(?:\s+[-+.\deE]+){6}\s+"([^"]*)"\s*')
"""Label, red, green, blue, opacity, visibility, mesh visibility, name."""


def read_labels(path: Path, like: Volume | None = None) -> LabelMap:
    """Read a label map, with a name for each label that occurs.

    Parameters
    ----------
    path
        A file of a format of :func:`.read_volume`, but not DICOM.
    like
        The volume that the labels are for, which they must overlap. A map on another grid in the same space keeps its
        own, which is better for the surfaces of fine structures.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(
            f"{path}: expected a label map as a file, found a folder; export a DICOM segmentation as NIfTI or NRRD, "
            "for example from 3D Slicer"
        )
    header = read_header(path)
    values, grid = file_voxels(path, header, "labels")
    if like is not None:
        _check_place(values, grid, like.grid, path.name)
    named = names_beside(path)
    for label, name in header.segments.items():
        if known := name if is_bone(name) else anatomical_name(name):
            named[label] = known
    return LabelMap(values, grid, _distinct(_present(values), named))


def _check_place(values: np.ndarray, grid: VoxelGrid, wanted: VoxelGrid, where: str) -> None:
    """Check that labels ``(Z, Y, X)`` lie in the grid of their volume, and have not lost their place."""
    if grid.size == wanted.size and _is_default(grid) and not _is_default(wanted):
        raise InputError(
            f"{where}: expected labels with the place of the volume, found {' x '.join(map(str, grid.size))} voxels as "
            "in the volume, but 1 mm apart from (0, 0, 0): the header was lost; save them with the volume's affine"
        )
    first, stop = box_around(values)
    points = transform_points(grid.mesh_from_index, box_corners(first, stop - 1.0))
    index = transform_points(wanted.index_from_mesh, points)
    if (index.max(axis=0) < -0.5).any() or (index.min(axis=0) > np.array(wanted.size) - 0.5).any():
        found, expected = (
            np.round([each.min(axis=0), each.max(axis=0)], 1).tolist() for each in (points, wanted.corners_mm)
        )
        raise InputError(
            f"{where}: expected labels in the volume, found all of them outside: they cover {found[0]} to {found[1]} "
            f"mm, the volume {expected[0]} to {expected[1]} mm (LPS); take the labels of this volume"
        )


def names_beside(path: Path) -> dict[int, str]:
    """Names of labels by value, from the files that stand beside a label map; empty if there are none."""
    stem = path.name[: -len(volume_suffix(path) or "")] or path.name
    own = [path.with_name(stem + ".json"), path.with_name("labels.json"), path.with_name("dataset.json")]
    for candidate in [*own, path.resolve().parent.parent / "dataset.json"]:
        if candidate.is_file():
            table = parsed_json(read_content(candidate, "names of labels", most=LARGEST_TEXT), candidate.name)
            if isinstance(table, dict):
                names = _names_in_json(table.get("labels", table))
                # a flat table holds names alone: what a scanner's converter writes beside a map has numbers, too
                if names and ("labels" in table or len(names) == len(table)):
                    return names
    for name in (stem + ".txt", stem + ".label", "labels.txt", "labels.label"):
        candidate = path.with_name(name)
        if candidate.is_file() and (names := _names_in_text(candidate)):
            return names
    return {}


def _names_in_json(labels: object) -> dict[int, str]:
    """``{"bone": 1}`` and ``{"1": "bone"}`` of nnU-Net, ``{"1": {"name": "bone"}}``; other entries are left out."""
    names: dict[int, str] = {}
    for key, value in labels.items() if isinstance(labels, Mapping) else ():
        name = value.get("name") if isinstance(value, Mapping) else value
        if key.isdecimal() and isinstance(name, str):
            names[int(key)] = name
        elif isinstance(value, int) and not isinstance(value, bool):
            names[value] = key
    return names


def _names_in_text(path: Path) -> dict[int, str]:
    """Label descriptions of ITK-SNAP."""
    text = decoded(read_content(path, "names of labels", most=LARGEST_TEXT)) or ""
    matches = (_SNAP_LINE.fullmatch(line) for line in text.splitlines() if not line.startswith("#"))
    return {int(match[1]): match[2] for match in matches if match}


def _distinct(labels: Iterable[int], named: Mapping[int, str]) -> dict[int, str]:
    """A name for each label but 0; the number stands in for a missing one, and behind one that occurs twice."""
    names: dict[int, str] = {}
    for label in labels:
        name = " ".join(re.sub(r"[^\w .,()/+-]", " ", named.get(label, "")).split())[:LONGEST_NAME] or f"label {label}"
        names[label] = f"{name} {label}" if name in names.values() else name
    return names


def _present(values: np.ndarray) -> list[int]:
    present = np.zeros(int(values.max()) + 1, bool)
    for part in values:
        present[np.bincount(part.ravel()).nonzero()[0]] = True
    return [int(label) for label in present.nonzero()[0] if label]


def _is_default(grid: VoxelGrid) -> bool:
    """Whether a grid is what writers put into a header if they know nothing: 1 mm, at the origin, of any signs."""
    return bool(np.allclose(np.abs(grid.mesh_from_index), np.eye(4), atol=1e-6))
