"""Whether a pack is whole: its hashes, its shards as another library reads them, and each view beside its dataset."""

import json
import tarfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from ..dataset.check.findings import Findings
from ..dataset.checksums import FileSum, damaged_file
from ..dataset.dataset_file import Description, read_description
from ..dataset.layout import RECORD, ViewPaths, largest_view_file
from ..errors import InputError, RunError
from ..files.content import LARGEST_FILE, read_file
from ..progress import Progress
from .colour_loss import ColourLoss
from .layout import (
    MANIFEST,
    MASKS,
    TABLES,
    WORK,
    is_note,
    member_suffixes,
    shard_name,
    view_key,
)
from .manifest import Manifest, read_manifest
from .masks import decoded_mask, mask_columns
from .pack_folder import is_own_name
from .shard import PackedShard
from .source import Source, open_source

SCENE_TABLES = {"camera.json": "scene_camera.json", "gt.json": "scene_gt.json", "gt_info.json": "scene_gt_info.json"}
"""Members that repeat an entry of a table of the dataset."""
DAMAGED, FOREIGN, OTHER = "damaged files", "foreign files", "members unlike the dataset"


@dataclass(frozen=True)
class VerifyReport:
    """The result of verifying a pack.

    Attributes
    ----------
    count, shards
        Views and shards of the pack.
    compared
        Views that were compared with the dataset.
    findings
        What is wrong; empty if the pack is whole.
    """

    count: int
    shards: int
    compared: int
    findings: Findings

    def summary(self) -> str:
        """The result as one line."""
        name = f"pack of {self.count} views in {self.shards} shard{'s' * (self.shards != 1)}"
        if self.findings:
            wrong = len(self.findings)
            return f"{name}: NOT whole, {wrong} finding{'s' * (wrong > 1)}"
        compared = f", {self.compared} views compared with the dataset" if self.compared else ""
        return f"{name}: whole (all hashes and members{compared})"


def verify_pack(
    folder: Path, root: Path | None = None, *, threads: int = 1, stream: TextIO | None = None
) -> VerifyReport:
    """Verify a pack.

    Parameters
    ----------
    folder, root
        The pack, and the dataset that it was made from, to compare every view.
    threads
        How many shards are read at a time.
    stream
        Of the progress.

    Raises
    ------
    InputError
        No complete pack, or no complete dataset, or another one.
    """
    if not (folder / MANIFEST).is_file():
        unfinished = (folder / WORK).is_dir()
        raise InputError(
            f"{folder}: expected a complete pack, found "
            + ("an unfinished one; run the command that packs it again" if unfinished else f"no {MANIFEST} in it")
        )
    manifest = read_manifest(folder)
    findings = Findings()
    source = None
    if root is not None:
        source = open_source(root)
        if source.description.identity != manifest.identity:
            raise InputError(
                f"{folder}: expected a pack of {root}, found one of another dataset; give the right folder"
            )
    _check_tables(folder, manifest, findings)
    description = None
    with suppress(InputError):
        description = read_description(folder / RECORD) if source is None else source.description
    checks = [_ShardCheck(folder, manifest, shard, description, source) for shard in manifest.shards]
    with (
        Progress(len(manifest.views), "views verified", stream=stream) as progress,
        ThreadPoolExecutor(threads) as pool,
    ):
        compared = sum(pool.map(lambda check: check.run(progress), checks))
    for check in checks:
        for kind, message in check.found:
            findings.add(kind, message)
    return VerifyReport(len(manifest.views), len(manifest.shards), compared, findings)


def _check_tables(folder: Path, manifest: Manifest, findings: Findings) -> None:
    """Check the files beside the shards, and that there are no others."""
    for name in sorted({*TABLES, *manifest.files}):
        known = manifest.files.get(name)
        problem = f"{MANIFEST} does not list {name}" if known is None else _changed(folder, name, known)
        if problem:
            findings.add(DAMAGED, problem)
    shards = {shard_name(shard.number) for shard in manifest.shards}
    known_names = {MANIFEST, *manifest.files, *shards, *(str(Path(name).parent) for name in manifest.files)}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if name not in known_names and not path.is_dir() and not is_note(name):
            own = is_own_name(name) and name not in shards
            findings.add(FOREIGN, f"{name}: {'this pack has no such shard' if own else 'no pack has such a file'}")
    with suppress(InputError, OSError):
        description = read_description(folder / RECORD)
        if description.identity != manifest.identity:
            findings.add(DAMAGED, f"{RECORD}: it describes another dataset than the one that {MANIFEST} names")


def _changed(folder: Path, name: str, known: FileSum) -> str | None:
    return damaged_file(folder, name, known, hashes=True)


