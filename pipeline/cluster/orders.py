"""Orders and their outcomes: plain JSON on the way, so that any Python and any version of Dask carries them."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Order:
    """Some items of a run for one worker.

    Attributes
    ----------
    number
        The order's own number; no other order of the run has it.
    run
        16 hex digits that name the run.
    task
        What to do: a key of :data:`pipeline.cluster.tasks.TASKS`.
    oneframe
        The version of OneFrame that the worker must have.
    job
        What all orders of the run have in common; JSON types only.
    items
        Numbers of the items, such as views.
    budget_seconds
        After this time the worker starts no further item.
    alone
        Whether items are done one at a time, because one of them may have ended a process.
    anew
        Those of the items that are done whatever is there.
    """

    number: int
    run: str
    task: str
    oneframe: str
    job: Mapping[str, Any]
    items: tuple[int, ...]
    budget_seconds: float
    alone: bool = False
    anew: tuple[int, ...] = ()

    def to_text(self) -> str:
        """The order as JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_text(cls, text: str) -> "Order":
        """Read what :meth:`to_text` has written."""
        content = json.loads(text)
        return cls(**{**content, **{name: tuple(content[name]) for name in ("items", "anew")}})


@dataclass(frozen=True)
class Outcome:
    """What became of an order.

    Attributes
    ----------
    number
        The order's number.
    worker, host
        Address of the worker, and the name of its machine.
    refused
        Why this worker cannot do any order of this run, as a sentence; else empty.
    wrong_input
        Why no worker can do this order, as a sentence; else empty.
    finished, found
        Items that were done, and those that had been done before.
    left
        Items that were not begun.
    crashed
        Items at which a process ended unexpectedly or did not go on.
    seconds
        Time that the finished items took.
    lost
        How processes were lost.
    results
        What the task says of the items that are done or found; JSON types only.
    """

    number: int
    worker: str
    host: str
    refused: str = ""
    wrong_input: str = ""
    finished: tuple[int, ...] = ()
    found: tuple[int, ...] = ()
    left: tuple[int, ...] = ()
    crashed: tuple[int, ...] = ()
    seconds: float = 0.0
    lost: tuple[str, ...] = ()
    results: tuple[Any, ...] = ()

    def to_text(self) -> str:
        """The outcome as JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_text(cls, text: str) -> "Outcome":
        """Read what :meth:`to_text` has written."""
        content = json.loads(text)
        lists = ("finished", "found", "left", "crashed", "lost", "results")
        return cls(**{**content, **{name: tuple(content[name]) for name in lists if name in content}})


@dataclass(frozen=True)
class Beat:
    """A sign of life of an order that is being done: its number, the worker's address, its state, items done so far."""

    number: int
    worker: str
    state: str
    done: int


def topic_of(run: str) -> str:
    """The topic on which workers give signs of life of a run, and ask for its case."""
    return f"oneframe-{run}"
