"""Workers in jobs of Slurm: one child process runs a scheduler and submits the jobs by dask-jobqueue.

See :mod:`pipeline.cluster.scheduler_process`. The child cancels its jobs when it ends; workers that have lost their
scheduler end by themselves.
"""

import json
import logging
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any

from ..errors import InputError
from .scheduler_process import answer, scheduler_process

CLOSE_SECONDS = 20.0
REPLACE_SECONDS = 3.0
"""How often jobs that have ended are replaced."""


@contextmanager
def slurm_workers(settings: Any) -> Iterator[str]:
    """Submit jobs of workers, replaced if they end; all are cancelled with the context.

    Parameters
    ----------
    settings
        See :class:`.SlurmSettings`.

    Yields
    ------
    Address of the scheduler.

    Raises
    ------
    InputError
        There is no Slurm, or no dask-jobqueue.
    RunError
        No scheduler can be started, or Slurm refuses the first job.
    """
    if shutil.which("sbatch") is None:
        raise InputError(
            "--cluster slurm: expected a machine that submits to Slurm, found no sbatch; call this on a login node, or "
            "use --cluster ADDRESS"
        )
    try:
        import dask_jobqueue
    except ImportError:
        raise InputError(
            '--cluster slurm: expected the package dask-jobqueue, it is not installed; pip install "oneframe[cluster]"'
        ) from None
    running = scheduler_process(
        "slurm_workers",
        json.dumps(asdict(settings)),
        dask_jobqueue.__file__,
        where="--cluster slurm",
        # it cancels its jobs first
        end_seconds=CLOSE_SECONDS,
    )
    with running as address:
        yield address


def main(settings: dict[str, Any]) -> None:
    """Act as the child process."""
    import dask
    from dask_jobqueue import SLURMCluster

    dask.config.set(
        {
            "distributed.scheduler.worker-ttl": "30s",
            "distributed.scheduler.allowed-failures": 10,
            # no order waits behind a slow worker
            "distributed.scheduler.worker-saturation": 1.0,
        }
    )
    logging.disable(logging.CRITICAL)
    own = ["--job-name=oneframe-workers", "--output=/dev/null", "--error=/dev/null"]
    cluster = SLURMCluster(
        queue=settings["queue"],
        account=settings["account"],
        walltime=settings["walltime"],
        cores=settings["cores"],
        # a worker of one thread for each: one process renders on each core
        processes=settings["cores"],
        memory=settings["memory"],
        interface=settings["interface"],
        job_extra_directives=[*own, *settings["options"]],
        # the nodes find this program where this machine has it
        job_script_prologue=[f"export PYTHONPATH='{os.environ['PYTHONPATH']}'"],
        # Slurm watches the memory, most of which is that of processes which the worker starts
        worker_extra_args=["--memory-limit", "0"],
        scheduler_options={"dashboard_address": None},
        death_timeout=120,
    )
    refused = _refusal(cluster.job_script())
    if refused:
        answer(refused=f"Slurm refuses a job of these settings ({refused})")
        os._exit(1)
    answer(scheduler=cluster.scheduler_address)
    ended = threading.Event()

    def watch() -> None:
        sys.stdin.read()
        ended.set()

    threading.Thread(target=watch, daemon=True).start()
    while True:
        # only what is missing is submitted
        cluster.scale(jobs=settings["jobs"])
        if ended.wait(REPLACE_SECONDS):
            break
    cluster.close(timeout=CLOSE_SECONDS / 2)
    os._exit(0)


def _refusal(script: str) -> str:
    """What Slurm says against a job, without submitting it."""
    checked = subprocess.run(["sbatch", "--test-only"], input=script, capture_output=True, text=True, check=False)
    lines = checked.stderr.strip().splitlines()
    return "" if checked.returncode == 0 else lines[-1] if lines else f"sbatch ended with code {checked.returncode}"


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
