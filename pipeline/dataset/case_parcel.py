"""A case as a parcel: its files under names that hold on any machine.

Machines that do not see the files of a case get them once. The case file is written anew, with the same values to the
last bit and the new names, so that the dataset has the same identity wherever its views are rendered.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from ..case.case_file import Case
from ..case.case_writer import case_text, encoded
from ..errors import InputError
from .options import DatasetOptions

CASE = "case.toml"


@dataclass(frozen=True)
class CaseParcel:
    """The files of a case and of its list of poses.

    Attributes
    ----------
    files
        Content of each file by its name in the parcel, with forward slashes; the case file is :data:`CASE`.
    poses
        Name of the list of poses in the parcel; ``None`` if the poses are drawn.
    """

    files: Mapping[str, bytes]
    poses: str | None


def case_parcel(case: Case, options: DatasetOptions) -> CaseParcel:
    """The parcel of all that the views of a case depend on; with neutral names, as a file's may name the patient.

    Landmarks, the record of the alignment and the table of options stay behind: no view depends on them.

    Raises
    ------
    InputError
        A file cannot be read, or a name in the case is no Unicode.
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
    return CaseParcel({CASE: text, **{name: _content(path) for name, path in files.items()}}, poses)


def _name(kind: str, path: Path) -> str:
    return f"{kind}{path.suffix}"


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path}: cannot read this file of the case ({error.strerror}); check its permissions"
        ) from None
