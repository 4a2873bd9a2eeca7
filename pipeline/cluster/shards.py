"""A run by the workers of a cluster: each shard is a task, and a task is the render command with ``--shard``.

Who does which, and again when a worker has died, is Dask's business. That two never write the same file, and that
nothing is rendered twice, is that of the run's folder, which all machines see.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from distributed import CancelledError, Client, TimeoutError, as_completed, get_worker

from .. import __version__
from ..dataset.run.run_folder import Shard
from ..errors import InputError, RunError
from ..files.machine import available_cores
from ..process.command_line import EXIT_INPUT, blender_command
from ..process.own_process import STOPPING_SECONDS
from ..progress import Progress

SHARDS_A_THREAD, LEAST_VIEWS = 4, 20
"""Shards for each thread of the workers, so that those that join later find some; and views of one, at least."""
RETRIES = 3
"""Dask tries so often again what has failed, as where the processes of a killed worker still end."""
LOOK_SECONDS, WAIT_SECONDS = 0.5, 10.0
_PACKAGE = Path(__file__).resolve().parents[1]
_SCRIPTS = _PACKAGE.parent / "scripts"
_FOUND_IN = _PACKAGE.parent if _PACKAGE.name == "oneframe" else _SCRIPTS
"""Where the package is found by its name: in a checkout by ``scripts/oneframe.py``."""
AGAIN = "what is finished is safe: run the same command again to continue"


def render_shards(
    client: Client, arguments: Sequence[str], token: Path, count: int, progress: Progress, *, blender: str | None = None
) -> None:
    """Have all shards of a run rendered.

    Parameters
    ----------
    client
        Connected to the scheduler of the workers.
    arguments
        Of the render command, with absolute paths.
    token
        A file beside the run's files, by which workers know that they see its folder.
    count, progress
        Number of views; counts those of finished shards.
    blender
        A Blender program on the workers' machines that renders, instead of their Python.
    """
    _wait_for_worker(client, progress)
    threads = sum(client.nthreads().values())
    shards = max(1, min(SHARDS_A_THREAD * threads, count // LEAST_VIEWS))
    futures = {
        client.submit(
            render_shard, [*arguments, f"--shard={number}/{shards}"], str(token), __version__, blender,
            retries=RETRIES, pure=False,
        ): Shard(number, shards)
        for number in range(shards)
    }  # fmt: skip
    address, finished = client.scheduler.address, 0
    try:
        for future in as_completed(futures, loop=client.loop):
            try:
                refusal = future.result()
            except CancelledError:
                raise RunError(f"the scheduler {address} no longer answers; start it, {AGAIN}") from None
            except Exception as error:  # of a task, or of Dask: whatever ended it after all retries
                which = f"shard {futures[future].index}/{shards}"
                raise RunError(f"{which}: {error or type(error).__name__}; {AGAIN}") from None
            if refusal:
                raise InputError(refusal)
            finished += len(futures[future].views(count, 1))
            progress.update(finished, f"{len(client.nthreads())} workers")
    finally:
        with suppress(OSError, TimeoutError):
            client.cancel(list(futures))


def _wait_for_worker(client: Client, progress: Progress) -> None:
    with suppress(TimeoutError):
        client.wait_for_workers(1, timeout=WAIT_SECONDS / 2)
        return
    address = client.scheduler.address
    progress.note(f"no worker is connected to {address}: waiting; start one on any machine: dask worker {address}")
    client.wait_for_workers(1)


def render_shard(arguments: Iterable[str], token: str, version: str, blender: str | None) -> str:
    """The task: what stands against the run as a sentence, or empty. What may go better elsewhere is raised."""
    worker = get_worker()
    name = f"worker {worker.address}"
    if version != __version__:
        raise RunError(f"{name} has OneFrame {__version__}, the run has {version}; install the same there")
    give_up = time.monotonic() + WAIT_SECONDS
    while not Path(token).exists():
        # a network file system shows late what another machine has written
        if time.monotonic() > give_up:
            raise RunError(f"{name} does not see {Path(token).parents[1]}; mount the shared folder there")
        time.sleep(LOOK_SECONDS)
    start = [sys.executable, "-m", "oneframe.commands", "render"]
    if blender is not None:
        start = blender_command(blender, str(_SCRIPTS / "render_dataset.py"))
    processes = max(1, available_cores() // worker.state.nthreads)
    # the same OneFrame as the worker's, which may be that of a checkout
    paths = os.pathsep.join(filter(None, [str(_FOUND_IN), os.environ.get("PYTHONPATH", "")]))
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors:
        # it ends with its input: when this worker dies
        process = subprocess.Popen(
            [*start, *arguments, f"--workers={processes}", "--end-with-input"],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=errors, env=os.environ | {"PYTHONPATH": paths},
        )  # fmt: skip
        try:
            while process.poll() is None and not _is_cancelled():
                time.sleep(LOOK_SECONDS)
        finally:
            if process.stdin is not None:
                process.stdin.close()
            with suppress(subprocess.TimeoutExpired):
                process.wait(STOPPING_SECONDS)
            process.kill()
        errors.seek(0)
        lines = errors.read().splitlines() or ["without a word"]
    code = process.wait()
    said = [line.removeprefix("error: ") for line in lines if line.startswith("error: ")] or lines
    if code == EXIT_INPUT:
        return said[-1]
    if code:
        how = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
        raise RunError(f"a render process of {name} {how} ({said[-1]})")
    return ""


def _is_cancelled() -> bool:
    """Whether nobody waits for this task any more: its run has ended."""
    worker = get_worker()
    task = worker.state.tasks.get(worker.get_current_task())
    return task is None or task.state == "cancelled"
