"""A script of the project in a Blender of its own, beside the user's: started, followed, stopped; one at a time.

The running job is the only state that the add-on keeps outside the scene, and it belongs to this Blender process: the
script ends when this one does, in whatever way, because its input ends then.
"""

import os
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy

from ..pipeline.blender.command_line import EXIT_STOPPED, script_command
from ..pipeline.errors import InputError, RunError
from ..pipeline.progress import ProgressLine, read_progress

POLL_SECONDS = 0.25
STOP_SECONDS = 8.0
"""The script gets this long to end by itself, a little more than it takes for that."""
LOW_PRIORITY = 10
"""Of the script and its workers: the window stays quick."""


@dataclass
class BackgroundJob:
    """A run of a script.

    Attributes
    ----------
    out
        The folder that it writes to.
    progress
        The latest line of progress, ``None`` before the first.
    lines
        The latest other lines of its output.
    code
        Its exit code, ``None`` while it runs.
    error
        What went wrong in one sentence; empty if nothing did.
    """

    out: Path
    process: subprocess.Popen = field(repr=False)
    progress: ProgressLine | None = None
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=20))
    errors: deque[str] = field(default_factory=lambda: deque(maxlen=20))
    code: int | None = None
    error: str = ""
    cancelled: bool = False
    _readers: tuple[threading.Thread, ...] = ()

    @classmethod
    def start(cls, script: str, arguments: Sequence[str], out: Path) -> "BackgroundJob":
        """Start a script of the project (its name, such as ``render_dataset.py``) with its arguments.

        Raises
        ------
        RunError
            The script is not there, or the system does not start it.
        """
        command = [*script_command(str(script_path(script))), *arguments]
        kind: dict[str, Any] = {"start_new_session": True}
        if sys.platform == "win32":
            kind = {"creationflags": subprocess.CREATE_NO_WINDOW | subprocess.BELOW_NORMAL_PRIORITY_CLASS}
        try:
            process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                encoding="utf-8",
                errors="replace",
                **kind,
            )
        except OSError as error:
            raise RunError(f"{command[0]}: cannot start a background Blender ({error.strerror})") from None
        if os.name != "nt":
            os.setpriority(os.PRIO_PROCESS, process.pid, LOW_PRIORITY)
        job = cls(out, process)
        job._readers = tuple(
            threading.Thread(target=read, daemon=True) for read in (job._read_output, job._read_errors)
        )
        for reader in job._readers:
            reader.start()
        return job

    @property
    def running(self) -> bool:
        """Whether it has not ended yet, as far as :meth:`check` has seen."""
        return self.code is None

    def check(self) -> bool:
        """Look whether it has ended; whether it still runs."""
        if self.running and self.process.poll() is not None:
            for reader in self._readers:
                reader.join(timeout=1.0)
            self.code = self.process.returncode
            if self.code != 0 and not self.cancelled:
                self.error = self._reason()
        return self.running

    def cancel(self) -> None:
        """Tell it to stop; it ends within seconds, and what it has finished stays."""
        self.cancelled = True
        if self.process.stdin is not None and not self.process.stdin.closed:
            self.process.stdin.close()

    def stop(self) -> None:
        """Stop it and wait for its end; by force if it does not end by itself."""
        self.cancel()
        try:
            self.process.wait(timeout=STOP_SECONDS)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.check()

    def _read_output(self) -> None:
        for line in self.process.stdout or ():
            progress = read_progress(line)
            if progress is not None:
                self.progress = progress
            elif line.strip():
                self.lines.append(line.strip())

    def _read_errors(self) -> None:
        for line in self.process.stderr or ():
            if line.strip():
                self.errors.append(line.strip())

    def _reason(self) -> str:
        reported = [line.removeprefix("error: ") for line in self.errors if line.startswith("error: ")]
        if reported:
            return reported[-1]
        if self.code == EXIT_STOPPED:
            return "the run was stopped from outside; start it again to go on"
        code = self.code or 0
        how = f"was ended by signal {-code}" if code < 0 else f"ended with code {code}"
        last = f": {self.errors[-1]}" if self.errors else ""
        return f"the background Blender {how}{last}; start it again to go on from the views that are finished"


def script_path(name: str) -> Path:
    """A script of the project: in the installed extension inside the package, in a checkout beside it.

    Raises
    ------
    RunError
        It is not there.
    """
    # inside the installed add-on, or beside that of a checkout
    for folder in Path(__file__).resolve().parents[1:3]:
        path = folder / "scripts" / name
        if path.is_file():
            return path
    raise RunError(f"{name}: expected this script in the add-on's folder, it is missing; install the add-on again")


_current: BackgroundJob | None = None
_listeners: list[Callable[[BackgroundJob], None]] = []


def current() -> BackgroundJob | None:
    """The job that runs, or the last one that ran in this session."""
    return _current


def start(script: str, arguments: Sequence[str], out: Path) -> BackgroundJob:
    """Start a job, and follow it by a timer.

    Raises
    ------
    InputError
        Another one still runs.
    RunError
        It cannot be started.
    """
    global _current
    if _current is not None and _current.check():
        raise InputError(f"{_current.out}: expected no other run at the same time; wait for it, or cancel it first")
    _current = BackgroundJob.start(script, arguments, out)
    if not bpy.app.timers.is_registered(_follow):
        bpy.app.timers.register(_follow, first_interval=POLL_SECONDS, persistent=True)
    return _current


def forget() -> None:
    """Forget a job that has ended; a running one stays."""
    global _current
    if _current is not None and not _current.check():
        _current = None


def on_change(listener: Callable[[BackgroundJob], None]) -> None:
    """Call ``listener(job)`` now and then while a job runs and once when it has ended, until :func:`unregister`."""
    _listeners.append(listener)


def _follow() -> float | None:
    """The timer; ends itself with the job."""
    job = _current
    if job is None:
        return None
    running = job.check()
    for listener in _listeners:
        listener(job)
    return POLL_SECONDS if running else None


def register() -> None:
    """Nothing runs yet."""


def unregister() -> None:
    """Stop what runs: without the add-on nobody could."""
    global _current
    if bpy.app.timers.is_registered(_follow):
        bpy.app.timers.unregister(_follow)
    _listeners.clear()
    if _current is not None and _current.check():
        sys.stderr.write("OneFrame: the running job is stopped; what it has finished stays\n")
        _current.stop()
    _current = None
