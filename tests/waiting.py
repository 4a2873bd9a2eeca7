"""The one wait of the tests: a machine may be as slow as it likes, so no test asserts a time; and processes."""

import subprocess
import time
from collections.abc import Callable

import psutil

PATIENCE_SECONDS = 600.0
"""After this, what a test waits for will not come."""


def wait_until(
    condition: Callable[[], object],
    process: subprocess.Popen | None = None,
    otherwise: Callable[[], object] = lambda: "it never came",
) -> None:
    """Wait for a condition, or for the end of a process.

    Parameters
    ----------
    condition
        Called until it is true.
    process
        What is to bring it about.
    otherwise
        What to say if it never is.

    Raises
    ------
    AssertionError
        It is false after :data:`PATIENCE_SECONDS`.
    """
    end = time.monotonic() + PATIENCE_SECONDS
    while not condition() and (process is None or process.poll() is None):
        if time.monotonic() > end:
            raise AssertionError(otherwise())
        time.sleep(0.02)


def is_alive(process: int) -> bool:
    """Whether a process runs; one that has ended and is not waited for does not."""
    try:
        return psutil.Process(process).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def children(parent: int) -> list[int]:
    """Processes that a process has started and that live."""
    try:
        found = psutil.Process(parent).children()
    except psutil.NoSuchProcess:
        return []
    return [child.pid for child in found if is_alive(child.pid)]
