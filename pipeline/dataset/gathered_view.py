"""A view that another machine has rendered, taken over into the dataset: its files first, its record last."""

from collections.abc import Iterable, Mapping

from ..errors import InputError, RunError
from ..files.content import create_folder, write_bytes_atomically
from ..files.tables import parsed_json
from .checksums import sum_of
from .layout import ViewPaths
from .view_record import ViewRecord


def gather_view(paths: ViewPaths, identity: str, kinds: Iterable[str], files: Mapping[str, bytes]) -> None:
    """Take over one view; every hash is compared with the record before a file is written.

    Parameters
    ----------
    paths
        The view's files in the dataset that it is for.
    identity
        Identity of that dataset.
    kinds
        Kinds of the files that a view has beside its record.
    files
        The content of all files by their names relative to the dataset.

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
