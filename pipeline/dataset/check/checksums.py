"""Sizes and hashes: those of a view's files in its record, and those of all other files in ``checksums.json``.

The identity is computed here from ``dataset.json`` by its definition, and the hash of a scene's records by its own.
"""

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from .contents import CHECKSUMS, Contents
from .files import DamagedFile, hash_of, mapping, opened, read_object, require_keys, shortened, whole_number
from .findings import Findings

KIND = "damaged files"
HASH = re.compile("[0-9a-f]{64}")


@dataclass(frozen=True)
class FileSum:
    """SHA-256 in hexadecimal and size in bytes of a file."""

    sha256: str
    size: int


@dataclass(frozen=True)
class Checksums:
    """The content of ``checksums.json``.

    Attributes
    ----------
    files
        Sums of files by path.
    records
        Hashes of the records of scenes by folder.
    outdated
        Tables that it does not list because a run that is not finished, such as one that adds views, will write them.
    """

    files: dict[str, FileSum] = field(default_factory=dict)
    records: dict[str, object] = field(default_factory=dict)
    outdated: frozenset[str] = frozenset()


def identity_of(content: Mapping[str, object]) -> str:
    """The identity: SHA-256 of the canonical JSON of the object in ``dataset.json`` without what growth changes."""
    rest = {key: value for key, value in content.items() if key not in ("count", "poses_sha256")}
    return hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def poses_hash(poses: Iterable[np.ndarray]) -> str:
    """SHA-256 of listed 4x4 poses: of the rotation and translation in their upper rows as float64, one by one."""
    digest = hashlib.sha256()
    for pose in poses:
        digest.update(pose[:3].astype("<f8").tobytes())
    return digest.hexdigest()


def read_sums(content: Mapping, where: str) -> dict[str, FileSum]:
    """The entries of an object ``files`` by path.

    Raises
    ------
    DamagedFile
        An entry is not a hash and a size.
    """
    sums = {}
    for name in content:
        here = f"{where}: files: {name}"
        entry = mapping(content, name, f"{where}: files")
        require_keys(entry, {"sha256", "bytes"}, here)
        if not (isinstance(entry["sha256"], str) and HASH.fullmatch(entry["sha256"])):
            raise DamagedFile(f"{here}: expected a SHA-256, found {shortened(entry['sha256'])}")
        sums[name] = FileSum(entry["sha256"], whole_number(entry, "bytes", here))
    return sums


def read_checksums(root: Path, contents: Contents, identity: str, findings: Findings) -> Checksums:
    """Read ``checksums.json`` and compare the identity and the names in it; empty if it cannot be read."""
    if CHECKSUMS in contents.missing:
        return Checksums()
    try:
        content = read_object(root, CHECKSUMS, (1 << 20) + 2048 * len(contents.scenes))
        require_keys(content, {"identity", "files", "records"}, CHECKSUMS)
        sums = Checksums(
            read_sums(mapping(content, "files", CHECKSUMS), CHECKSUMS), mapping(content, "records", CHECKSUMS)
        )
    except DamagedFile as damage:
        findings.add(KIND, damage)
        return Checksums()
    if content["identity"] != identity:
        findings.add(KIND, f"{CHECKSUMS}: identity is {shortened(content['identity'])}, dataset.json gives {identity}")
    scenes = {name.rpartition("/")[0] for name in contents.tables if name.count("/") == 2}
    for found, expected in ((sums.files.keys(), contents.tables), (sums.records.keys(), scenes)):
        if different := sorted(found - expected if contents.unfinished else found ^ expected):
            findings.add(
                KIND,
                f"{CHECKSUMS}: expected entries of the dataset's {len(expected)} files or scenes, {len(different)} are "
                f"missing or unexpected: {', '.join(different[:3])}",
            )
    return replace(sums, outdated=contents.tables - sums.files.keys()) if contents.unfinished else sums


def check_sums(
    root: Path, files: Mapping[str, FileSum], missing: frozenset[str], where: str, findings: Findings, *, hashes: bool
) -> int:
    """Compare the files, apart from missing ones, with their sums in ``where``; without ``hashes`` their sizes only.

    Returns
    -------
    The number of files that differ.
    """
    wrong = 0
    for name, expected in files.items():
        if name in missing:
            continue
        try:
            if hashes:
                same = hash_of(root, name, expected.size) == expected.sha256
            else:
                with opened(root, name) as (_, size):
                    same = size == expected.size
            problem = f"{name}: its sha256 or size is not the one in {where}: the file was changed or damaged"
        except DamagedFile as damage:
            same, problem = False, str(damage)
        if not same:
            wrong += 1
            findings.add(KIND, problem)
    return wrong
