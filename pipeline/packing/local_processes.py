"""Shards packed by several processes of this machine."""

import os
import pickle
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from typing import BinaryIO, cast

from ..errors import RunError
from ..files.machine import available_cores
from .shard import PackedShard, ShardOrder, pack_shard

_ROOT = Path(__file__).resolve().parents[2]
_Message = PackedShard | Exception | None
"""A finished shard, what stopped one, or ``None`` for a view."""


def packed_locally(
    orders: Sequence[ShardOrder], on_view: Callable[[], None], *, workers: int = 0
) -> Iterator[PackedShard]:
    """Pack shards, in any order; the processes end with this one, however it ends.

    Parameters
    ----------
    orders
        The shards.
    on_view
        Called after each view that any process has packed.
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
    messages: SimpleQueue[_Message] = SimpleQueue()
    waiting = deque(orders)
    processes = [_started() for _ in range(workers)]
    threads = [threading.Thread(target=_serve, args=(child, waiting, messages)) for child in processes]
    for thread in threads:
        thread.start()
    failure: Exception | None = None
    left = len(orders)
    try:
        while left and failure is None:
            message = messages.get()
            if message is None:
                on_view()
            elif isinstance(message, PackedShard):
                left -= 1
                yield message
            else:
                failure = message
    finally:
        waiting.clear()
        for child in processes:
            # what it has begun leaves nothing but a temporary file
            child.kill()
            child.wait()
        for thread in threads:
            thread.join()
    if failure is not None:
        while not messages.empty():
            message = messages.get()
            if isinstance(message, PackedShard):
                yield message
        raise failure


def _started() -> subprocess.Popen[bytes]:
    paths = [str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return subprocess.Popen(
        [sys.executable, "-m", f"{__package__}.packing_process"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        # threads of OpenBLAS take memory each
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths), "OPENBLAS_NUM_THREADS": "1"},
        # Ctrl-C is for this process, which ends the others
        start_new_session=True,
    )


def _serve(child: subprocess.Popen[bytes], waiting: "deque[ShardOrder]", messages: "SimpleQueue[_Message]") -> None:
    """In a thread of its own: give orders to a process and pass on what it reports, until there are no more orders."""
    given, reports = cast(BinaryIO, child.stdin), cast(BinaryIO, child.stdout)
    # what a killed process has not read can no longer be written when the stream is closed
    with suppress(BrokenPipeError), given, reports:
        try:
            while waiting:
                pickle.dump(waiting.popleft(), given)
                given.flush()
                while (message := pickle.load(reports)) is None:
                    messages.put(None)
                messages.put(message)
        except IndexError:
            return  # another thread was quicker, or the run has ended
        except (EOFError, OSError, pickle.UnpicklingError):
            messages.put(
                RunError(
                    "a process that packs has been killed, perhaps for lack of memory; the shards packed so far are "
                    "safe: run the same command again, with fewer --workers if need be"
                )
            )
        except Exception as error:  # raised by the main thread, which waits for a message
            messages.put(error)
