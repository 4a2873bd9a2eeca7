"""Arguments and output of scripts that run in a Blender, as program or as module."""

import _thread
import argparse
import io
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, NoReturn, TextIO

import bpy

from ..errors import InputError, RunError
from ..files.tables import nearest_name

EXIT_INPUT, EXIT_RUN, EXIT_STOPPED = 2, 3, 130
STOPPING_SECONDS = 5.0
"""A process that is told to stop gets this long to finish what it is writing."""


class ArgumentParser(argparse.ArgumentParser):
    """Mistakes in the arguments are told like all others; options are not to be abbreviated."""

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
        arguments, unknown = self.parse_known_args(argv)
        if unknown:
            name = unknown[0].partition("=")[0]
            hint = nearest_name(name, tuple(option for action in self._actions for option in action.option_strings))
            raise InputError(f"command line: unknown argument {name!r}; {hint}")
        return arguments


def script_arguments() -> list[str]:
    """What the user gave to the script: after ``--`` under Blender, everything with the bpy module."""
    if bpy.app.module:
        return sys.argv[1:]
    return sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []


def script_command(script: str) -> list[str]:
    """The command that runs a script once more in the same kind of Blender; its arguments are to follow."""
    if bpy.app.module:
        return [sys.executable, script]
    return [bpy.app.binary_path, "-b", "--factory-startup", "-noaudio", "--python-exit-code", "1", "-P", script, "--"]


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
    """Run a script's main function and end the process with its exit code.

    What the user can mend is one line on the standard error; a defect shows its traceback and ends with 1.
    """
    # Blender's program has a handler of its own, which breaks off renders only
    signal.signal(signal.SIGINT, signal.default_int_handler)
    code = 1
    try:
        code = _exit_code(main)
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:
        pass  # nobody reads any longer what is told
    finally:
        # Blender turns sys.exit inside -P into its own clean-up, which takes long after many renders; the module's own
        # may wait for its threads for ever
        os._exit(code)


def _exit_code(main: Callable[[Sequence[str]], int]) -> int:
    try:
        return main(script_arguments())
    except InputError as error:
        return _fail(error, EXIT_INPUT)
    except RunError as error:
        return _fail(error, EXIT_RUN)
    except KeyboardInterrupt:
        return _fail("stopped; the same command goes on from here", EXIT_STOPPED)
    except SystemExit as stop:  # --help
        return stop.code if isinstance(stop.code, int) else 1
    except Exception:
        traceback.print_exc()
        return 1


def _fail(error: object, code: int) -> int:
    with suppress(OSError):
        sys.stderr.write("error: " + " ".join(str(error).split()) + "\n")
    return code
