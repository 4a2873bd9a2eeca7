"""A case as a parcel: its files under names that hold on any machine, known by the hash of their content.

Machines that do not see the files of a case get them once. The case file is written anew, with the same values to the
last bit and the new names, so that the dataset has the same identity wherever its views are rendered.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from ..case.case_file import Case
from ..case.case_writer import case_text, encoded
from ..errors import InputError
from .checksums import FileSum, sum_of, sum_of_file
from .options import DatasetOptions

CASE = "case.toml"


@dataclass(frozen=True)
class CaseParcel:
    """The files of a case and of its list of poses.

    Attributes
    ----------
    case_file
        The content of ``case.toml``.
    files
        Where each other file is on this machine, by its name in the parcel, with forward slashes.
    sums
        Size and hash of every file, by its name in the parcel.
    poses
        Name of the list of poses in the parcel; ``None`` if the poses are drawn.
    """

    case_file: bytes
    files: Mapping[str, Path]
    sums: Mapping[str, FileSum]
    poses: str | None

    @property
    def sha256(self) -> str:
        """One hash of all names and contents, in hexadecimal."""
        content = {name: known.sha256 for name, known in self.sums.items()}
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    @property
    def size(self) -> int:
        """Size of all files together."""
        return sum(known.bytes for known in self.sums.values())

    def block(self, name: str, offset: int, size: int) -> bytes:
        """A part of a file.

        Raises
        ------
        OSError
            It cannot be read.
        """
        if name == CASE:
            return self.case_file[offset : offset + size]
        with self.files[name].open("rb") as stream:
            stream.seek(offset)
            return stream.read(size)


def case_parcel(case: Case, options: DatasetOptions) -> CaseParcel:
    """The parcel of all that the views of a case depend on; files keep their own names, in a folder each.

    Landmarks, the record of the alignment and the table of options stay behind: no view depends on them.

    Raises
    ------
    InputError
        A file cannot be read, or has a name that is no Unicode.
    """
    files = {_name("frame", case.image): case.image, _name("surface", case.mesh): case.mesh}
    structures = []
    for number, structure in enumerate(case.structures):
        name = _name(f"structure_{number}", structure.mesh)
        files[name] = structure.mesh
        structures.append(replace(structure, mesh=Path(name)))
    poses = None
    if options.poses is not None:
        poses = _name("poses", Path(options.poses))
        files[poses] = Path(options.poses)
    moved = replace(
        case,
        path=Path(CASE),
        image=Path(_name("frame", case.image)),
        mesh=Path(_name("surface", case.mesh)),
        structures=tuple(structures),
        landmarks=(),
        alignment={},
        dataset={},
    )
    text = encoded(case.path, case_text(moved.path, moved))
    return CaseParcel(text, files, {CASE: sum_of(text), **{name: _sum(path) for name, path in files.items()}}, poses)


def _name(folder: str, path: Path) -> str:
    return PurePosixPath(folder, path.name).as_posix()


def _sum(path: Path) -> FileSum:
    try:
        return sum_of_file(path)
    except OSError as error:
        raise InputError(
            f"{path}: cannot read this file of the case ({error.strerror}); check its permissions"
        ) from None
