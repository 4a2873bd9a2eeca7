"""What a run on a cluster has taken, for the line at its end."""

from collections import Counter
from dataclasses import dataclass, field

from .orders import Outcome
from .workers_seen import WorkersSeen


@dataclass
class Tally:
    """Sums over the outcomes of a run.

    Attributes
    ----------
    done, found
        Items that orders did, and those that they found done, such as after a worker was lost.
    again
        Items that were handed out again because a process or a worker was lost.
    twice
        Items that two workers did, because the first one seemed to be lost.
    not_gathered
        Items that could not be brought here and were handed out again.
    orders
        Number of orders that came back.
    processes
        Number of processes that were lost.
    hosts
        Number of items that are on each machine, by its name and address.
    workers
        The workers that did any.
    """

    done: int = 0
    found: int = 0
    again: int = 0
    twice: int = 0
    not_gathered: int = 0
    orders: int = 0
    processes: int = 0
    hosts: Counter[tuple[str, str]] = field(default_factory=Counter)
    workers: set[str] = field(default_factory=set)

    def add(self, outcome: Outcome) -> None:
        """Add the items of an outcome."""
        self.done += len(outcome.finished)
        self.found += len(outcome.found)
        address = outcome.worker.rpartition("/")[2].rpartition(":")[0]
        self.hosts[outcome.host, address] += len(outcome.finished) + len(outcome.found)
        if outcome.finished:
            self.workers.add(outcome.worker)

    def clauses(self, noun: str, done: str, workers: WorkersSeen) -> list[str]:
        """What there is to say: such as "12 views rendered by 2 workers in 4 orders", and what was lost."""
        by = f"{counted(len(self.workers), 'worker')} in {counted(self.orders, 'order')}"
        others = {
            f"{self.found} found finished on a disk": self.found,
            f"{self.again} handed out again": self.again,
            f"{self.twice} {done} twice": self.twice,
            f"{self.not_gathered} could not be gathered": self.not_gathered,
            f"{counted(self.processes, 'render process', 'es')} lost": self.processes,
            f"{counted(workers.lost, 'worker')} lost": workers.lost,
            f"{counted(workers.refused, 'worker')} refused": workers.refused,
        }
        return [f"{counted(self.done, noun)} {done} by {by}", *(text for text, count in others.items() if count)]


def counted(count: int, noun: str, plural: str = "s") -> str:
    """A number with its noun: "1 worker", "2 workers"."""
    return f"{count} {noun}{plural * (count != 1)}"
