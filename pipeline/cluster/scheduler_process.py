"""A scheduler that runs in a child process, until the child's standard input ends: also if its parent is killed.

The child is a plain Python also where a Blender program renders, whose own start-up code does not bear Python's
``multiprocessing``.
"""

import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import RunError

START_SECONDS = 60.0
_ROOT = Path(__file__).resolve().parents[2]


@contextmanager
def scheduler_process(module: str, argument: str, package: str, *, where: str, end_seconds: float) -> Iterator[str]:
    """Run a module as a child process that starts a scheduler; it ends with the context.

    Parameters
    ----------
    module, argument
        The module of this room that the child runs, and its argument.
    package
        File of a package that the child needs, wherever this process has it from.
    where
        Begins messages.
    end_seconds
        Time that the child has to end after its input has ended; then it is killed.

    Yields
    ------
    Address of the scheduler.

    Raises
    ------
    RunError
        It cannot be started, or says why it cannot go on.
    """
    paths = [str(_ROOT), str(Path(package).parents[1])]
    environment = {"PYTHONPATH": os.pathsep.join(filter(None, [os.environ.get("PYTHONPATH", ""), *paths]))}
    try:
        child = subprocess.Popen(
            [sys.executable, "-m", f"pipeline.cluster.{module}", argument],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            env=os.environ | environment,
            # Ctrl-C reaches only the command, which ends this process
            start_new_session=os.name != "nt",
        )
    except OSError as error:
        raise RunError(f"{where}: cannot start {sys.executable} ({error.strerror})") from None
    try:
        yield _address(child, where)
    finally:
        if child.stdin is not None:
            child.stdin.close()
        try:
            child.wait(end_seconds)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def answer(**content: str) -> None:
    """In the child: give the address of the scheduler as ``scheduler``, or why there is none as ``refused``."""
    sys.stdout.write(json.dumps(content) + "\n")
    sys.stdout.flush()


def _address(child: subprocess.Popen[str], where: str) -> str:
    late = threading.Timer(START_SECONDS, child.kill)
    late.start()
    try:
        for line in child.stdout or ():
            if line.startswith("{"):
                content = json.loads(line)
                if "refused" in content:
                    raise RunError(f"{where}: {content['refused']}")
                return str(content["scheduler"])
    finally:
        late.cancel()
    child.kill()
    lines = (child.stderr.read() if child.stderr else "").strip().splitlines()
    raise RunError(
        f"{where}: no scheduler could be started on this machine ({lines[-1] if lines else 'no answer'}); "
        "correct this, or render without --cluster"
    )
