"""Whether a pack is whole: its hashes, its shards as another library reads them, and each view beside its dataset."""

import tarfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

from ..dataset.check.findings import Findings
from ..dataset.checksums import damaged_file
from ..dataset.dataset_file import Description, read_description
from ..dataset.layout import RECORD, ViewPaths, largest_view_file
from ..errors import InputError, RunError
from ..progress import Progress
from .colour_loss import ColourLoss, jpeg_loss
from .layout import (
    MANIFEST,
    TABLES,
    WORK,
    is_note,
    member_suffixes,
    shard_name,
    view_key,
)
from .manifest import Manifest, read_manifest
from .pack_folder import is_own_name
from .shard import PackedShard, ShardOrder, view_members
from .source import Source, open_source

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
        problem = (
            f"{MANIFEST} does not list {name}" if known is None else damaged_file(folder, name, known, hashes=True)
        )
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


@dataclass
class _ShardCheck:
    """The check of one shard, beside the dataset if its ``source`` is given; ``found`` are kinds and messages."""

    folder: Path
    manifest: Manifest
    shard: PackedShard
    description: Description | None
    source: Source | None
    found: list[tuple[str, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._name = shard_name(self.shard.number)

    def run(self, progress: Progress) -> int:
        """Check hash and members; gives the number of views that were compared with the dataset."""
        problem = damaged_file(self.folder, self._name, self.shard.sum, hashes=True)
        if problem is not None:
            self._add(DAMAGED, problem)
        compared, loss = 0, ColourLoss()
        if problem is None or (self.folder / self._name).is_file():
            for index, members in self._views():
                if self.source is not None and members is not None:
                    loss += self._compare(ViewPaths(self.source.root, index), members, self.source)
                    compared += 1
                progress.advance()
        if problem is None and compared == len(self.shard.views) and loss != self.shard.loss:
            self._add(OTHER, f"{self._name}: its loss by JPEG is not the one in {MANIFEST}: {loss}")
        return compared

    def _add(self, kind: str, message: str) -> None:
        self.found.append((kind, message))

    def _views(self) -> Iterator[tuple[int, dict[str, bytes] | None]]:
        """Each view with its members by suffix, or ``None`` if they are not all there; stops where the archive does."""
        if self.description is None:
            return
        suffixes = member_suffixes(self.description.kinds, jpeg=self.manifest.jpeg_quality is not None)
        keys = {view_key(ViewPaths(self.folder, index)): index for index in self.shard.views}
        expected = [f"{key}.{suffix}" for key in keys for suffix in suffixes]
        most = largest_view_file(*self.description.camera.size_wh)
        try:
            with tarfile.open(self.folder / self._name, "r:") as archive:
                names = [entry.name for entry in archive if entry.isreg() and entry.size <= most]
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

    def _compare(self, paths: ViewPaths, members: dict[str, bytes], source: Source) -> ColourLoss:
        """Compare the members of a view with those that the dataset makes now; gives what JPEG has lost."""
        quality, camera = self.manifest.jpeg_quality, source.description.camera
        # another OpenCV may compress to other bytes: JPEG is compared with the image
        order = ShardOrder(source.root, self.folder, 0, (paths.index,), source.description.identity, camera)
        found, loss, jpeg = dict[str, bytes](), ColourLoss(), members.get("rgb.jpg")
        try:
            found = dict(view_members(order, paths)[0])
            if quality is not None and jpeg is not None:
                loss, found["rgb.jpg"] = jpeg_loss(jpeg, found["rgb.png"], camera.shape_hw, "rgb.jpg"), jpeg
        except (InputError, RunError):
            pass  # told of its members
        for suffix, data in members.items():
            if found.get(suffix) != data:
                key = view_key(paths)
                self._add(
                    OTHER, f"{self._name}: {key}.{suffix} does not hold what the dataset does (view {paths.index})"
                )
        return loss
