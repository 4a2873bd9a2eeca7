"""The missing views of a run, rendered by the workers of a cluster."""

import os
import platform
import secrets
import threading
from collections.abc import Sequence
from pathlib import Path

from ..case.case_file import read_case
from ..dataset.case_parcel import case_parcel
from ..dataset.missing_views import MissingViews
from ..dataset.options import option_arguments
from ..progress import Progress
from .call import ANSWER, END
from .case_sender import CaseSender
from .feeder import Feeder, Pace
from .feeding import ENDING_SECONDS, Feeding
from .gathering import Gatherer
from .held_views import held_views
from .places_on_workers import PlacesOnWorkers
from .render_task import Limits, RenderJob
from .sources import WorkerSource, is_connected, losing_scheduler
from .tally import counted
from .worker_places import SentCase

MOST_NAMED = 50
"""Machines with views that are named at the end."""


class ClusterPool:
    """Renders views on the workers of a source."""

    def __init__(
        self,
        source: WorkerSource,
        *,
        own_command: Sequence[str],
        places: PlacesOnWorkers | None = None,
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
        places
            Where workers find the case and write to; that of the run, which they see as well, if left out.
        blender
            A Blender program on the workers' machines that renders there.
        limits, pace
            Times.
        """
        self._source, self._blender = source, blender
        self._command = tuple(own_command) if source.on_this_machine else ()
        self._places = places or PlacesOnWorkers()
        self._limits, self._pace = limits or Limits(), pace
        self._gatherer: Gatherer | None = None
        self._sender: CaseSender | None = None
        self._run = secrets.token_hex(8)
        self._out = Path()
        self._feeder: Feeder | None = None
        self._feeding: Feeding | None = None
        self.messages: list[str] = []

    def start(self, missing: MissingViews, progress: Progress) -> None:
        """Begin, in the background: see :meth:`pipeline.dataset.missing_views.ViewPool.start`."""
        self._out = out = Path(os.path.abspath(missing.out))
        client, places = self._source.client, self._places
        arguments, sent = self._case(missing, progress)
        job = RenderJob(
            case=places.case or os.path.abspath(missing.case),
            out=(places.out or "") if places.are_own else str(out),
            arguments=tuple(arguments),
            identity=missing.identity,
            kinds=missing.kinds,
            threads=self._source.threads,
            client=platform.node(),
            command=self._command,
            blender=self._blender,
            limits=self._limits,
            description=missing.description if places.are_own else None,
            sent=sent,
        )
        if places.gather:
            self._gatherer = Gatherer(client, self._run, out, missing.identity, missing.kinds)
        self._feeder = feeder = Feeder(
            self._source,
            ANSWER,
            run=self._run,
            task="render",
            job=job.to_json(),
            items=missing.views,
            # in a folder of the worker's own, nothing is known to be damaged
            anew=() if places.are_own else missing.damaged,
            pace=self._pace,
            show=lambda done, state: progress.update(missing.finished + done, state),
            note=progress.note,
            gatherer=self._gatherer,
            sender=self._sender,
        )

        def find_held() -> None:
            if places.are_own:
                feeder.found_before(held_views(client, self._run, job))

        self._feeding = Feeding(feeder, out, before=find_held)

    def _case(self, missing: MissingViews, progress: Progress) -> tuple[list[str], SentCase | None]:
        """The options for the workers, and the case that is sent to them, if it is."""
        arguments, places = option_arguments(missing.options), self._places
        mark = "--poses="
        if places.send_case:
            parcel = case_parcel(read_case(missing.case), missing.options)
            self._sender = CaseSender(self._source.client, parcel, progress.note)
            sent = SentCase(parcel.sha256, parcel.poses)
            return [text for text in arguments if not text.startswith(mark)], sent
        return [
            mark + places.poses(text[len(mark) :], missing.case) if text.startswith(mark) else text
            for text in arguments
        ], None

    def wait(self) -> bool:
        """Wait until all views are on disk: see :meth:`pipeline.dataset.missing_views.ViewPool.wait`."""
        if self._feeding is None or self._feeder is None:
            return True
        self._feeding.wait()
        clauses = self._feeder.tally.clauses("view", "rendered", self._feeder.workers)
        if self._gatherer is not None:
            clauses.append(f"{self._gatherer.fetched_bytes / 1e6:.0f} MB gathered")
        if self._sender is not None:
            clauses.append(f"the case was sent to {counted(self._sender.sent, 'worker')}")
        self.messages.append("; ".join(clauses))
        if self._places.are_own and self._gatherer is None:
            counts = self._feeder.tally.hosts.most_common()
            hosts = ", ".join(f"{host} {address} ({count})" for (host, address), count in counts[:MOST_NAMED])
            hosts += f" and {len(counts) - MOST_NAMED} more" if len(counts) > MOST_NAMED else ""
            self.messages.append(
                f"the views are in {self._places.out} of {hosts}; copy what is in these folders into {self._out} and "
                "run the same command without --cluster: it writes the tables"
            )
            return False
        return True

    def stop(self) -> None:
        """End all that still renders, at once."""
        if self._feeding is None or self._feeder is None:
            return
        self._feeder.stop()
        if self._gatherer is not None:
            self._gatherer.stop()
        if is_connected(self._source.client):
            ending = threading.Thread(target=self._end_processes, daemon=True)
            ending.start()
            ending.join(ENDING_SECONDS)
        self._feeding.stop()

    def _end_processes(self) -> None:
        # workers that have gone in the meantime have ended theirs
        client = self._source.client
        with losing_scheduler(client):
            client.run(END.function, *END.arguments(self._run), on_error="ignore")
