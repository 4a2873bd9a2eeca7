"""Shards packed by several processes of this machine."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import wait

from ..errors import RunError
from ..files.machine import available_cores
from .shard import PackedShard, ShardOrder, pack_shard


def packed_locally(
    orders: Sequence[ShardOrder], on_view: Callable[[], None], *, workers: int = 0
) -> Iterator[PackedShard]:
    """Pack shards, in any order; the processes end with this one, however it ends.

    Parameters
    ----------
    orders
        The shards.
    on_view
        Called for each view that is packed, by another process when its shard is finished.
    workers
        Number of processes; 0 for one a core.

    Raises
    ------
    RunError
        A shard cannot be packed; those that are finished have been given before.
    """
    workers = min(workers or available_cores(), len(orders))
    if workers <= 1:
        for order in orders:
            yield pack_shard(order, on_view)
        return
    others = {*multiprocessing.active_children()}
    failure: BaseException | None = None
    executor = None
    try:
        with _without_interrupts() as hide:
            executor = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _end_with_parent)
            hide()
            futures = [executor.submit(pack_shard, order) for order in orders]
        for future in as_completed(futures):
            if future.cancelled():
                continue
            if error := future.exception():
                failure = failure or error
                for other in futures:
                    other.cancel()
                continue
            shard = future.result()
            for _ in shard.views:
                on_view()
            yield shard
    finally:
        # what they have begun leaves nothing but temporary files
        for child in {*multiprocessing.active_children()} - others:
            child.kill()
        if executor is not None:
            executor.shutdown(cancel_futures=True)
    if isinstance(failure, BrokenProcessPool):
        raise RunError(
            "a process that packs has been killed, perhaps for lack of memory; the shards packed so far are safe: run "
            "the same command again, with fewer --workers if need be"
        )
    if failure is not None:
        raise failure


@contextmanager
def _without_interrupts() -> Iterator[Callable[[], object]]:
    """Put off Ctrl-C while processes are started; those that are started after the call never get it.

    It is for this process, which ends the others.
    """
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "pthread_sigmask"):
        yield lambda: None
        return
    interrupts: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    try:
        # Python's own helper process unblocks it when it starts, with the pool
        yield lambda: signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGINT, handler)
    if interrupts:
        raise KeyboardInterrupt


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=lambda: (wait([parent.sentinel]), os._exit(1)), daemon=True).start()
