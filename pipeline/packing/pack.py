"""A whole pack: what is missing of it is packed, and then its tables are written."""

import json
import shutil
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import cv2

from ..dataset.checksums import FileSum, sum_of_file
from ..dataset.layout import MANIFEST, MOST_VIEWS, ViewPaths
from ..dataset.tables.bop import write_test_targets
from ..errors import InputError, RunError
from ..files.content import create_folder, write_bytes_atomically, written_file
from ..files.machine import available_cores
from ..files.outputs import writing
from ..files.tables import write_json
from ..progress import Progress
from .layout import (
    COPIED,
    INFO,
    KEY_TO_SHARD,
    TABLES,
    TARGETS,
    shard_name,
    view_key,
)
from .manifest import Manifest, Plan
from .pack_folder import PackFolder
from .pack_info import pack_info
from .shard import SAFE, ShardOrder, pack_shard
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
        A paragraph for ``dataset_info.md``, such as which part of a split the views are.
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

    Raises
    ------
    InputError
        No complete dataset, folders within each other, or views that the dataset does not have.
    RunError
        A view is damaged, or the pack cannot be written; finished shards are kept.
    """
    root, out = Path(root), Path(out)
    options = options or PackOptions()
    views_per_shard, jpeg_quality = options.views_per_shard, options.jpeg_quality
    _check_folders(root, out)
    if not 1 <= views_per_shard <= MOST_VIEWS:
        raise InputError(f"--views-per-shard: expected 1 to {MOST_VIEWS} views, found {views_per_shard}")
    if jpeg_quality is not None and not 1 <= jpeg_quality <= 100:
        raise InputError(f"--jpeg: expected a quality from 1 to 100, found {jpeg_quality}")
    dataset = open_whole_dataset(root)
    plan = Plan(
        identity=dataset.description.identity,
        views_per_shard=views_per_shard,
        jpeg_quality=jpeg_quality,
        opencv=None if jpeg_quality is None else cv2.__version__,
        views=_checked_views(views, dataset.description.count),
    )
    with PackFolder(out, plan) as folder:
        shards = folder.finished()
        done = sum(len(views) for number, views in enumerate(plan.shards()) if number in shards)
        orders = [order for order in shard_orders(dataset, out, plan) if order.number not in shards]
        with Progress(len(plan.views), "views packed", finished=done, stream=stream) as progress:
            for number, known in _packed(orders, progress, workers):
                with writing(out / shard_name(number), SAFE):
                    folder.keep(number, known)
                shards[number] = known
        manifest = _write_tables(dataset, out, plan, [shards[number] for number in sorted(shards)], options.about)
        folder.finish()
    return manifest


def shard_orders(dataset: WholeDataset, out: Path, plan: Plan) -> list[ShardOrder]:
    """The orders of all shards of a pack."""
    return [
        ShardOrder(dataset.root, out, number, views, plan.identity, dataset.description.camera, plan.jpeg_quality)
        for number, views in enumerate(plan.shards())
    ]


def _packed(orders: Sequence[ShardOrder], progress: Progress, workers: int) -> Iterator[tuple[int, FileSum]]:
    """Pack shards by threads, and give number and sum of each as soon as it is there."""
    stopped = threading.Event()

    def count() -> None:
        if stopped.is_set():
            raise RunError("stopped")
        progress.advance()

    with ThreadPoolExecutor(workers or available_cores()) as pool:
        futures = [pool.submit(pack_shard, order, count) for order in orders]
        try:
            for order, future in zip(orders, futures, strict=True):
                yield order.number, future.result()
        finally:
            # what is begun leaves nothing
            stopped.set()
            pool.shutdown(cancel_futures=True)


def _write_tables(dataset: WholeDataset, out: Path, plan: Plan, shards: Sequence[FileSum], about: str) -> Manifest:
    """Write everything but the shards; gives the manifest."""
    for name in COPIED:
        with writing(out / name, SAFE):
            create_folder((out / name).parent)
            with (dataset.root / name).open("rb") as content, written_file(out / name) as stream:
                shutil.copyfileobj(content, stream)
    keys = {view_key(ViewPaths(out, view)): number for number, views in enumerate(plan.shards()) for view in views}
    with writing(out / KEY_TO_SHARD, SAFE):
        write_bytes_atomically(out / KEY_TO_SHARD, (json.dumps(keys) + "\n").encode())
    with writing(out / TARGETS, SAFE):
        write_test_targets(out, sorted(dataset.targets.intersection(plan.views)))
    with writing(out / INFO, SAFE):
        write_bytes_atomically(out / INFO, pack_info(dataset.description, plan, about))
    manifest = Manifest(plan, tuple(shards), {name: sum_of_file(out / name) for name in TABLES})
    with writing(out / MANIFEST, SAFE):
        write_json(out / MANIFEST, manifest.to_json())
    return manifest


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
