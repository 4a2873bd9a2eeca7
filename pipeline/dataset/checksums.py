"""Size and hash of files: of a view's in its record, and of all other files of a dataset in ``checksums.json``.

``checksums.json`` is written last of all, so a dataset that has it was complete.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from ..files.tables import write_json
from .layout import CHECKSUMS


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


def keep_checksums(root: Path, identity: str, names: Iterable[str]) -> None:
    """Remove from ``checksums.json``, if there is one, all files but the named ones: the others are about to change.

    Raises
    ------
    OSError
        It cannot be written.
    """
    known = read_checksums(root, identity)
    if known is not None:
        kept = {name: known[name] for name in names if name in known}
        write_json(root / CHECKSUMS, {"identity": identity, "files": sums_to_json(kept)})


def read_checksums(root: Path, identity: str) -> dict[str, FileSum] | None:
    """The files in ``checksums.json``; ``None`` if it is missing, damaged or of another dataset."""
    try:
        content = json.loads((root / CHECKSUMS).read_bytes())
        if content["identity"] != identity:
            return None
        return {
            str(name): FileSum(str(known["sha256"]), int(known["bytes"])) for name, known in content["files"].items()
        }
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

    Parameters
    ----------
    root, identity
        The dataset's folder and identity.
    hashes
        Compare the hashes too, not only the sizes.
    """
    known = read_checksums(root, identity) or {}
    problems = {name: damaged_file(root, name, known[name], hashes=hashes) for name in known}
    damaged = {name: why for name, why in problems.items() if why is not None}
    return FileSurvey(frozenset(known.keys() - damaged.keys()), damaged)


def damaged_file(root: Path, name: str, known: FileSum, *, hashes: bool = False) -> str | None:
    """What is wrong with a file of the dataset, as a clause; ``None`` if nothing is.

    Parameters
    ----------
    root, name
        The dataset's folder; the file relative to it.
    known
        What it was when it was written.
    hashes
        Also compare the hash, not only the size.
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
