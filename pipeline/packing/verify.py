"""Whether a pack is whole: size and hash of every file, and, beside its dataset, every shard made again."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import cv2

from ..dataset.check.findings import Findings
from ..dataset.checksums import FileSum, damaged_file
from ..dataset.dataset_file import read_description
from ..dataset.layout import MANIFEST, RECORD, datasets_in
from ..errors import InputError, RunError
from ..progress import Progress
from .layout import TABLES, WORK, is_note, shard_name
from .manifest import Manifest, read_manifest
from .pack import shard_orders
from .pack_folder import is_own_name
from .shard import ShardOrder, write_shard
from .whole_dataset import open_whole_dataset

DAMAGED, FOREIGN, OTHER = "damaged files", "foreign files", "shards unlike the dataset"


@dataclass(frozen=True)
class VerifyReport:
    """The result of verifying a pack.

    ``compared``: the shards were made again from the dataset. Without ``findings`` the pack is whole.
    """

    count: int
    shards: int
    compared: bool
    findings: Findings

    def summary(self) -> str:
        """The result as one line."""
        name = f"pack of {self.count} views in {self.shards} shard{'s' * (self.shards != 1)}"
        if self.findings:
            wrong = len(self.findings)
            return f"{name}: NOT whole, {wrong} finding{'s' * (wrong > 1)}"
        return f"{name}: whole (all hashes{', and each shard as the dataset makes it' * self.compared})"


def verify_pack(
    folder: Path, root: Path | None = None, *, threads: int = 1, stream: TextIO | None = None
) -> VerifyReport:
    """Verify a pack.

    Parameters
    ----------
    folder, root
        The pack, and the dataset that it was made from, to make every shard again and compare its hash.
    threads
        How many shards are read at a time.
    stream
        Of the progress.

    Raises
    ------
    InputError
        No complete pack, or no complete dataset, or another one; or JPEG of another version of OpenCV beside a dataset.
    """
    if not (folder / MANIFEST).is_file():
        unfinished = (folder / WORK).is_dir()
        raise InputError(
            f"{folder}: expected a complete pack, found "
            + ("an unfinished one; run the command that packs it again" if unfinished else f"no {MANIFEST} in it")
        )
    manifest = read_manifest(folder)
    shards = manifest.plan.shards()
    orders: list[ShardOrder | None] = [None] * len(shards)
    if root is not None:
        orders = [*_orders(folder, root, manifest)]
    findings = Findings()
    _check_tables(folder, manifest, findings)
    with (
        Progress(len(manifest.plan.views), "views verified", stream=stream) as progress,
        ThreadPoolExecutor(threads) as pool,
    ):

        def checked(number: int, known: FileSum, order: ShardOrder | None) -> tuple[str, str | None]:
            problem = damaged_file(folder, shard_name(number), known, hashes=True)
            if problem is None and order is not None:
                return OTHER, _unlike(order, known, progress.advance)
            for _ in shards[number]:
                progress.advance()
            return DAMAGED, problem

        for kind, problem in pool.map(checked, range(len(orders)), manifest.shards, orders):
            if problem is not None:
                findings.add(kind, problem)
    return VerifyReport(len(manifest.plan.views), len(shards), root is not None, findings)


def _orders(folder: Path, root: Path, manifest: Manifest) -> list[ShardOrder]:
    """The orders that made a pack, from its dataset."""
    dataset, plan = open_whole_dataset(root), manifest.plan
    if dataset.description.identity != plan.identity:
        raise InputError(f"{folder}: expected a pack of {root}, found one of another dataset; give the right folder")
    if plan.opencv not in (None, cv2.__version__):
        raise InputError(
            f"{folder}: OpenCV {plan.opencv} compressed its RGB, and {cv2.__version__} here may make other bytes: "
            "leave out the dataset to compare hashes alone, or install that version"
        )
    return shard_orders(dataset, folder, plan)


def _unlike(order: ShardOrder, known: FileSum, on_view: Callable[[], None]) -> str | None:
    """What is wrong with a shard beside its dataset; ``None`` if the dataset makes the same bytes."""
    name = shard_name(order.number)
    try:
        with open(os.devnull, "wb") as nowhere:
            same = write_shard(order, nowhere, on_view) == known
    except RunError as error:
        return f"{name} cannot be made again: {error}"
    return None if same else f"{name} does not hold what the dataset does"


def _check_tables(folder: Path, manifest: Manifest, findings: Findings) -> None:
    """Check the files beside the shards, and that there are no others."""
    for name in sorted({*TABLES, *manifest.files}):
        known = manifest.files.get(name)
        problem = (
            f"{MANIFEST} does not list {name}" if known is None else damaged_file(folder, name, known, hashes=True)
        )
        if problem:
            findings.add(DAMAGED, problem)
    known_names = {MANIFEST, *manifest.files, *map(shard_name, range(len(manifest.shards)))}
    # the right eye is a pack of its own
    eyes = set(datasets_in(folder)[1:])
    for path in sorted(path for path in folder.rglob("*") if eyes.isdisjoint(path.parents)):
        name = path.relative_to(folder).as_posix()
        if name not in known_names and not path.is_dir() and not is_note(name):
            what = "this pack has no such shard" if is_own_name(name) else "no pack has such a file"
            findings.add(FOREIGN, f"{name}: {what}")
    with suppress(InputError, OSError):
        if read_description(folder / RECORD).identity != manifest.plan.identity:
            findings.add(DAMAGED, f"{RECORD}: it describes another dataset than the one that {MANIFEST} names")
