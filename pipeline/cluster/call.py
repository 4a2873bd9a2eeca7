"""How orders are called on a worker: by a function that any Python has.

Dask unpickles functions on the scheduler and on the worker. One of OneFrame would fail, with a message about pickles,
where OneFrame is not installed; one sent by value would crash another version of Python. ``eval`` is everywhere.
"""

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from . import doorkeeper


@dataclass(frozen=True)
class Call:
    """A function that workers call, and its arguments for a text.

    Attributes
    ----------
    function
        What Dask calls: anything that the scheduler and all workers can unpickle.
    arguments
        Makes the function's arguments.
    """

    function: Callable[..., Any]
    arguments: Callable[[str], tuple[Any, ...]]


def _doorkeeper(name: str) -> Call:
    source = inspect.getsource(doorkeeper)
    expression = f"(exec(source, scope), scope[{name!r}](text))[1]"
    return Call(eval, lambda text: (expression, {"source": source, "scope": {}, "text": text}))


ANSWER = _doorkeeper("answer")
"""Does an order: see :func:`pipeline.cluster.doorkeeper.answer`."""
END = _doorkeeper("end")
"""Ends a run: see :func:`pipeline.cluster.doorkeeper.end`."""
