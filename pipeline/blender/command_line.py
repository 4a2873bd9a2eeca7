"""Arguments, output and exit code of commands, under any Python: Blender's program, its module, or neither.

Nothing here imports Blender: a mistake in the arguments is reported before it is loaded.
"""

import _thread
import argparse
import io
import itertools
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Any, NoReturn, TextIO

from ..errors import InputError, RunError
from ..files.tables import nearest_name

EXIT_INPUT, EXIT_RUN, EXIT_STOPPED = 2, 3, 130
STOPPING_SECONDS = 5.0
"""A process that is asked to stop gets this long to finish what it is writing."""


class ArgumentParser(argparse.ArgumentParser):
    """Reports mistakes in the arguments as all others are reported; options cannot be abbreviated."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(allow_abbrev=False, **settings)

    def error(self, message: str) -> NoReturn:
        """Called by argparse with what is wrong."""
        raise InputError(f"command line: {message}; --help shows all options")

    def parse(self, argv: Sequence[str]) -> argparse.Namespace:
        """Parse all arguments.

        Raises
        ------
        InputError
            An unknown option, a missing or an unusable value.
        """
        # before argparse, which would only say that the option that was meant is missing
        self._check_names(itertools.takewhile(lambda argument: argument != "--", argv))
        arguments, unknown = self.parse_known_args(argv)
        self._check_names(unknown)
        if unknown:
            raise InputError(f"command line: unknown argument {unknown[0]!r}; --help shows all options")
        return arguments

    def _check_names(self, arguments: Iterable[str]) -> None:
        known = tuple(option for action in self._actions for option in action.option_strings)
        for argument in arguments:
            name = argument.partition("=")[0]
            if name.startswith("--") and " " not in name and name not in known:
                raise InputError(f"command line: unknown argument {name!r}; {nearest_name(name, known)}")


def blender_program() -> str | None:
    """Path of the Blender program that runs this code; ``None`` under a Python, with or without the bpy module."""
    # the program has loaded it before any script starts; a Python may never do so
    bpy = sys.modules.get("bpy")
    return None if bpy is None or bpy.app.module else bpy.app.binary_path


def script_arguments() -> list[str]:
    """What the user gave to the script: everything after its name; in a Blender program, everything after ``--``."""
    if blender_program() is None:
        return sys.argv[1:]
    return sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []


def script_command(script: str) -> list[str]:
    """The command that runs a script once more under the same kind of Python; its arguments follow."""
    program = blender_program()
    if program is None:
        return [sys.executable, script]
    return [program, "-b", "--factory-startup", "-noaudio", "--python-exit-code", "1", "-P", script, "--"]


def own_output() -> TextIO:
    """A stream to the standard output that Blender's own messages no longer reach: those go nowhere from now on."""
    sys.stdout.flush()
    # without a buffer, which would complain once more at the end if nobody listens any longer
    raw = os.fdopen(os.dup(1), "wb", buffering=0)
    stream = io.TextIOWrapper(raw, encoding="utf-8", errors="replace", write_through=True)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)
    return stream


def end_with_input() -> None:
    """Stop this process as Ctrl-C does when its standard input ends: the program that started it says so, or has died.

    Started in a thread; whoever stands still by then is ended a little later.
    """

    def watch() -> None:
        while sys.stdin.buffer.read(4096):
            pass
        if os.name == "nt":
            _thread.interrupt_main()
        else:
            # a signal also wakes a main thread that waits for others
            os.kill(os.getpid(), signal.SIGINT)
        time.sleep(STOPPING_SECONDS)
        os._exit(EXIT_STOPPED)

    threading.Thread(target=watch, daemon=True).start()


def run_script(main: Callable[[Sequence[str]], int]) -> None:
    """Run the main function of a script or command and end the process with its :func:`exit_code`."""
    # Blender's program has a handler of its own, which breaks off renders only
    signal.signal(signal.SIGINT, signal.default_int_handler)
    code = 1
    try:
        code = exit_code(main, script_arguments())
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:
        pass  # nobody reads the output any more
    finally:
        # Blender turns sys.exit inside -P into its own clean-up, which takes long after many renders; the module's own
        # may wait for its threads for ever
        os._exit(code)


def exit_code(main: Callable[[Sequence[str]], int], argv: Sequence[str]) -> int:
    """Call a main function with its arguments and report how it ended.

    What the user can fix is one line on the standard error; a defect shows its traceback.

    Returns
    -------
    What ``main`` returned; 2 for :class:`~pipeline.errors.InputError`, 3 for :class:`~pipeline.errors.RunError`, 130
    for an interruption, whose message is that of the ``KeyboardInterrupt`` if it has one, and 1 for a defect.
    """
    try:
        return main(argv)
    except InputError as error:
        return _fail(error, EXIT_INPUT)
    except RunError as error:
        return _fail(error, EXIT_RUN)
    except KeyboardInterrupt as stop:
        return _fail(str(stop) or "stopped", EXIT_STOPPED)
    except SystemExit as stop:  # --help
        return stop.code if isinstance(stop.code, int) else 1
    except Exception:
        traceback.print_exc()
        return 1


def _fail(error: object, code: int) -> int:
    with suppress(OSError):
        sys.stderr.write("error: " + " ".join(str(error).split()) + "\n")
    return code
