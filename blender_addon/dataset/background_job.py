"""Runs one script of the project at a time in a separate background Blender, follows its progress and stops it.

The job belongs to this Blender process: its input ends with the process, however that ends, and the script then stops.
What the script and the rest of the pipeline say is put in the words of the window.
"""

import os
import re
import subprocess
import sys
import textwrap
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy

from ..class_registration import at_end, timers
from ..pipeline.dataset.options import OPTIONS
from ..pipeline.errors import InputError, RunError
from ..pipeline.process.command_line import EXIT_STOPPED, script_command
from ..pipeline.progress import ProgressLine, read_progress
from ..state.events import areas

POLL_SECONDS = 0.25
STOP_SECONDS = 8.0
"""Time for the script to end by itself before it is killed; longer than it needs."""

POPUP_CHARACTERS = 90

LOW_PRIORITY = 10
"""Priority of the script and its workers on POSIX: keeps the window responsive."""


@dataclass
class BackgroundJob:
    """A run of a script.

    Attributes
    ----------
    out
        The output folder.
    progress
        The latest progress; ``None`` before the first.
    lines
        The latest other lines of its output.
    code
        The exit code; ``None`` while the script runs.
    error
        The error message; empty if there is no error.
    cancelled
        Whether the user has stopped it.
    """

    out: Path
    process: subprocess.Popen = field(repr=False)
    progress: ProgressLine | None = None
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=20))
    code: int | None = None
    error: str = ""
    cancelled: bool = False
    _reader: threading.Thread | None = None

    @classmethod
    def start(cls, script: str, arguments: Sequence[str], out: Path) -> "BackgroundJob":
        """Start a script of the project, named such as ``render_dataset.py``, with arguments."""
        command = [*script_command(str(script_path(script))), *arguments]
        kind: dict[str, Any] = {"start_new_session": True}
        if sys.platform == "win32":
            kind = {"creationflags": subprocess.CREATE_NO_WINDOW | subprocess.BELOW_NORMAL_PRIORITY_CLASS}
        try:
            process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                encoding="utf-8",
                errors="replace",
                **kind,
            )
        except OSError as error:
            raise RunError(f"{command[0]}: cannot start a background Blender ({error.strerror})") from None
        if os.name != "nt":
            os.setpriority(os.PRIO_PROCESS, process.pid, LOW_PRIORITY)
        job = cls(out, process)
        job._reader = threading.Thread(target=job._read_output, daemon=True)
        job._reader.start()
        return job

    @property
    def running(self) -> bool:
        """Whether the script was running at the last :meth:`check`."""
        return self.code is None

    def check(self) -> bool:
        """Update ``code`` and ``error`` if the script has ended; return whether it still runs."""
        if self.running and self.process.poll() is not None:
            if self._reader is not None:
                self._reader.join(timeout=1.0)
            self.code = self.process.returncode
            if self.code != 0 and not self.cancelled:
                self.error = in_window_words(self._error_message())
        return self.running

    def cancel(self) -> None:
        """Ask the script to stop; it ends within seconds, and finished views stay."""
        self.cancelled = True
        if self.process.stdin is not None and not self.process.stdin.closed:
            self.process.stdin.close()

    def stop(self) -> None:
        """Stop the script and wait for its end; kill it if it does not end by itself."""
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

    def _error_message(self) -> str:
        reported = [line.removeprefix("error: ") for line in self.lines if line.startswith("error: ")]
        if reported:
            return reported[-1]
        if self.code == EXIT_STOPPED:
            return "the run was stopped by another program; start it again to continue"
        code = self.code or 0
        how = f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
        last = f": {self.lines[-1]}" if self.lines else ""
        return f"the background Blender {how}{last}; start the run again to continue after the finished views"


def script_path(name: str) -> Path:
    """Path of a script of the project: inside the package in the installed extension, next to it in a checkout."""
    for folder in Path(__file__).resolve().parents[1:3]:
        path = folder / "scripts" / name
        if path.is_file():
            return path
    raise RunError(f"{name}: expected this script in the add-on's folder, found none; install the add-on again")


