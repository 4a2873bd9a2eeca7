"""Shards packed by the workers of a cluster, which see the folders of the dataset and of the pack."""

import os
import platform
import queue
import secrets
from collections.abc import Iterator, Sequence
from pathlib import Path

from ..errors import InputError, RunError
from ..packing.manifest import shard_from_json
from ..packing.shard import PackedShard, ShardOrder
from ..progress import Progress
from .call import ANSWER
from .feeder import Feeder, Pace
from .feeding import Feeding
from .orders import Outcome
from .pack_task import PackJob
from .sources import WorkerSource


def packed_by_cluster(
    orders: Sequence[ShardOrder], progress: Progress, *, source: WorkerSource, pace: Pace | None = None
) -> Iterator[PackedShard]:
    """Pack shards on the workers of a source, in any order: an engine for :func:`.pack_dataset`.

    Raises
    ------
    RunError
        A view is damaged, no worker can pack, or the scheduler has gone; finished shards are kept.
    """
    if not orders:
        return
    outcomes: queue.SimpleQueue[Outcome | None] = queue.SimpleQueue()
    run, first = secrets.token_hex(8), orders[0]
    root, out = os.path.abspath(first.root), os.path.abspath(first.folder)
    begun, of = progress.count, {order.number: len(order.views) for order in orders}
    views = 0

    def show(_done: int, state: str) -> None:
        progress.update(begun + views, state)

    feeder = Feeder(
        source,
        ANSWER,
        run=run,
        task="pack",
        job=PackJob(root, out, first.identity, platform.node()).to_json(),
        items=of,
        noun="shard",
        pace=pace,
        show=show,
        note=progress.note,
        on_outcome=outcomes.put,
    )
    feeding = Feeding(feeder, Path(out), on_end=lambda: outcomes.put(None))
    try:
        given: set[int] = set()
        while (outcome := outcomes.get()) is not None:
            for number, content in outcome.results:
                if number not in given:
                    given.add(number)
                    views += of[number]
                    yield shard_from_json(number, content, "a worker's answer")
            show(0, feeder.state())
        try:
            feeding.wait()
        except InputError as error:
            # here it is not the input of the command, but a view that lies in its folder
            raise RunError(str(error)) from None
        progress.note("; ".join(feeder.tally.clauses("shard", "packed", feeder.workers)))
    finally:
        feeding.stop()
