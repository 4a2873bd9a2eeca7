"""Views that are rendered elsewhere, as on a cluster: what is asked, the case sent, the view taken over.

Machines that do not see the files of a case get them once. The case file is written anew, with the same values to the
last bit and the new names, so that the dataset has the same identity wherever its views are rendered.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from ...case.case_file import Case
from ...case.case_writer import case_text, encoded
from ...errors import InputError, RunError
from ...files.content import create_folder, write_bytes_atomically
from ...files.tables import parsed_json
from ...progress import Progress
from ..checksums import sum_of
from ..description import instrument_files
from ..layout import ViewPaths
from ..options import DatasetOptions
from .resume_record import ViewRecord


@dataclass(frozen=True)
class MissingViews:
    """The views that a run lacks, and all that is needed to render them into its folder.

    Attributes
    ----------
    case, out
        The case file and the dataset's folder.
    options
        The options of the run.
    description
        The content of ``dataset.json``: see :func:`oneframe.dataset.description.describe`.
    identity
        The identity of the dataset: see :func:`oneframe.dataset.identity.identity_of`.
    kinds
        Kinds of files of a view, beside its record.
    finished
        Number of views that are there.
    views
        The missing views.
    damaged
        Those of them that have files all the same; they are rendered whatever is on disk.
    """

    case: Path
    out: Path
    options: DatasetOptions
    description: Mapping[str, object]
    identity: str
    kinds: tuple[str, ...]
    finished: int
    views: tuple[int, ...]
    damaged: frozenset[int]


Elsewhere = Callable[[MissingViews, Progress], None]
"""Renders the missing views of a run into its folder, and counts them; it raises ``InputError`` if a view cannot be
rendered from this input, and ``RunError`` if the views cannot be finished. Those that are finished stay."""


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
    instruments
        Name of the folder of the user's own instruments in it; ``None`` if there is none.
    """

    files: Mapping[str, bytes]
    poses: str | None
    instruments: str | None = None


def case_parcel(case: Case, options: DatasetOptions) -> CaseParcel:
    """The parcel of all that the views of a case depend on; with neutral names, as a file's may name the patient.

    Landmarks, the records of alignment and film, and the table of options stay behind: no view depends on them.

    Raises
    ------
    InputError
        A file cannot be read, or a name in the case is no Unicode.
    """
    files = {_name("frame", case.image): case.image, _name("surface", case.mesh): case.mesh}
    frames = []
    for number, frame in enumerate(case.frames, start=2):
        name = _name(f"frame_{number}", frame.image)
        files[name] = frame.image
        frames.append(replace(frame, image=Path(name)))
    structures = []
    for number, structure in enumerate(case.structures):
        name = _name(f"structure_{number}", structure.mesh)
        files[name] = structure.mesh
        structures.append(replace(structure, mesh=Path(name)))
    poses = None
    if options.poses is not None:
        poses = _name("poses", Path(options.poses))
        files[poses] = Path(options.poses)
    instruments = None
    if options.occluder_meshes is not None:
        instruments = "instruments"
        for number, path in enumerate(instrument_files(Path(options.occluder_meshes)).values()):
            files[f"{instruments}/{number:06d}{path.suffix}"] = path
    moved = replace(
        case,
        path=Path(CASE),
        image=Path(_name("frame", case.image)),
        mesh=Path(_name("surface", case.mesh)),
        frames=tuple(frames),
        structures=tuple(structures),
        landmarks=(),
        alignment={},
        dataset={},
        video=None,
    )
    text = encoded(case.path, case_text(moved.path, moved))
    return CaseParcel({CASE: text, **{name: _content(path) for name, path in files.items()}}, poses, instruments)


def _name(kind: str, path: Path) -> str:
    return f"{kind}{path.suffix}"


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path}: cannot read this file of the case ({error.strerror}); check its permissions"
        ) from None


def gather_view(paths: ViewPaths, identity: str, kinds: Iterable[str], files: Mapping[str, bytes]) -> None:
    """Take over one view; every hash is compared with the record before a file is written.

    ``paths`` and ``identity`` are of the dataset that it is for, ``kinds`` those of the files beside a view's record,
    and ``files`` the contents by their names relative to the dataset.

    Raises
    ------
    RunError
        The record is damaged or of another dataset, or a file is not as it says. The dataset has nothing of it then.
    OSError
        A file cannot be written; those without a record are replaced by the view's next rendering.
    """
    name = paths.relative("frame")
    record = _record(paths, files.get(name, b""), name)
    expected = {paths.relative(kind): kind for kind in kinds}
    if record.identity != identity or record.index != paths.index or record.files.keys() != expected.keys():
        raise RunError(f"{name}: expected a view of this dataset, found that of another; use an empty folder")
    for file, known in record.files.items():
        if sum_of(files.get(file, b"")) != known:
            raise RunError(f"{file}: its content is not what the record of view {paths.index} says")
    for file, kind in [*expected.items(), (name, "frame")]:
        create_folder(paths.file(kind).parent)
        write_bytes_atomically(paths.file(kind), files[file])


def _record(paths: ViewPaths, data: bytes, name: str) -> ViewRecord:
    try:
        record = ViewRecord.from_json(parsed_json(data, name), name)
    except (InputError, RunError):
        record = None
    if record is None or record.to_bytes() != data:
        raise RunError(f"{name}: expected the record of view {paths.index}, found a damaged one")
    return record
