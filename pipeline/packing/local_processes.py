"""Shards packed by several processes of this machine."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.sharedctypes import Synchronized
from typing import Any

from ..errors import RunError
from .shard import PackedShard, ShardOrder, pack_shard

POLL_SECONDS = 0.2


def packed_locally(
    orders: Sequence[ShardOrder], on_view: Callable[[], None], *, workers: int = 0
) -> Iterator[PackedShard]:
    """Pack shards, in any order; the processes end with this one, however it ends.

    Parameters
    ----------
    orders
        The shards.
    on_view
        Called here after each view that any process has packed.
    workers
        Number of processes; 0 for one a core.

    Raises
    ------
    RunError
        A shard cannot be packed; those that were given before are there.
    """
    workers = min(workers or os.cpu_count() or 1, len(orders))
    if workers <= 1:
        for order in orders:
            yield pack_shard(order, on_view)
        return
    # a forked process would inherit locks of other threads
    context = multiprocessing.get_context("spawn")
    views = context.Value("q", 0)
    pool = ProcessPoolExecutor(workers, context, initializer=_begin, initargs=(views,))
    try:
        waiting = {pool.submit(_pack, order) for order in orders}
        shown = 0
        while waiting:
            done, waiting = wait(waiting, POLL_SECONDS, FIRST_COMPLETED)
            while shown < views.value:
                shown += 1
                on_view()
            yield from map(_result, done)
    finally:
        _stop(pool)


def _result(future: Future[PackedShard]) -> PackedShard:
    try:
        return future.result()
    except BrokenProcessPool:
        raise RunError(
            "a process that packs was killed, perhaps for lack of memory; the shards packed so far are safe: run the "
            "same command again, with fewer --workers if need be"
        ) from None


def _stop(pool: ProcessPoolExecutor) -> None:
    """End the processes at once: what they have begun leaves nothing but a temporary file."""
    processes = list((pool._processes or {}).values())
    pool.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.terminate()
    for process in processes:
        process.join()


_views: "Synchronized[Any] | None" = None


def _begin(views: "Synchronized[Any]") -> None:
    """In a process of the pool: count views, leave signals to the parent, and end when it is gone."""
    global _views
    _views = views
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if hasattr(signal, "SIGXFSZ"):
        # a file beyond the limit (ulimit -f) is an error like a full disk
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _pack(order: ShardOrder) -> PackedShard:
    return pack_shard(order, _count)


def _count() -> None:
    if _views is not None:
        with _views.get_lock():
            _views.value += 1
