"""Progress with an estimate of the remaining time: a bar on a terminal, occasional lines elsewhere."""

import re
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Self, TextIO

LINE_SECONDS = 10.0
"""Time between lines where the output is not a terminal."""

_LINE = re.compile(
    r"(?P<count>\d+)/(?P<total>\d+) (?P<noun>[a-z ]+?)(?:, \d+ ms each, (?:(?P<left>[^(]+) left|done in [^(]+))?"
    r"(?: \(.*\))?"
)


class Progress:
    """Counts finished items and shows them: a context manager; call :meth:`advance` for each item.

    Leaving the context ends the bar's line, so that an error starts on a line of its own. Any thread may call it.
    """

    def __init__(
        self,
        total: int,
        noun: str,
        *,
        finished: int = 0,
        stream: TextIO | None = None,
        line_seconds: float = LINE_SECONDS,
    ) -> None:
        """Start at ``finished`` of ``total`` items, named ``noun`` (plural) in the output."""
        self._line_seconds = line_seconds
        self._total, self._noun, self._count, self._first = total, noun, finished, finished
        self._stream = stream or sys.stdout
        self._bar = self._stream.isatty()
        self._lock = threading.Lock()
        self._start = time.monotonic()
        self._next_line = self._start
        self._state = ""
        self._show()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        # the error that ends the context counts more than a stream that is gone
        with suppress(OSError):
            self.close()

    def advance(self) -> None:
        """Count one more finished item."""
        with self._lock:
            self._count += 1
            self._show()

    def update(self, count: int, state: str) -> None:
        """Set the number of finished items, which never goes back, and a state that the line shows in brackets."""
        with self._lock:
            had, self._state = self._count, state
            self._count = max(had, count)
            if self._count < self._total or self._count > had:
                self._show()

    def close(self) -> None:
        """End the bar's line, once."""
        if self._bar:
            self._bar = False
            self._stream.write("\n")
            self._stream.flush()

    def note(self, text: str) -> None:
        """Write a line of its own; a bar goes on below it."""
        with self._lock:
            self._stream.write((f"\r\x1b[K{text}" if self._bar else text) + "\n")
            if self._bar:
                self._next_line = 0.0
                self._show()
            self._stream.flush()

    @property
    def count(self) -> int:
        """Number of finished items."""
        return self._count

    @property
    def seconds_per_item(self) -> float:
        """Mean time of the items finished since the start, in s; 0 before the first."""
        done = self._count - self._first
        return (time.monotonic() - self._start) / done if done else 0.0

    def _show(self) -> None:
        now = time.monotonic()
        if not self._is_due(now):
            return
        self._next_line = now + (0.1 if self._bar else self._line_seconds)
        text = self._text(now)
        if self._bar:
            filled = round(30 * self._count / max(self._total, 1))
            self._stream.write(f"\r[{'#' * filled}{'.' * (30 - filled)}] {text}\x1b[K")
        else:
            self._stream.write(text + "\n")
        self._stream.flush()

    def _is_due(self, now: float) -> bool:
        return self._count == self._total or now >= self._next_line

    def _text(self, now: float) -> str:
        text = f"{self._count}/{self._total} {self._noun}"
        if self._count > self._first:
            text += f", {self.seconds_per_item * 1000:.0f} ms each, {self._remaining(now)}"
        return f"{text} ({self._state})" if self._state else text

    def _remaining(self, now: float) -> str:
        if self._count == self._total:
            return f"done in {duration(now - self._start)}"
        return f"{duration(self.seconds_per_item * (self._total - self._count))} left"


class ShareProgress(Progress):
    """The finished share of one task. What is soon done gets no line where the output is not a terminal."""

    def __init__(self, noun: str, *, stream: TextIO | None = None, line_seconds: float = LINE_SECONDS) -> None:
        """Start the task that the output names ``noun``, such as ``"of the film"`` after a number of percent."""
        self._no_line_before = time.monotonic() + line_seconds
        super().__init__(100, noun, stream=stream, line_seconds=line_seconds)

    def reach(self, share: float) -> None:
        """Note that a share, 0..1, is finished; it never goes back."""
        with self._lock:
            if int(100 * share) > self._count:
                self._count = int(100 * share)
                self._show()

    def _is_due(self, now: float) -> bool:
        return super()._is_due(now) and (self._bar or now >= self._no_line_before)

    def _text(self, now: float) -> str:
        text = f"{self._count} % {self._noun}"
        return f"{text}, {self._remaining(now)}" if self._count else text


@dataclass(frozen=True)
class ProgressLine:
    """A parsed line of :class:`Progress`: e.g. 12 of 100 "views", "8 s" left (empty if unknown)."""

    count: int
    total: int
    noun: str
    left: str


def read_progress(line: str) -> ProgressLine | None:
    """Parse a line of :class:`Progress`; ``None`` if it is something else."""
    found = _LINE.fullmatch(line.strip())
    if found is None:
        return None
    return ProgressLine(int(found["count"]), int(found["total"]), found["noun"], found["left"] or "")


def duration(seconds: float) -> str:
    """A duration in readable form: ``"8 s"``, ``"3 min 20 s"``, ``"2 h 05 min"``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