class _ShardCheck:
    """The check of one shard."""

    def __init__(
        self,
        folder: Path,
        manifest: Manifest,
        shard: PackedShard,
        description: Description | None,
        source: Source | None,
    ) -> None:
        self.found: list[tuple[str, str]] = []
        self._folder, self._manifest, self._shard = folder, manifest, shard
        self._description, self._source = description, source
        self._most = 0 if description is None else largest_view_file(*description.camera.size_wh)
        self._name = shard_name(shard.number)
        self._jpeg = manifest.jpeg_quality is not None
        self._tables: dict[str, dict[str, Any]] = {}

    def run(self, progress: Progress) -> int:
        """Check hash and members; gives the number of views that were compared with the dataset."""
        problem = _changed(self._folder, self._name, self._shard.sum)
        if problem is not None:
            self._add(DAMAGED, problem)
        compared, loss = 0, ColourLoss()
        if problem is None or (self._folder / self._name).is_file():
            for index, members in self._views():
                if self._source is not None and members is not None:
                    loss += self._compare(ViewPaths(self._source.root, index), members)
                    compared += 1
                progress.advance()
        if problem is None and compared == len(self._shard.views) and loss != self._shard.loss:
            self._add(OTHER, f"{self._name}: its loss by JPEG is not the one in {MANIFEST}: {loss}")
        return compared

    def _add(self, kind: str, message: str) -> None:
        self.found.append((kind, message))

    def _views(self) -> Iterator[tuple[int, dict[str, bytes] | None]]:
        """Each view with its members by suffix, or ``None`` if they are not all there; stops where the archive does."""
        if self._description is None:
            return
        suffixes = member_suffixes(jpeg=self._jpeg, float_depth=self._description.float_depth)
        keys = {view_key(ViewPaths(self._folder, index)): index for index in self._shard.views}
        expected = [f"{key}.{suffix}" for key in keys for suffix in suffixes]
        try:
            with tarfile.open(self._folder / self._name, "r:") as archive:
                names = [entry.name for entry in archive if entry.isreg() and entry.size <= self._most]
                if names != expected:
                    self._describe_difference(names, expected)
                    return
                for key, index in keys.items():
                    members = {}
                    for suffix in suffixes:
                        content = archive.extractfile(f"{key}.{suffix}")
                        members[suffix] = b"" if content is None else content.read()
                    yield index, members
        except (tarfile.TarError, OSError, EOFError) as error:
            self._add(DAMAGED, f"{self._name}: no whole archive: {error}")

    def _describe_difference(self, names: list[str], expected: list[str]) -> None:
        missing = sorted(set(expected) - set(names))
        foreign = sorted(set(names) - set(expected))
        if missing:
            self._add(DAMAGED, f"{self._name}: {len(missing)} members are missing, the first is {missing[0]}")
        if foreign:
            self._add(FOREIGN, f"{self._name}: {len(foreign)} members are foreign, the first is {foreign[0]}")
        if not missing and not foreign:
            self._add(DAMAGED, f"{self._name}: its members are in another order, or some are there twice")

    def _compare(self, paths: ViewPaths, members: dict[str, bytes]) -> ColourLoss:
        """Compare the members of a view with the files of the dataset; gives what JPEG has lost."""
        loss = ColourLoss()
        for suffix, data in members.items():
            kind = suffix.partition(".")[0]
            try:
                if suffix in SCENE_TABLES:
                    same = json.loads(data) == self._entry(paths, SCENE_TABLES[suffix])
                elif kind in MASKS:
                    image = decoded_mask(read_file(paths.file(kind), self._most), paths.relative(kind))
                    height, width = image.shape
                    same = np.array_equal(image, mask_columns(data, (height, width), suffix).T)
                elif suffix == "rgb.jpg":
                    # only here: without JPEG, packing needs no OpenCV
                    from .jpeg import jpeg_loss

                    found = jpeg_loss(data, read_file(paths.file(kind), self._most), paths.relative(kind))
                    same, loss = found is not None, found or loss
                else:
                    same = data == read_file(paths.file(kind), self._most)
            except (InputError, RunError, OSError, ValueError, KeyError, TypeError):
                same = False
            if not same:
                key = view_key(paths)
                self._add(
                    OTHER, f"{self._name}: {key}.{suffix} does not hold what the dataset does (view {paths.index})"
                )
        return loss

    def _entry(self, paths: ViewPaths, table: str) -> object:
        """The entry of a view in a table of its scene."""
        path = paths.scene / table
        if str(path) not in self._tables:
            self._tables = {name: known for name, known in self._tables.items() if Path(name).parent == path.parent}
            self._tables[str(path)] = json.loads(read_file(path, LARGEST_FILE))
        return self._tables[str(path)][str(paths.image_id)]
