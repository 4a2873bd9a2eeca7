"""Size and hash of files: of a view's in its record, and of all other files of a dataset in ``checksums.json``.

``checksums.json`` is written last of all, so a dataset that has it was complete.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from ..files.tables import write_json

CHECKSUMS = "checksums.json"


@dataclass(frozen=True)
class FileSum:
    """SHA-256 in hexadecimal and size in bytes of a file."""

    sha256: str
    bytes: int


def sum_of(data: bytes) -> FileSum:
    """Size and hash of a file's content."""
    return FileSum(hashlib.sha256(data).hexdigest(), len(data))


def sum_of_file(path: Path) -> FileSum:
    """Size and hash of a file, which is not read into memory as a whole.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
        return FileSum(digest, stream.tell())


def sums_to_json(files: Mapping[str, FileSum]) -> dict[str, dict[str, object]]:
    """The JSON object of files by their paths relative to the dataset."""
    return {name: asdict(known) for name, known in files.items()}


def write_checksums(root: Path, identity: str, names: Iterable[str]) -> None:
    """Write ``checksums.json`` for the named files, given relative to ``root``, and the records of their scenes.

    Raises
    ------
    OSError
        A file is missing or cannot be read.
    """
    files = {name: sum_of_file(root / name) for name in sorted(names)}
    scenes = [name.removesuffix("/scene_gt.json") for name in files if name.endswith("/scene_gt.json")]
    records = {scene: records_hash(root / scene) for scene in scenes}
    write_json(root / CHECKSUMS, {"identity": identity, "files": sums_to_json(files), "records": records})


def records_hash(scene: Path) -> str:
    """SHA-256 of all records in the folder of a scene, one after the other in the order of the views."""
    digest = hashlib.sha256()
    for record in sorted((scene / "frame").glob("[0-9]*.json")):
        digest.update(record.read_bytes())
    return digest.hexdigest()
