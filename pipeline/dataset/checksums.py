"""Size and hash of files: of a view's in its record, and of all other files of a dataset in ``checksums.json``.

``checksums.json`` is written last of all, so a dataset that has it was complete.
"""

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from ..files.content import LARGEST_FILE, read_file, regular_file
from ..files.numbers import whole_number
from ..files.tables import write_json
from .layout import CHECKSUMS

_HASH = re.compile("[0-9a-f]{64}")
LARGEST_FILE_BYTES = 1 << 50


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
    with open(path, "rb", opener=regular_file) as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
        return FileSum(digest, stream.tell())


def sum_from_json(entry: Mapping[str, Any]) -> FileSum:
    """Read a sum again.

    Raises
    ------
    KeyError, TypeError, ValueError
        Something else.
    """
    return FileSum(checked_hash(entry["sha256"]), whole_number(entry["bytes"], LARGEST_FILE_BYTES))


def checked_hash(text: str) -> str:
    """A SHA-256 in hexadecimal; raises TypeError or ValueError for something else."""
    if not _HASH.fullmatch(text):
        raise ValueError(f"{text[:20]!r} is no SHA-256")
    return text


def sums_to_json(files: Mapping[str, FileSum]) -> dict[str, dict[str, object]]:
    """The JSON object of files by their paths relative to the dataset."""
    return {name: asdict(known) for name, known in files.items()}


@dataclass(frozen=True)
class Checksums:
    """The content of ``checksums.json``: sums of files by name, and hashes of the records of scenes by their folder."""

    files: Mapping[str, FileSum] = field(default_factory=dict)
    records: Mapping[str, str] = field(default_factory=dict)


def write_checksums(root: Path, identity: str, names: Iterable[str]) -> None:
    """Write ``checksums.json`` for the named files, given relative to ``root``, and the records of their scenes."""
    files = sums_to_json({name: sum_of_file(root / name) for name in sorted(names)})
    scenes = sorted(name.removesuffix("/scene_gt.json") for name in files if name.endswith("/scene_gt.json"))
    records = {scene: records_hash(root / scene) for scene in scenes}
    write_json(root / CHECKSUMS, {"identity": identity, "files": files, "records": records})


def records_hash(scene: Path) -> str:
    """SHA-256 of all records in the folder of a scene, one after the other in the order of the views."""
    digest = hashlib.sha256()
    for record in sorted((scene / "frame").glob("[0-9]*.json")):
        digest.update(read_file(record, LARGEST_FILE))
    return digest.hexdigest()


def read_checksums(root: Path, identity: str) -> Checksums | None:
    """The content of ``checksums.json``; ``None`` if it is missing, damaged or of another dataset."""
    try:
        content = json.loads(read_file(root / CHECKSUMS, LARGEST_FILE))
        if content["identity"] != identity:
            return None
        files = {str(name): sum_from_json(known) for name, known in content["files"].items()}
        return Checksums(files, {str(scene): str(digest) for scene, digest in content["records"].items()})
    except (OSError, ValueError, RecursionError, KeyError, TypeError, AttributeError):
        return None


@dataclass(frozen=True)
class FileSurvey:
    """Which files that are no view's can be relied on.

    Attributes
    ----------
    intact
        Names of the files that ``checksums.json`` lists and that are as it says.
    damaged
        Name of a file that it lists and that is not -> what is wrong, as a clause.
    """

    intact: frozenset[str]
    damaged: dict[str, str]


def survey_files(root: Path, identity: str, *, hashes: bool = False) -> FileSurvey:
    """Compare the files that ``checksums.json`` lists with it; none is intact where there is no such file.

    ``hashes``: compare these too, not only the sizes.
    """
    known = (read_checksums(root, identity) or Checksums()).files
    problems = {name: damaged_file(root, name, known[name], hashes=hashes) for name in known}
    damaged = {name: why for name, why in problems.items() if why is not None}
    return FileSurvey(frozenset(known.keys() - damaged.keys()), damaged)


def damaged_file(root: Path, name: str, known: FileSum, *, hashes: bool = False) -> str | None:
    """What is wrong with a file of the dataset, as a clause; ``None`` if nothing is.

    ``name`` is relative to ``root``; ``hashes``: compare these too, not only the sizes.
    """
    try:
        size = (root / name).stat().st_size
        if size != known.bytes:
            return f"{name} has {size} bytes instead of {known.bytes}"
        if hashes and sum_of_file(root / name) != known:
            return f"{name} has changed"
    except FileNotFoundError:
        return f"{name} is missing"
    except OSError as error:
        return f"{name} cannot be read ({error.strerror})"
    return None
