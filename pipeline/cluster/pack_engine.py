"""Shards packed by the workers of a cluster, which see the folders of the dataset and of the pack."""

import os
import platform
import queue
import secrets
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from ..dataset.folder import run_token
from ..errors import InputError, RunError
from ..packing.manifest import shard_from_json
from ..packing.shard import PackedShard, ShardOrder
from ..progress import Progress
from .call import ANSWER
from .feeder import Feeder, Pace
from .orders import Outcome
from .pack_task import PackJob
from .sources import WorkerSource

WAIT_SECONDS = 0.2


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
    failure: list[BaseException] = []

    def feed() -> None:
        try:
            feeder.run()
        except BaseException as error:  # raised where the shards are taken
            failure.append(error)
        outcomes.put(None)

    token = run_token(Path(out), run)
    token.touch()
    thread = threading.Thread(target=feed, daemon=True)
    thread.start()
    try:
        given: set[int] = set()
        while (outcome := outcomes.get()) is not None:
            for number, content in outcome.results:
                if number not in given:
                    given.add(number)
                    views += of[number]
                    yield shard_from_json(number, content, "a worker's answer")
            show(0, feeder.state())
        if failure:
            raise RunError(str(failure[0])) from None if isinstance(failure[0], InputError) else failure[0]
        progress.note("; ".join(feeder.tally.clauses("shard", "packed", feeder.workers)))
    finally:
        feeder.stop()
        thread.join(2.0)
        with suppress(OSError):
            token.unlink(missing_ok=True)
