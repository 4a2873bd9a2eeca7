"""Label maps: read as nnU-Net, 3D Slicer and ITK-SNAP write them.

Names of the labels come from files beside it (:func:`names_beside`). Those in the file itself (``Segment0_Name`` of a
``.seg.nrrd``) stand before them where they name anatomy; other words of a header may name the patient.
"""

import csv
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...files.content import LARGEST_TEXT, decoded, read_content
from ...files.tables import parsed_json
from ...transforms import transform_points
from ..bone.structures import anatomical_name, is_bone, plain_text
from ..volume import LabelMap, Volume, VoxelGrid, box_around, box_corners
from .volume_checks import apart_mm
from .volume_header import LABEL, read_header, volume_suffix
from .volume_reader import file_voxels

LONGEST_NAME = 80

_SNAP_LINE = re.compile(r'\s*(\d{1,9})(?:\s+[-+.\deE]+){6}\s+"([^"]*)"\s*')
"""ITK-SNAP: label, red, green, blue, opacity, visibility, mesh visibility, name."""

_SLICER_LINE = re.compile(r"\s*(\d{1,9})\s+(?!\(none\)|\d+\s)(\S+)(?:\s+\d+){3,4}(?:\s.*)?")
"""3D Slicer: label, name, red, green, blue, opacity."""

_NEGATED = np.diag([-1.0, -1.0, 1.0, 1.0])
"""RAS for LPS."""


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
        _check_place(values, grid, like, path.name)
    named = names_beside(path)
    for label, name in header.segments.items():
        if known := name if is_bone(name) else anatomical_name(name):
            named[label] = known
    return LabelMap(values, grid, _distinct(_present(values), named))


def _check_place(values: np.ndarray, grid: VoxelGrid, like: Volume, where: str) -> None:
    """Check that labels ``(Z, Y, X)`` lie in the grid of their volume, and have not lost their place.

    As many voxels fill the same box, if in another order; but one that negated numbers have put there.
    """
    wanted, whole = like.grid, like.whole or like.grid
    if sorted(grid.size) == sorted(whole.size):
        distance = np.linalg.norm(grid.corners_mm[:, None] - whole.corners_mm, axis=2)
        is_elsewhere = distance.min(axis=1).max() > 0.5 * whole.spacing_mm.min()
        is_negated = not apart_mm(grid.mesh_from_index, _NEGATED @ whole.mesh_from_index, grid.size)
        is_same = grid.size == whole.size and not apart_mm(grid.mesh_from_index, whole.mesh_from_index, grid.size)
        if not is_same and (is_elsewhere or is_negated):
            raise InputError(
                f"{where}: expected labels in the place of the volume, found as many voxels "
                f"{'with x and y negated' if is_negated else f'up to {distance.min(axis=1).max():.1f} mm elsewhere'}: "
                "their header was lost, their axes changed places, or they are of another volume; save them in the "
                "volume's order, with its affine, for example with nibabel: Nifti1Image(labels.dataobj, volume.affine)"
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
    """Names of labels by value, from the files that stand beside a label map; empty if there are none.

    JSON as of nnU-Net, label descriptions of ITK-SNAP, colour tables of 3D Slicer.
    """
    stem = (path.name[: -len(volume_suffix(path) or "")] or path.name).removesuffix(".seg")
    texts = (".json", ".txt", ".label", ".ctbl", "_ColorTable.ctbl", "_ColorTable.csv")
    own = [stem + ".json", "labels.json", "dataset.json", "../dataset.json"]
    own += [name for suffix in texts[1:] for name in (stem + suffix, "labels" + suffix)]
    for name in own:
        candidate = path.resolve().parent / name
        if candidate.is_file() and (names := _names_in(candidate)):
            return names
    return {}


def _names_in(path: Path) -> dict[int, str]:
    content = read_content(path, "names of labels", most=LARGEST_TEXT)
    if path.suffix == ".json":
        table = parsed_json(content, path.name)
        names = _names_in_json(table.get("labels", table)) if isinstance(table, dict) else {}
        # a flat table holds names alone: what a scanner's converter writes beside a map has numbers, too
        return names if names and ("labels" in table or len(names) == len(table)) else {}
    lines = [line for line in (decoded(content) or "").splitlines() if not line.startswith("#")]
    if path.suffix == ".csv":
        rows = [(row.get("LabelValue") or "", row.get("Name") or "") for row in csv.DictReader(lines)]
        return {int(label): name for label, name in rows if LABEL.fullmatch(label) and name}
    matches = (_SNAP_LINE.fullmatch(line) or _SLICER_LINE.fullmatch(line) for line in lines)
    return {int(match[1]): match[2] for match in matches if match}


def _names_in_json(labels: object) -> dict[int, str]:
    """``{"bone": 1}`` and ``{"1": "bone"}`` of nnU-Net, ``{"1": {"name": "bone"}}``; other entries are left out."""
    names: dict[int, str] = {}
    for key, value in labels.items() if isinstance(labels, Mapping) else ():
        name = value.get("name") if isinstance(value, Mapping) else value
        if LABEL.fullmatch(key) and isinstance(name, str):
            names[int(key)] = name
        elif isinstance(value, int) and not isinstance(value, bool):
            names[value] = key
    return names


def _distinct(labels: Iterable[int], named: Mapping[int, str]) -> dict[int, str]:
    """A name for each label but 0; the number stands in for a missing one, and behind one that occurs twice."""
    names: dict[int, str] = {}
    for label in labels:
        name = plain_text(named.get(label, ""))[:LONGEST_NAME] or f"label {label}"
        names[label] = f"{name} {label}" if name in names.values() else name
    return names


def _present(values: np.ndarray) -> list[int]:
    present = np.zeros(int(values.max()) + 1, bool)
    for part in values:
        present[np.bincount(part.ravel()).nonzero()[0]] = True
    return [int(label) for label in present.nonzero()[0] if label]
