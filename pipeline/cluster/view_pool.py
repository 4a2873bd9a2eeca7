"""The missing views of a run, rendered by the workers of a cluster."""

import os
import platform
import secrets
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from ..dataset.folder import run_token
from ..dataset.missing_views import MissingViews
from ..dataset.options import option_arguments
from ..errors import InputError, RunError
from ..progress import Progress
from .call import ANSWER, END
from .feeder import Feeder, Pace
from .render_task import Limits, RenderJob
from .sources import WorkerSource, is_connected, losing_scheduler

ENDING_SECONDS = 2.0
"""Longest time that telling the workers to end may take: the command that is stopped ends soon."""


class ClusterPool:
    """Renders views on the workers of a source."""

    def __init__(
        self,
        source: WorkerSource,
        *,
        own_command: Sequence[str],
        blender: str | None = None,
        limits: Limits | None = None,
        pace: Pace | None = None,
    ) -> None:
        """Prepare the pool.

        Parameters
        ----------
        source
            The workers.
        own_command
            Starts the render command on this machine; taken for workers on it.
        blender
            A Blender program on the workers' machines that renders there.
        limits, pace
            Times.
        """
        self._source, self._blender = source, blender
        self._command = tuple(own_command) if source.on_this_machine else ()
        self._limits, self._pace = limits or Limits(), pace
        self._run = secrets.token_hex(8)
        self._token: Path | None = None
        self._feeder: Feeder | None = None
        self._thread: threading.Thread | None = None
        self._failure: BaseException | None = None
        self._is_done = False
        self.messages: list[str] = []

    def start(self, missing: MissingViews, progress: Progress) -> None:
        """Begin, in the background: see :meth:`pipeline.dataset.missing_views.ViewPool.start`."""
        out = Path(os.path.abspath(missing.out))
        job = RenderJob(
            case=os.path.abspath(missing.case),
            out=str(out),
            arguments=tuple(_absolute(option_arguments(missing.options))),
            identity=missing.identity,
            kinds=missing.kinds,
            damaged=tuple(sorted(missing.damaged)),
            threads=self._source.threads,
            client=platform.node(),
            command=self._command,
            blender=self._blender,
            limits=self._limits,
        )
        self._token = run_token(out, self._run)
        self._token.touch()
        self._feeder = Feeder(
            self._source,
            ANSWER,
            run=self._run,
            task="render",
            job=job.to_json(),
            items=missing.views,
            pace=self._pace,
            show=lambda done, state: progress.update(missing.finished + done, state),
            note=progress.note,
        )
        self._thread = threading.Thread(target=self._feed, args=(self._feeder,), daemon=True)
        self._thread.start()

    def wait(self) -> None:
        """Wait until all views are on disk: see :meth:`pipeline.dataset.missing_views.ViewPool.wait`."""
        if self._thread is not None and self._feeder is not None:
            self._thread.join()
            if self._failure is not None:
                raise self._failure
            self._is_done = True
            self.messages += _told(self._feeder)

    def stop(self) -> None:
        """End all that still renders, at once."""
        if self._feeder is None or self._thread is None:
            return
        self._feeder.stop()
        if is_connected(self._source.client):
            ending = threading.Thread(target=self._end_processes, daemon=True)
            ending.start()
            ending.join(ENDING_SECONDS)
        self._thread.join(ENDING_SECONDS)
        if self._token is not None:
            with suppress(OSError):
                self._token.unlink(missing_ok=True)

    def _end_processes(self) -> None:
        # workers that have gone in the meantime have ended theirs
        client = self._source.client
        with losing_scheduler(client):
            client.run(END.function, *END.arguments(self._run), on_error="ignore")

    def _feed(self, feeder: Feeder) -> None:
        try:
            feeder.run()
        except (InputError, RunError) as error:
            self._failure = error
        except BaseException as error:  # a defect, raised where the run waits
            self._failure = error


def _absolute(arguments: list[str]) -> list[str]:
    mark = "--poses="
    return [mark + os.path.abspath(text.removeprefix(mark)) if text.startswith(mark) else text for text in arguments]


def _told(feeder: Feeder) -> list[str]:
    tally, workers = feeder.tally, feeder.workers
    by = f"{_many(len(tally.workers), 'worker')} in {_many(tally.orders, 'order')}"
    clauses = [f"{_many(tally.done, 'view')} rendered by {by}"]
    clauses += [f"{tally.found} found finished after a worker was lost"] * bool(tally.found)
    clauses += [f"{tally.again} handed out again"] * bool(tally.again)
    clauses += [f"{tally.twice} rendered twice"] * bool(tally.twice)
    lost = feeder.lost_processes.total()
    clauses += [f"{_many(lost, 'render process', 'es')} lost"] * bool(lost)
    clauses += [f"{_many(workers.lost, 'worker')} lost"] * bool(workers.lost)
    clauses += [f"{_many(workers.refused, 'worker')} refused"] * bool(workers.refused)
    return ["; ".join(clauses)]


def _many(count: int, noun: str, plural: str = "s") -> str:
    return f"{count} {noun}{plural * (count != 1)}"
