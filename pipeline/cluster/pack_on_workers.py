"""Shards packed by the workers of a cluster, which see the folders of the dataset and of the pack."""

import os
import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2

from ..dataset.dataset_file import read_description
from ..dataset.layout import RECORD
from ..errors import InputError, RunError
from ..packing.manifest import shard_from_json, shard_to_json
from ..packing.pack_folder import keep_shard, kept_shard
from ..packing.shard import PackedShard, PackWriteError, ShardOrder, pack_shard
from ..progress import Progress
from .on_worker import OnWorker
from .orders import Orders
from .sources import WorkerSource


@dataclass
class PackOnWorker(OnWorker):
    """What packs on one worker, which is its own process: all shards by their numbers, and JPEG's version of OpenCV."""

    shards: Mapping[int, ShardOrder]
    opencv: str | None

    def open(self, own_folder: Path, case: Mapping[str, bytes] | None) -> None:
        """Check the folders, and OpenCV if it is needed."""
        self.check("choose one that all machines see (--out), or pack without --cluster")
        order = next(iter(self.shards.values()))
        if read_description(order.root / RECORD).identity != order.identity:
            raise RunError(
                f"{order.root}: expected the dataset that {self.client} packs, found another one; mount the shared "
                "folder there at the same path"
            )
        if self.opencv not in (None, cv2.__version__):
            raise RunError(
                f"it has OpenCV {cv2.__version__}, and the pack's JPEG files are those of OpenCV {self.opencv}; "
                "install that version there"
            )

    def do(self, items: Sequence[int]) -> dict[int, Any]:
        """Pack shards."""
        contents = {}
        for number in items:
            order = self.shards[number]
            shard = kept_shard(order.folder, number, order.views)
            if shard is None:
                try:
                    shard = pack_shard(order)
                except PackWriteError:
                    raise
                except RunError as error:
                    # a view is damaged, which every worker would find
                    raise InputError(str(error)) from None
                keep_shard(order.folder, shard)
            contents[number] = shard_to_json(shard)
        return contents


def packed_by_cluster(
    orders: Sequence[ShardOrder], progress: Progress, *, source: WorkerSource
) -> Iterator[PackedShard]:
    """Pack shards on the workers of a source, in any order: an engine for :func:`.pack_dataset`.

    Raises
    ------
    RunError
        A view is damaged, no worker can pack, or the scheduler has gone; finished shards are kept.
    """
    if not orders:
        return
    shards = {
        order.number: replace(order, root=order.root.absolute(), folder=order.folder.absolute()) for order in orders
    }
    opencv = None if orders[0].jpeg_quality is None else cv2.__version__
    plugin = PackOnWorker(secrets.token_hex(8), os.path.abspath(orders[0].folder), shards, opencv)
    given = Orders(source, plugin, shards, progress)
    with closing(given.outcomes()) as outcomes:
        try:
            for done in outcomes:
                for number, content in done.items():
                    yield shard_from_json(number, content, "a worker's answer")
                    progress.update(progress.count + len(shards[number].views), given.state())
        except InputError as error:
            # here it is not the input of the command, but a view that lies in its folder
            raise RunError(str(error)) from None
    progress.note(f"{len(shards)} shards packed by {given.state()}")
