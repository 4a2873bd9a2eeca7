"""A command that gets a signal at a chosen change of the file system: the n-th, in the parent or in a worker.

Call it with the name of a signal (or ``none``), ``parent`` or ``worker``, n, ``render`` and its arguments.
Python's audit hooks tell it of every file that is created, renamed or removed, just before that is done.
"""

import os
import signal
import sys
import threading
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from oneframe.commands import render
from oneframe.process.command import run_command
from oneframe.process.command_line import run_script

CHANGES = ("os.rename", "os.remove", "os.mkdir", "os.rmdir")


def arm(name: str, place: int, out: str) -> list[int]:
    """Send this process the signal at change number ``place`` in the folder ``out``; gives the list of all changes."""
    changes: list[int] = []
    lock = threading.Lock()

    def hook(event: str, arguments: tuple) -> None:
        changed = event in CHANGES or (event == "open" and "x" in str(arguments[1]))
        if not changed or not str(arguments[0]).startswith(out):
            return
        with lock:
            changes.append(len(changes))
            hit = changes[-1] == place
        if hit and name != "none":
            os.kill(os.getpid(), getattr(signal, name))

    sys.addaudithook(hook)
    return changes


if __name__ == "__main__":
    name, who, place, _, *arguments = sys.argv[1:]
    is_worker = arguments[-1] == "--worker"
    armed = (who == "worker") == is_worker
    changes = arm(name, int(place), arguments[arguments.index("--out") + 1]) if armed else []
    sys.argv[1:] = arguments

    def run(argv: list[str]) -> int:
        render.own_command = lambda: [sys.executable, __file__, name, who, place, "render"]
        code = run_command("oneframe render", render, argv)
        if name == "none":
            sys.stderr.write(f"{len(changes)}\n")
        return code

    run_script(run)
