"""Start, output and exit code of commands, in a Blender program or in a Python with or without the bpy module."""

import errno
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

from ..errors import InputError, RunError
from ..files.outputs import unwritable
from .own_process import (
    STDOUT,
    STOPPING_SECONDS,
    end_process,
    handle_signals,
    open_standard_streams,
    own_temporary_folder,
    print_error,
    send_to_itself,
    settle,
    stop_signal,
    stopped_message,
)

EXIT_INPUT, EXIT_RUN, EXIT_STOPPED = 2, 3, 130
EXIT_UNREAD = 141
"""As of SIGPIPE: nobody reads the output any more."""


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
    return blender_command(program, script)


def blender_command(program: str, script: str) -> list[str]:
    """The command that runs a script in a Blender program; append the script's arguments."""
    return [program, "-b", "--factory-startup", "-noaudio", "--python-exit-code", "1", "-P", script, "--"]


def end_with_input() -> None:
    """Stop this process, as Ctrl-C does, when its standard input ends: the parent closes it to stop the run, or dies.

    A thread watches the input. It kills a process that has not ended within :data:`STOPPING_SECONDS`.
    """

    def watch() -> None:
        while sys.stdin.buffer.read(4096):
            pass
        send_to_itself(signal.SIGINT)
        time.sleep(STOPPING_SECONDS)
        end_process(EXIT_STOPPED)

    threading.Thread(target=watch, daemon=True).start()


def run_script(main: Callable[[Sequence[str]], int]) -> None:
    """Run the main function of a script or command and end the process with its :func:`exit_code`."""
    open_standard_streams()
    own_temporary_folder()
    handle_signals()
    code = 1
    try:
        code = exit_code(main, script_arguments())
        sys.stdout.flush()
    except KeyboardInterrupt:
        # between the end of the command and its report
        number = stop_signal() or signal.SIGINT
        code = _fail(stopped_message(number, ""), 128 + number)
    except BrokenPipeError:
        code = code or EXIT_UNREAD
    except OSError as error:
        print_error(f"{STDOUT}: cannot write to it ({error.strerror}); choose another place")
        code = code or EXIT_RUN
    finally:
        end_process(code)


def exit_code(main: Callable[[Sequence[str]], int], argv: Sequence[str]) -> int:
    """Call a main function with its arguments; turn its exceptions into messages and exit codes.

    An error that the user can fix prints one line on standard error; a defect prints its traceback. For an
    interruption the line is the message of the ``KeyboardInterrupt``, or "stopped".

    Returns
    -------
    The value of ``main``; 2 for :class:`~oneframe.errors.InputError`, 3 for :class:`~oneframe.errors.RunError` and for
    lack of memory or files, 128 and the number of the signal for an interruption (130 for Ctrl-C), 1 for a defect.
    """
    try:
        return main(argv)
    except SystemExit as stop:  # --help
        return stop.code if isinstance(stop.code, int) else 1
    except KeyboardInterrupt as stop:
        number = stop_signal() or signal.SIGINT
        return _fail(stopped_message(number, str(stop)), 128 + number)
    except Exception as error:
        if (signalled := stop_signal()) is not None:
            # the interruption was raised inside Blender, which turns it into an error of its own
            return _fail(stopped_message(signalled, ""), 128 + signalled)
        if isinstance(error, BrokenPipeError) and error.filename == STDOUT:
            settle()
            return EXIT_UNREAD
        if isinstance(error, InputError):
            return _fail(error, EXIT_INPUT)
        if (message := str(error) if isinstance(error, RunError) else _shortage(error)) is not None:
            return _fail(message, EXIT_RUN)
        traceback.print_exc()
        return 1


def _shortage(error: Exception) -> str | None:
    """What the system refuses, if that is the cause of an error."""
    if isinstance(error, MemoryError):
        return "there is not enough memory; close other programs, or raise the limit (ulimit -v)"
    if not isinstance(error, OSError):
        return None
    if error.filename == STDOUT:
        return f"{STDOUT}: cannot write to it ({error.strerror}); choose another place"
    if error.errno in (errno.EMFILE, errno.ENFILE):
        return f"{error.filename or 'a file'}: cannot open it ({error.strerror}); raise the limit (ulimit -n)"
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS) and isinstance(error.filename, str):
        return str(unwritable(Path(error.filename), error))
    return f"{error.filename or 'the system'}: cannot be used ({error.strerror or error}); correct this and try again"


def _fail(error: object, code: int) -> int:
    settle()
    print_error(error)
    return code
