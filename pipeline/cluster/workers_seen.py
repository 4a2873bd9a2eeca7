"""The workers of a run: who is there, what each does, and who is not asked because it refuses or has fallen silent."""

from collections import Counter
from collections.abc import Callable, Mapping

from ..errors import RunError
from .sources import WorkerSource, is_connected, losing_scheduler

RECENT_SECONDS = 15.0
"""A worker that has not been heard of for longer than this does nothing."""


class WorkersSeen:
    """What the client knows of the workers."""

    def __init__(self, source: WorkerSource, silence: float) -> None:
        """Know of none yet; one that has not given a sign of life for ``silence`` seconds is silent."""
        self._source, self._silence = source, silence
        self._threads: Mapping[str, int] = {}
        self._refused: dict[str, str] = {}
        self._reported: set[tuple[str, str]] = set()
        self._silent: set[str] = set()
        self._states: dict[str, tuple[str, float]] = {}
        self._lost: set[str] = set()
        self._answered = 0.0
        self._waiting_reported = self._is_lost = False
        self._none_since: float | None = None
        self.reasons: list[str] = []
        """Why workers were refused, as sentences."""

    @property
    def slots(self) -> int:
        """Threads of the workers that may be asked."""
        return sum(threads for address, threads in self._threads.items() if address not in self._shunned())

    @property
    def lost(self) -> int:
        """Number of workers that have left."""
        return len(self._lost)

    @property
    def refused(self) -> int:
        """Number of workers that have refused."""
        return len(self._refused)

    def allowed(self) -> frozenset[str] | None:
        """The workers that may be asked; ``None`` for all."""
        shunned = self._shunned()
        return frozenset(self._threads.keys() - shunned) if shunned & self._threads.keys() else None

    def _shunned(self) -> set[str]:
        return self._refused.keys() | self._silent

    def answered(self, worker: str, host: str) -> None:
        """Note that a worker has sent an outcome."""
        self._silent.discard(worker)

    def heard(self, worker: str, state: str, now: float) -> None:
        """Note a sign of life."""
        self._states[worker] = (state, now)
        self._silent.discard(worker)

    def refuse(self, worker: str, host: str, why: str) -> str:
        """Note that a worker refuses; the line to report, once for a machine and a reason."""
        self._refused[worker] = why
        if (host, why) in self._reported:
            return ""
        self._reported.add((host, why))
        self.reasons.append(f"worker {worker} on {host}: {why}")
        return f"worker {worker} on {host} is refused: {why}"

    def look(self, now: float) -> list[str]:
        """Ask the scheduler who is there; lines to report."""
        client, found = self._source.client, None
        if is_connected(client):
            with losing_scheduler(client):
                found = dict(client.nthreads())
        if found is None:
            return []
        self._answered = now
        gone = self._threads.keys() - found.keys()
        lines = [f"worker {worker} has gone; its orders go to others" for worker in sorted(gone - self._refused.keys())]
        self._lost |= gone - self._refused.keys()
        for worker in gone:
            self._states.pop(worker, None)
            self._silent.discard(worker)
        self._threads = found
        return lines

    def check(self, now: float, since: float, no_worker: float, gone: float, note: Callable[[str], None]) -> None:
        """Say that there is no worker, or stop.

        Parameters
        ----------
        now, since
            The time, and that of the run's start, in s.
        no_worker, gone
            Time after which it is said that there is no worker, and after which the scheduler has gone.
        note
            Gets a line.

        Raises
        ------
        RunError
            The scheduler has gone, or all workers refuse.
        """
        client = self._source.client
        if client.status == "closed" or now - max(self._answered, since) > gone:
            raise RunError(
                f"the scheduler {self._source.address} no longer answers; what is finished is safe: start the "
                "scheduler and run the same command again to continue"
            )
        if is_connected(client) == self._is_lost:
            self._is_lost = not self._is_lost
            note(
                f"the scheduler {self._source.address} " + ("does not answer: waiting" if self._is_lost else "is back")
            )
        if self._is_lost:
            return
        usable = self._threads.keys() - self._refused.keys()
        if usable:
            self._waiting_reported, self._none_since = False, None
            return
        self._none_since = now if self._none_since is None else self._none_since
        waited = now - self._none_since
        if self._threads and (not self._source.can_join or waited > no_worker):
            raise RunError(f"all workers are refused: {'; '.join(self.reasons[:4])}")
        if not self._threads and waited > no_worker and not self._waiting_reported:
            self._waiting_reported = True
            note(f"no worker is connected to {self._source.address}: waiting; {self._source.no_workers}")

    def silent(self, now: float, heard: Mapping[str, float]) -> set[str]:
        """Workers that have begun an order and fallen silent, from the last sign of life of each.

        Until they are heard of again, they are not asked.
        """
        silent = {worker for worker, last in heard.items() if now - last > self._silence}
        self._silent |= silent
        return silent

    def state(self, now: float) -> str:
        """The states of all workers: "6 workers: 5 rendering, 1 starting; 1 refused"."""
        usable = self._threads.keys() - self._shunned()
        states = Counter(self._state(worker, now) for worker in usable)
        many = len(usable)
        parts = [f"{many} worker{'s' * (many != 1)}"]
        if many:
            parts[0] += ": " + ", ".join(f"{count} {state}" for state, count in states.most_common())
        others = {"refused": self.refused, "silent": len(self._silent), "lost": self.lost}
        if text := ", ".join(f"{count} {state}" for state, count in others.items() if count):
            parts.append(text)
        return "; ".join(parts)

    def _state(self, worker: str, now: float) -> str:
        state, last = self._states.get(worker, ("", 0.0))
        return state if state and now - last < RECENT_SECONDS else "waiting"
