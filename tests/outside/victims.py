"""Processes that open files that mean harm, one after another; a process that dies or hangs is replaced."""

import json
import os
import select
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

MEGABYTES = 1024.0
"""What opening a file may take at most."""

PATIENCE_S = 30.0
"""Time after which a process is stopped: the computer may be busy."""


class Victims:
    """One process at a time, started when it is needed."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> "Victims":
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def opened(self, reader: str, path: Path) -> dict[str, Any]:
        """The answer of :mod:`victim`, or one of kind ``"dead"`` with what is known."""
        if self._process is None:
            self._start()
        process = self._process
        assert process is not None
        assert process.stdin is not None
        try:
            process.stdin.write(json.dumps({"reader": reader, "path": str(path)}) + "\n")
            process.stdin.flush()
            ready, _, _ = select.select([self._answers], [], [], PATIENCE_S)
            line = self._answers.readline() if ready else ""
        except BrokenPipeError:
            line = ""
        if line:
            return json.loads(line)
        hangs = process.poll() is None and not self._has_ended(process)
        self._end()
        self._stderr.seek(0)
        said = self._stderr.read()[-1500:].decode(errors="replace")
        return {"kind": "dead", "text": f"hangs\n{said}" if hangs else f"exit code {process.returncode}\n{said}"}

    def _start(self) -> None:
        ours, theirs = os.pipe()
        # no pipe: nobody would empty it
        self._stderr = tempfile.TemporaryFile()  # noqa: SIM115
        script = Path(__file__).with_name("victim.py")
        self._process = subprocess.Popen(
            [sys.executable, "-X", "faulthandler", str(script), str(theirs)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=self._stderr,
            text=True,
            pass_fds=(theirs,),
        )
        os.close(theirs)
        self._answers = os.fdopen(ours)

    @staticmethod
    def _has_ended(process: subprocess.Popen[str]) -> bool:
        try:
            process.wait(1)
        except subprocess.TimeoutExpired:
            return False
        return True

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._answers.close()
            self._process = None


def faults_of(answers: Iterable[tuple[str, str, dict[str, Any]]]) -> list[str]:
    """What is wrong with answers, given with the bomb's name and its file's: nothing, if all are as they should be."""
    faults = []
    for name, file, answer in answers:
        if answer["kind"] not in ("value", "sentence"):
            faults.append(f"{name}: {answer['kind']}: {answer['text']}")
            continue
        if answer["mb"] > MEGABYTES:
            faults.append(f"{name}: {answer['mb']:.0f} MB")
        text = answer.get("text", file)
        if file not in text or len(text) > 1500:
            faults.append(f"{name}: expected a sentence that names {file}, found {text[:300]!r}")
    return faults
