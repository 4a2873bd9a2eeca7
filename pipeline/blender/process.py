"""The process of a command: its standard streams, the signals that end it, its temporary files, its memory.

Blender leaves much of this to the system: a process that ends early would leave its temporary folder behind, a closed
stream would pass its number on to the next file that Blender opens, and a limit of memory would end it without a word.
Nothing here imports Blender.
"""

import _thread
import io
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import NoReturn, TextIO

from ..errors import RunError

STOPPING_SECONDS = 5.0
"""Time that a stopped process has to finish the file that it is writing."""
ENDING_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)
)
STDOUT = "the standard output"
"""The name of the standard output in an :class:`OSError`."""

LEAST_MEMORY = 2000 << 20
"""Address space in bytes that Blender, numpy, OpenCV and SciPy need to load, with a third to spare."""

_received: list[int] = []
_settled: list[bool] = []
_temporary: list[str] = []


def open_standard_streams() -> None:
    """Give closed standard streams the null device, so that no other file takes their numbers; never fail to print."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_RDWR)
            setattr(sys, name, os.fdopen(nowhere, "r" if name == "stdin" else "w", encoding="utf-8", errors="replace"))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # a file's name may hold characters that the terminal's encoding does not know
            stream.reconfigure(errors="backslashreplace")


class _StandardOutput(io.FileIO):
    """Unbuffered standard output whose errors name it."""

    def write(self, data: object) -> int:
        """Write all of the bytes."""
        view = memoryview(data).cast("B")  # type: ignore[arg-type]
        written = 0
        while written < len(view):
            try:
                written += super().write(view[written:]) or 0
            except OSError as error:
                raise OSError(error.errno, error.strerror, STDOUT) from None
        return written


def own_output() -> TextIO:
    """Discard Blender's own messages from now on; return a stream that still reaches the standard output.

    Raises
    ------
    OSError
        From the stream, with the file name :data:`STDOUT`: it is closed or full.
    """
    sys.stdout.flush()
    # unbuffered: a buffer would fail once more at exit if the reader has gone
    raw = _StandardOutput(os.dup(1), "wb")
    stream = io.TextIOWrapper(raw, encoding="utf-8", errors="replace", write_through=True)  # type: ignore[type-var]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)
    return stream


def own_temporary_folder() -> None:
    """Let this process, Blender and all child processes put temporary files into one folder, removed at the end.

    Where none can be made, nothing changes, and whoever needs a temporary file fails.
    """
    with suppress(OSError):
        folder = os.path.realpath(tempfile.mkdtemp(prefix="oneframe-"))
        _temporary.append(folder)
        tempfile.tempdir = os.environ["TMPDIR"] = folder


def end_process(code: int) -> NoReturn:
    """End this process at once, without its temporary files.

    ``sys.exit`` in a Blender program runs Blender's clean-up, which takes long after many renders; that of the bpy
    module may wait for its threads forever.
    """
    for number in ENDING_SIGNALS:
        with suppress(ValueError):  # another thread than the main one
            signal.signal(number, signal.SIG_IGN)
    blender = getattr(sys.modules.get("bpy"), "app", None)
    folders = [*_temporary, *([blender.tempdir] if blender else [])]
    for _ in range(3):
        # a child process that is about to end may still write
        folders = [folder for folder in folders if folder and os.path.isdir(folder)]
        for folder in folders:
            shutil.rmtree(folder, ignore_errors=True)
        if not any(map(os.path.isdir, folders)):
            break
        time.sleep(0.1)
    os._exit(code)


def handle_signals() -> None:
    """Let SIGINT, SIGTERM and SIGHUP end this process by a ``KeyboardInterrupt``, and soon in any case.

    A process that has not ended within :data:`STOPPING_SECONDS` is ended by a thread.
    """
    for number in ENDING_SIGNALS:
        # nohup ignores SIGHUP; the handler of a Blender program for SIGINT only cancels renders
        if number == signal.SIGINT or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, interrupt)
    if hasattr(signal, "SIGXFSZ"):
        # a file beyond the limit (ulimit -f) is an error like a full disk
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    if os.name == "nt":
        return  # signals wake no thread there
    read, write = os.pipe()
    os.set_blocking(write, False)
    signal.set_wakeup_fd(write, warn_on_full_buffer=False)

    def watch() -> None:
        while not (ending := [number for number in os.read(read, 64) if number in ENDING_SIGNALS]):
            pass
        time.sleep(STOPPING_SECONDS)
        print_error(stopped_message(ending[0], ""))
        end_process(128 + ending[0])

    threading.Thread(target=watch, daemon=True).start()


def interrupt(number: int, frame: FrameType | None) -> None:
    """The handler of the signals that end a process: raises ``KeyboardInterrupt``, once, and not inside an import.

    An extension module that is interrupted while it is loaded may crash, as Blender does.
    """
    if _received or _settled:
        return
    if _is_importing(frame):
        again = threading.Timer(0.05, send_to_itself, (number,))
        again.daemon = True
        again.start()
        return
    _received.append(number)
    raise KeyboardInterrupt


@contextmanager
def delayed_interrupts() -> Iterator[None]:
    """Delay Ctrl-C and the other signals that end a command until a render has ended, then raise KeyboardInterrupt.

    Otherwise Python would raise it inside Cycles' own code, where Blender swallows it, and Blender's own handler would
    cancel the render and return a partial image as if it were complete.
    """
    raising = (signal.default_int_handler, interrupt)
    numbers = [number for number in ENDING_SIGNALS if signal.getsignal(number) in raising]
    if not numbers or threading.current_thread() is not threading.main_thread():
        yield  # another handler is installed, or none
        return
    received: list[int] = []
    previous = {number: signal.signal(number, lambda number, _: received.append(number)) for number in numbers}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
    if received:
        if previous[received[0]] is interrupt:
            interrupt(received[0], None)
        raise KeyboardInterrupt


def settle() -> None:
    """From now on signals no longer interrupt: what the command ends with is known, and is being reported."""
    _settled.append(True)


def send_to_itself(number: int) -> None:
    """Send a signal to this process; it also wakes a main thread that waits for others."""
    if os.name == "nt":
        _thread.interrupt_main(signal.Signals(number))
    else:
        os.kill(os.getpid(), number)


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def stop_signal() -> int | None:
    """The signal that :func:`interrupt` has received, if any."""
    return _received[0] if _received else None


def stopped_message(number: int, message: str) -> str:
    """The message of an interruption, with the signal if it was not Ctrl-C."""
    message = message or "stopped"
    if number == signal.SIGINT:
        return message
    return message.replace("stopped", f"stopped by {signal.Signals(number).name}", 1)


def print_error(error: object) -> None:
    """Print an error as one line on standard error."""
    with suppress(OSError):
        sys.stderr.write("error: " + " ".join(str(error).split()) + "\n")


def memory_limit() -> int | None:
    """Bytes of memory that this process may use (``ulimit -v``); ``None`` if there is no limit."""
    if os.name == "nt":
        return None
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit


def check_memory() -> None:
    """Check before Blender and numpy are loaded that the limit of memory lets them: else they crash.

    Raises
    ------
    RunError
        It does not.
    """
    limit = memory_limit()
    if limit is not None and limit < LEAST_MEMORY and "bpy" not in sys.modules:
        raise RunError(
            f"expected a limit of memory (ulimit -v) of at least {LEAST_MEMORY >> 20} MB, which Blender needs to load, "
            f"found {limit >> 20} MB; raise the limit"
        )


def watched_in_little_memory() -> None:
    """Where memory is limited, go on in a child process, and say so if it crashes.

    Neither Blender nor its libraries check every allocation. Only before Blender is loaded.
    """
    limit = memory_limit()
    if limit is None or "bpy" in sys.modules:
        return
    try:
        child = os.fork()
    except OSError:
        return
    if child == 0:
        return
    for number in ENDING_SIGNALS:
        # Ctrl-C reaches both
        signal.signal(number, lambda number, _: None if number == signal.SIGINT else os.kill(child, number))
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    if code < 0:
        print_error(
            f"Blender crashed ({signal.Signals(-code).name}): this process may use {limit >> 20} MB of memory "
            "(ulimit -v), which seems too little; raise the limit"
        )
        code = 3
    end_process(code)
