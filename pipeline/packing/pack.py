"""A whole pack: what is missing of it is packed, then its tables are written; and whether one is whole."""

import json
import shutil
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import cv2

from ..dataset.checksums import damaged_file, sum_of_file
from ..dataset.layout import MANIFEST, MODEL_FOLDERS, MOST_VIEWS, ViewPaths
from ..dataset.tables.bop import write_test_targets
from ..errors import InputError, RunError
from ..files.content import create_folder, names_in, remove_abandoned, write_bytes_atomically, written_file
from ..files.machine import available_cores
from ..files.outputs import writing
from ..progress import Progress
from .layout import COPIED, KEY_TO_SHARD, TABLES, shard_name, view_key
from .manifest import Manifest, Plan, complete_manifest, read_manifest
from .shard import SAFE, write_shard
from .whole_dataset import WholeDataset, open_whole_dataset


@dataclass(frozen=True)
class PackOptions:
    """How a pack holds its views.

    Attributes
    ----------
    views_per_shard
        How many a shard has; the last one may have fewer.
    jpeg_quality
        Compress RGB as JPEG, 1..100.
    about
        A sentence for ``pack.json``, such as which part of a split the views are.
    """

    views_per_shard: int = 1000
    jpeg_quality: int | None = None
    about: str = ""


def pack_dataset(
    root: Path | str,
    out: Path | str,
    options: PackOptions | None = None,
    *,
    views: Sequence[int] | None = None,
    workers: int = 0,
    stream: TextIO | None = None,
) -> Manifest:
    """Pack a dataset, or go on where an earlier run of the same pack was stopped.

    Parameters
    ----------
    root, out
        The folders of the complete dataset and of the pack.
    options
        How; the defaults if left out.
    views
        The views in the order in which they are packed; all of them, as they are numbered, if left out.
    workers
        Number of threads, 0 for one a core: what takes time releases Python's lock.
    stream
        Of the progress.
    """
    root, out, options = Path(root), Path(out), options or PackOptions()
    quality = options.jpeg_quality
    _check_folders(root, out)
    if not 1 <= options.views_per_shard <= MOST_VIEWS:
        raise InputError(f"--views-per-shard: expected 1 to {MOST_VIEWS} views, found {options.views_per_shard}")
    if quality is not None and not 1 <= quality <= 100:
        raise InputError(f"--jpeg: expected a quality from 1 to 100, found {quality}")
    dataset = open_whole_dataset(root)
    plan = Plan(
        identity=dataset.description.identity,
        views_per_shard=options.views_per_shard,
        jpeg_quality=quality,
        opencv=None if quality is None else cv2.__version__,
        views=_checked_views(views, dataset.description.count),
        about=options.about,
    )
    known = _begun(out, plan)
    shards = dict(enumerate(plan.shards()))
    # what stands under its name is whole, unless it was damaged since
    missing = [
        number
        for number in shards
        if not (out / shard_name(number)).is_file()
        or ((own := known.files.get(shard_name(number))) and damaged_file(out, shard_name(number), own))
    ]
    stopped, done = threading.Event(), len(plan.views) - sum(len(shards[number]) for number in missing)
    with (
        Progress(len(plan.views), "views packed", finished=done, stream=stream) as progress,
        ThreadPoolExecutor(workers or available_cores()) as pool,
    ):

        def count() -> None:
            if stopped.is_set():
                raise RunError("stopped")
            progress.advance()

        written = [
            pool.submit(write_shard, dataset, shards[number], quality, out / shard_name(number), count)
            for number in missing
        ]
        try:
            for shard in written:
                shard.result()
        finally:
            # what is begun leaves nothing
            stopped.set()
            pool.shutdown(cancel_futures=True)
    return _finished(dataset, out, plan)


def verify_pack(folder: Path, *, threads: int = 1, stream: TextIO | None = None) -> list[str]:
    """Compare all files of a complete pack with their size and hash; what is wrong, in clauses."""
    files = complete_manifest(folder).files
    with Progress(len(files), "files verified", stream=stream) as progress, ThreadPoolExecutor(threads) as pool:

        def problem(name: str) -> str | None:
            found = damaged_file(folder, name, files[name], hashes=True)
            progress.advance()
            return found

        return [each for each in pool.map(problem, files) if each is not None]


def _check_folders(root: Path, out: Path) -> None:
    whole, packed = root.resolve(), out.resolve()
    if whole == packed or whole in packed.parents or packed in whole.parents:
        raise InputError(
            f"{out}: expected a folder for the pack beside that of the dataset ({root}), found one within the other; "
            "choose another folder (--out)"
        )


def _checked_views(views: Sequence[int] | None, count: int) -> tuple[int, ...]:
    if views is None:
        return tuple(range(count))
    chosen = tuple(int(view) for view in views)
    if not chosen or len(set(chosen)) != len(chosen) or min(chosen) < 0 or max(chosen) >= count:
        raise InputError(f"views to pack: expected different numbers from 0 to {count - 1}, found others or none")
    return chosen


def _begun(out: Path, plan: Plan) -> Manifest:
    """Begin a pack in a new folder, or go on with one of the same plan; what is known of its files."""
    if (out / MANIFEST).is_file():
        known = read_manifest(out)
        changes = [
            f"{name} was {_short(was)}, is {_short(getattr(plan, name))}"
            for name, was in known.plan.__dict__.items()
            if was != getattr(plan, name)
        ]
        if changes:
            raise RunError(
                f"{out}: the folder holds another pack ({'; '.join(changes)}); undo the change to resume it, or choose "
                "another folder (--out)"
            )
    else:
        with writing(out, SAFE):
            create_folder(out)
            remove_abandoned(out)
            if others := names_in(out):
                raise RunError(
                    f"{out}: expected a new or empty folder or a pack to resume, found other files (such as "
                    f"{min(others)}); choose another folder (--out)"
                )
            known = Manifest(plan)
            known.write(out)
    with writing(out, SAFE):
        for name in ("", *MODEL_FOLDERS):
            remove_abandoned(out / name)
    return known


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 60 else f"{text[:60]}…"


def _finished(dataset: WholeDataset, out: Path, plan: Plan) -> Manifest:
    """Write everything but the shards; gives the manifest."""
    keys = {view_key(ViewPaths(out, view)): number for number, views in enumerate(plan.shards()) for view in views}
    names = [*map(shard_name, range(len(plan.shards()))), *TABLES]
    with writing(out, SAFE):
        for name in COPIED:
            create_folder((out / name).parent)
            with (dataset.root / name).open("rb") as content, written_file(out / name) as stream:
                shutil.copyfileobj(content, stream)
        write_bytes_atomically(out / KEY_TO_SHARD, (json.dumps(keys) + "\n").encode())
        write_test_targets(out, sorted(dataset.targets.intersection(plan.views)))
        manifest = Manifest(plan, {name: sum_of_file(out / name) for name in names})
        manifest.write(out)
    return manifest