_jobs: list[BackgroundJob] = []
"""The running job, or the last one of this session."""


def current() -> BackgroundJob | None:
    """The running job, or the last one of this session; ``None`` if there was none."""
    return _jobs[0] if _jobs else None


def is_running() -> bool:
    """Whether a job was running when it was last looked at."""
    return bool(_jobs) and _jobs[0].running


def start(script: str, arguments: Sequence[str], out: Path) -> BackgroundJob:
    """Start a job, and follow it with a timer."""
    if _jobs and _jobs[0].check():
        raise InputError(
            f"expected no other run, found one that writes to {_jobs[0].out}; wait for it, or cancel it first"
        )
    _jobs[:] = [BackgroundJob.start(script, arguments, out)]
    if not bpy.app.timers.is_registered(_follow):
        bpy.app.timers.register(_follow, first_interval=POLL_SECONDS, persistent=True)
    return _jobs[0]


def _follow() -> float | None:
    """Timer: show how far the job is; ends with it."""
    job = current()
    if job is None:
        return None
    running = job.check()
    _show(job)
    if running:
        _ask_before_quitting()
    return POLL_SECONDS if running else None


def _show(job: BackgroundJob) -> None:
    """Redraw the panel, and at the end the view; show a popup if the run has failed."""
    manager = bpy.context.window_manager
    for _window, area in areas("VIEW_3D"):
        for region in area.regions:
            if region.type == "UI" or not job.running:
                region.tag_redraw()
    # without a window Blender cannot open a menu, and reports no error
    if job.running or not job.error or bpy.app.background or not manager.windows:
        return

    def draw(menu: bpy.types.UIPopupMenu, _context: bpy.types.Context) -> None:
        for line in textwrap.wrap(job.error, POPUP_CHARACTERS):
            menu.layout.label(text=line)

    with bpy.context.temp_override(window=manager.windows[0]):
        manager.popup_menu(draw, title="The Dataset Run Has Failed", icon="ERROR")


def _ask_before_quitting() -> None:
    """Keep the file "modified" while a job runs, so that Blender asks before it quits, which would end the job.

    Only an undo step sets Blender's mark; it is removed by saving the file, and then set again.
    """
    manager = bpy.context.window_manager
    if bpy.app.background or bpy.data.is_dirty or not manager.windows:
        return
    with bpy.context.temp_override(window=manager.windows[0]):
        bpy.ops.ed.undo_push(message="Render Dataset")


def _end() -> None:
    """Stop a running job, which nobody could stop without the add-on."""
    if _jobs and _jobs[0].check():
        sys.stderr.write("OneFrame: stopping the running job; finished views stay\n")
        _jobs[0].stop()
    _jobs.clear()


_SENTENCES = (
    (" (--out)", ""),
    ("run the same command again", "press Render Dataset again"),
    ("start the run again", "press Render Dataset again"),
)


def in_window_words(message: str) -> str:
    """A message of the pipeline for the window: ``--engine cycles`` becomes ``Engine Cycles``."""
    for words, own in _SENTENCES:
        message = message.replace(words, own)
    message = re.sub(r"\boptions\.(\w+)", lambda found: _label(found[1]), message)
    # other names, such as "distance", are words as well
    message = re.sub(
        r"\b[a-z]+(?:_[a-z]+)+\b", lambda found: _label(found[0]) if found[0] in OPTIONS else found[0], message
    )
    return re.sub(r"--([a-z][a-z-]*)(?: ([a-z]+)\b)?", _named, message)


def _label(name: str) -> str:
    return OPTIONS[name].label if name in OPTIONS else name.replace("_", " ").title()


def _named(found: re.Match[str]) -> str:
    option, value = found[1].replace("-", "_"), found[2]
    known = option in OPTIONS and value in OPTIONS[option].choices
    return _label(option) + ("" if value is None else f" {value.title() if known else value}")


PARTS = (at_end(_end), timers(_follow))
