"""A feeder at work in the background, and the token in its folder by which workers know that they see it."""

import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ..dataset.folder import run_token
from .feeder import Feeder

ENDING_SECONDS = 2.0
"""Longest time that each step of stopping may take: the command that is stopped ends soon."""


class Feeding:
    """Runs a feeder from its creation to :meth:`stop`."""

    def __init__(
        self,
        feeder: Feeder,
        folder: Path,
        *,
        before: Callable[[], None] = lambda: None,
        on_end: Callable[[], None] = lambda: None,
    ) -> None:
        """Write the token into a folder of a run, and begin.

        Parameters
        ----------
        feeder
            Hands out the orders.
        folder
            The folder of the run.
        before
            Called before the feeder runs, in its thread.
        on_end
            Called when the feeder has ended in any way, in its thread.
        """
        self._feeder, self._before, self._on_end = feeder, before, on_end
        self._failure: BaseException | None = None
        self._token = run_token(folder, feeder.name)
        self._token.touch()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def wait(self) -> None:
        """Wait for the feeder's end; whatever it raised is raised here."""
        self._thread.join()
        if self._failure is not None:
            raise self._failure

    def stop(self) -> None:
        """Stop the feeder, and remove the token."""
        self._feeder.stop()
        self._thread.join(ENDING_SECONDS)
        with suppress(OSError):
            self._token.unlink(missing_ok=True)

    def _run(self) -> None:
        try:
            self._before()
            self._feeder.run()
        except BaseException as error:  # raised where somebody waits
            self._failure = error
        self._on_end()
