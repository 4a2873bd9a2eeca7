"""A view that another machine has rendered, taken over into the dataset: its files first, its record last."""

import hashlib
from collections.abc import Callable, Iterable
from contextlib import suppress

from ..errors import InputError, RunError
from ..files.content import create_folder, write_bytes_atomically, written_file
from ..files.tables import parsed_json
from .checksums import FileSum
from .layout import ViewPaths
from .view_record import ViewRecord

ReadFile = Callable[[str], Iterable[bytes]]
"""The content of a file in blocks, by its name relative to the dataset."""


def gather_view(paths: ViewPaths, identity: str, kinds: Iterable[str], read: ReadFile) -> int:
    """Take over one view, block by block; every hash is compared with the record before a file gets its name.

    Parameters
    ----------
    paths
        The view's files in the dataset that it is for.
    identity
        Identity of that dataset.
    kinds
        Kinds of the files that a view has beside its record.
    read
        Reads a file of the other folder.

    Returns
    -------
    Number of bytes that were read.

    Raises
    ------
    RunError
        The record is damaged or of another dataset, or a file is not as its record says. The dataset has nothing of it
        but files without a record, which the view's next rendering replaces.
    OSError
        A file cannot be written here; or whatever ``read`` raises.
    """
    name = paths.relative("frame")
    data = b"".join(read(name))
    record = _record(paths, data, name)
    expected = {paths.relative(kind): kind for kind in kinds}
    if record.identity != identity or record.index != paths.index or record.files.keys() != expected.keys():
        raise RunError(f"{name}: expected a view of this dataset, found that of another; use an empty folder")
    total = len(data)
    for file, known in record.files.items():
        _copy(paths, expected[file], file, known, read)
        total += known.bytes
    with suppress(FileExistsError):
        create_folder(paths.file("frame").parent)
    write_bytes_atomically(paths.file("frame"), data)
    return total


def _record(paths: ViewPaths, data: bytes, name: str) -> ViewRecord:
    try:
        record = ViewRecord.from_json(parsed_json(data, name), name)
    except (InputError, RunError):
        record = None
    if record is None or record.to_bytes() != data:
        raise RunError(f"{name}: expected the record of view {paths.index}, found a damaged one")
    return record


def _copy(paths: ViewPaths, kind: str, name: str, known: FileSum, read: ReadFile) -> None:
    path = paths.file(kind)
    create_folder(path.parent)
    digest, size = hashlib.sha256(), 0
    with written_file(path) as stream:
        for block in read(name):
            stream.write(block)
            digest.update(block)
            size += len(block)
        if FileSum(digest.hexdigest(), size) != known:
            raise RunError(f"{name}: its content is not what the record of view {paths.index} says")
