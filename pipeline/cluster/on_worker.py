"""What a run has on each worker: a plugin of Dask that opens there what orders need, and ends with run or worker.

A task of Dask adds the plugin to each worker. Dask's scheduler would add it by itself; but a worker that joins without
OneFrame would then not start, and the plugin would outlive a killed run.

What stands against a run is an answer, and ends a matter: an ``InputError`` for all workers, a ``RunError`` for this
one. What is raised is tried again by Dask.
"""

import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from distributed import Worker, WorkerPlugin, get_worker
from distributed.utils import sync

from ..dataset.run.work_folder import run_token
from ..errors import InputError, RunError

LOOK_SECONDS = 10.0
"""A network file system shows what another machine has just written after this time at the latest."""


class LostError(RunError):
    """A process has died: worth another try."""


@dataclass
class OnWorker(WorkerPlugin):
    """The base of what runs have on workers.

    ``run`` is 16 hex digits; ``folder`` that of the run, which all workers see, or empty if each has one of its own.
    Methods raise as the module says, or :class:`LostError`.
    """

    run: str
    folder: str
    client: str = field(default_factory=platform.node, kw_only=True)

    def open(self, own_folder: Path, case: Mapping[str, bytes] | None) -> None:
        """Prepare for orders, with a folder for temporary files that does not exist."""
        raise NotImplementedError

    def do(self, items: Sequence[int]) -> dict[int, Any]:
        """Do an order, in any thread; the items that are done or found on disk, with what there is to say of each."""
        raise NotImplementedError

    def teardown(self, worker: Worker) -> None:
        """End all that was opened."""

    def check(self, instead: str) -> None:
        """Check that this worker sees the run's folder, or say what to do ``instead``."""
        token, give_up = run_token(Path(self.folder), self.run), time.monotonic() + LOOK_SECONDS
        while self.folder and not token.exists():
            if time.monotonic() > give_up:
                what = "another folder of this name" if Path(self.folder).is_dir() else "no such folder"
                raise RunError(
                    f"it does not see the folder that {self.client} writes to: {self.folder}; the machine has {what}. "
                    f"Mount the shared folder there at the same path, {instead}"
                )
            time.sleep(0.2)


def admit(plugin: OnWorker, case: Mapping[str, bytes] | None) -> int | RunError | InputError:
    """Add a run to this worker, and end a former one in its folder, which has died; the number of threads."""
    worker = get_worker()

    def opened() -> int:
        for name, other in [*worker.plugins.items()]:
            is_former = isinstance(other, OnWorker) and plugin.folder and other.folder == plugin.folder
            if is_former or name == plugin.run:
                sync(worker.loop, worker.plugin_remove, name)
        # first, so that whatever it opens ends with the worker
        sync(worker.loop, worker.plugin_add, plugin, plugin.run)
        plugin.open(Path(worker.local_directory) / f"oneframe-{plugin.run}", case)
        return worker.state.nthreads

    return _answer(opened)


def do_order(run: str, items: Sequence[int]) -> tuple[str, dict[int, Any] | RunError | InputError | None]:
    """Do an order; the worker's address, and ``None`` if it has begun anew and must be asked to admit the run again."""
    worker = get_worker()
    plugin: Any = worker.plugins.get(run)
    return worker.address, None if plugin is None else _answer(lambda: plugin.do(items))


async def leave(run: str, dask_worker: Worker) -> None:
    """Remove a run from a worker, at once."""
    if run in dask_worker.plugins:
        await dask_worker.plugin_remove(run)


def _answer(work: Callable[[], Any]) -> Any:
    try:
        return work()
    except LostError:
        raise
    except (InputError, RunError) as error:
        return error
    except OSError as error:
        return RunError(f"{error.filename or 'its disk'}: {error.strerror}")
