"""Views brought from the workers' own folders into the run's, while others are being rendered."""

import queue
import threading
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from distributed import Client

from ..dataset.gathered_view import gather_view
from ..dataset.layout import ViewPaths
from ..errors import RunError
from .file_streams import OutOfReach, read_from_worker
from .orders import Outcome

AT_A_TIME = 8
"""Views that are under way."""
MOST_WAITING = 2000
"""With more finished views than this on the workers, no further orders go out."""


@dataclass(frozen=True)
class Ungathered:
    """A view that could not be fetched from a worker, and why."""

    view: int
    worker: str
    why: str


class Gatherer:
    """Fetches the views of outcomes, in the background."""

    def __init__(self, client: Client, run: str, out: Path, identity: str, kinds: Sequence[str]) -> None:
        """Prepare to fetch views of a dataset into the folder ``out``."""
        self._client, self._run, self._out, self._identity, self._kinds = client, run, out, identity, tuple(kinds)
        self._threads = ThreadPoolExecutor(AT_A_TIME, "gather")
        self._lock = threading.Lock()
        self._waiting: set[int] = set()
        self._out_of_reach: set[str] = set()
        self.failures: Counter[str] = Counter()
        """How often a worker was out of reach after it had sent an outcome."""
        self._back: queue.SimpleQueue[Ungathered] = queue.SimpleQueue()
        self._failure: OSError | None = None
        self.fetched_bytes = 0

    @property
    def waiting(self) -> int:
        """Number of views that are still on workers alone."""
        return len(self._waiting)

    def take(self, outcome: Outcome) -> None:
        """Fetch the views of an outcome."""
        self._out_of_reach.discard(outcome.worker)
        for view in (*outcome.finished, *outcome.found):
            with self._lock:
                if view in self._waiting:
                    continue
                self._waiting.add(view)
            self._threads.submit(self._fetch, outcome.worker, view)

    def given_back(self) -> Iterator[Ungathered]:
        """Views that could not be fetched; they have to be rendered again.

        Raises
        ------
        OSError
            A view cannot be written here.
        """
        if self._failure is not None:
            raise self._failure
        while True:
            try:
                ungathered = self._back.get_nowait()
            except queue.Empty:
                return
            with self._lock:
                self._waiting.discard(ungathered.view)
            yield ungathered

    def stop(self) -> None:
        """Fetch no further views."""
        self._threads.shutdown(wait=False, cancel_futures=True)

    def _fetch(self, worker: str, view: int) -> None:
        def read(name: str) -> Iterator[bytes]:
            if worker in self._out_of_reach:
                raise RunError(f"{worker}: cannot exchange files with this worker any more")
            return read_from_worker(self._client, worker, self._run, name)

        try:
            size = gather_view(ViewPaths(self._out, view), self._identity, self._kinds, read)
        except OutOfReach as error:
            with self._lock:
                self.failures[worker] += worker not in self._out_of_reach
                self._out_of_reach.add(worker)
            self._back.put(Ungathered(view, worker, str(error)))
        except RunError as error:
            self._back.put(Ungathered(view, worker, str(error)))
        except OSError as error:
            # it stays among the waiting ones, so that the run cannot end before it is raised
            self._failure = error
        else:
            with self._lock:
                self.fetched_bytes += size
                self._waiting.discard(view)
