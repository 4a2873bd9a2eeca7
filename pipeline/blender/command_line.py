"""Arguments, output and exit code of commands, in a Blender program or in a Python with or without the bpy module.

Nothing here imports Blender, so a mistake in the arguments is reported before Blender loads.
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
from ..files.keys import nearest_name

EXIT_INPUT, EXIT_RUN, EXIT_STOPPED = 2, 3, 130
STOPPING_SECONDS = 5.0
"""Time that a stopped process has to finish the file that it is writing."""


class ArgumentParser(argparse.ArgumentParser):
    """Raises :class:`.InputError` for mistakes in the arguments; does not accept abbreviated options."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(allow_abbrev=False, **settings)

    def error(self, message: str) -> NoReturn:
        """Raise argparse's message as an :class:`.InputError`."""
        raise InputError(f"command line: {message}; --help shows all options")

    def parse(self, argv: Sequence[str]) -> argparse.Namespace:
        """Parse all arguments.

        Raises
        ------
        InputError
            An unknown option, or a missing or unusable value.
        """
        # before argparse, which would only report the option that the user misspelt as missing
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
    """Path of the Blender program that runs this code; ``None`` in a Python, with or without the bpy module."""
    # a Blender program imports bpy before any script starts
    bpy = sys.modules.get("bpy")
    return None if bpy is None or bpy.app.module else bpy.app.binary_path


def script_arguments() -> list[str]:
    """The script's own arguments: those after its name; in a Blender program, those after ``--``."""
    if blender_program() is None:
        return sys.argv[1:]
    return sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []


def script_command(script: str) -> list[str]:
    """The command that runs a script again in the same Python or Blender program; append the script's arguments."""
    program = blender_program()
    if program is None:
        return [sys.executable, script]
    return [program, "-b", "--factory-startup", "-noaudio", "--python-exit-code", "1", "-P", script, "--"]


def own_output() -> TextIO:
    """Discard Blender's own messages from now on; return a stream that still reaches the standard output."""
    sys.stdout.flush()
    # unbuffered: a buffer would fail once more at exit if the reader has gone
    raw = os.fdopen(os.dup(1), "wb", buffering=0)
    stream = io.TextIOWrapper(raw, encoding="utf-8", errors="replace", write_through=True)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)
    return stream


def end_with_input() -> None:
    """Stop this process, as Ctrl-C does, when its standard input ends: the parent closes it to stop the run, or dies.

    A thread watches the input. It kills a process that has not ended within :data:`STOPPING_SECONDS`.
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
    # the handler of a Blender program only cancels renders
    signal.signal(signal.SIGINT, signal.default_int_handler)
    code = 1
    try:
        code = exit_code(main, script_arguments())
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:
        pass  # nobody reads the output any more
    finally:
        # sys.exit inside -P runs Blender's clean-up, which takes long after many renders; that of the bpy module may
        # wait for its threads forever
        os._exit(code)


def exit_code(main: Callable[[Sequence[str]], int], argv: Sequence[str]) -> int:
    """Call a main function with its arguments; turn its exceptions into messages and exit codes.

    An error that the user can fix prints one line on standard error; a defect prints its traceback. For an
    interruption the line is the message of the ``KeyboardInterrupt``, or "stopped".

    Returns
    -------
    The value of ``main``; 2 for :class:`~pipeline.errors.InputError`, 3 for :class:`~pipeline.errors.RunError`, 130 for
    an interruption, 1 for a defect.
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
