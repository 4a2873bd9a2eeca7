"""Workers on this machine: one child process runs a scheduler and starts workers, again if they are killed.

The child is a plain Python also where a Blender program renders, whose own start-up code does not bear Python's
``multiprocessing``. It ends, with all its workers, when its standard input ends: also if its parent is killed.
"""

import json
import logging
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import RunError

START_SECONDS = 60.0
_ROOT = Path(__file__).resolve().parents[2]


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

    paths = [str(_ROOT), str(Path(distributed.__file__).parents[1])]
    environment = {"PYTHONPATH": os.pathsep.join(filter(None, [os.environ.get("PYTHONPATH", ""), *paths]))}
    try:
        child = subprocess.Popen(
            [sys.executable, "-m", __name__.replace(__package__ or "", "pipeline.cluster"), str(count)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            env=os.environ | environment,
            # Ctrl-C reaches only the command, which ends this process
            start_new_session=os.name != "nt",
        )
    except OSError as error:
        raise RunError(f"--cluster: cannot start {sys.executable} for workers here ({error.strerror})") from None
    try:
        yield _address(child), max(1, _cores() // count)
    finally:
        child.kill()
        child.wait()


def _address(child: subprocess.Popen[str]) -> str:
    late = threading.Timer(START_SECONDS, child.kill)
    late.start()
    try:
        for line in child.stdout or ():
            if line.startswith("{"):
                address: str = json.loads(line)["scheduler"]
                return address
    finally:
        late.cancel()
    child.kill()
    lines = (child.stderr.read() if child.stderr else "").strip().splitlines()
    raise RunError(
        f"--cluster: no workers could be started on this machine ({lines[-1] if lines else 'no answer'}); "
        "correct this, or render without --cluster"
    )


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
    sys.stdout.write(json.dumps({"scheduler": cluster.scheduler_address}) + "\n")
    sys.stdout.flush()
    sys.stdin.read()
    # at once; the workers see it and end
    os._exit(0)


if __name__ == "__main__":
    main(int(sys.argv[1]))
