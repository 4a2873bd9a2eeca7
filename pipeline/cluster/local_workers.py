"""Workers on this machine: one child process runs a scheduler and starts workers, again if they are killed.

See :mod:`pipeline.cluster.scheduler_process`. The workers end with the child.
"""

import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from .scheduler_process import answer, scheduler_process


@contextmanager
def local_workers(count: int) -> Iterator[tuple[str, int]]:
    """Start workers of one thread each; they end with the context.

    Parameters
    ----------
    count
        Number of workers.

    Yields
    ------
    Address of the scheduler, and render threads for the process of each worker.

    Raises
    ------
    RunError
        They cannot be started.
    """
    import distributed

    running = scheduler_process("local_workers", str(count), distributed.__file__, where="--cluster", end_seconds=0.0)
    with running as address:
        yield address, max(1, _cores() // count)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def main(count: int) -> None:
    """Act as the child process."""
    import dask
    from distributed import LocalCluster

    dask.config.set(
        {
            # a stopped worker is given up soon, and a busy machine is no reason for a warning
            "distributed.scheduler.worker-ttl": "30s",
            "distributed.scheduler.allowed-failures": 10,
            "distributed.admin.tick.limit": "60s",
            # a worker holds the order that it does and no other: behind a slow one, an order would wait until the end
            "distributed.scheduler.worker-saturation": 1.0,
        }
    )
    cluster = LocalCluster(
        n_workers=count,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address=None,
        memory_limit=0,
        silence_logs=logging.CRITICAL,
    )
    answer(scheduler=cluster.scheduler_address)
    sys.stdin.read()
    # at once; the workers see it and end
    os._exit(0)


if __name__ == "__main__":
    main(int(sys.argv[1]))
