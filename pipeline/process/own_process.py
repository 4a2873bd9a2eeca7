"""The process of a command: its standard streams, the signals that end it, its temporary files.

Blender leaves much of this to the system: a process that ends early would leave its temporary folder behind, and a
closed stream would pass its number on to the next file that Blender opens.
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
from typing import IO, NoReturn, TextIO

from ..errors import printable
from ..files.lock import lock_by_system

STOPPING_SECONDS = 5.0
"""Time that a stopped process has to finish the file that it is writing."""
ENDING_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)
)
STDOUT = "the standard output"
"""The name of the standard output in an :class:`OSError`."""
ERASE_LINE = "\x1b[K"
"""A terminal's code, from the cursor on."""

_received: list[int] = []
_settled: list[bool] = []
_temporary: list[str] = []
_locks: list[IO[bytes]] = []
_PREFIX = "oneframe-"
_LOCK = ".temporary-folder-of-oneframe"  # a name that marks the folder as ours: others call theirs oneframe-, too


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
    # a file's name may hold characters that the terminal's encoding does not know
    if isinstance(sys.stderr, io.TextIOWrapper):
        sys.stderr.reconfigure(errors="backslashreplace")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout = _named_output(1, sys.stdout.encoding, closefd=False)


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


class _PrintableText(io.TextIOWrapper):
    """Text that shows what it holds, but for line ends and the codes of the bar of progress."""

    def write(self, text: str) -> int:
        """Write it; names of files come in many messages."""
        super().write(ERASE_LINE.join(printable(part, kept="\n\r\t") for part in text.split(ERASE_LINE)))
        return len(text)


def _named_output(number: int, encoding: str, *, closefd: bool = True) -> TextIO:
    # unbuffered: a buffer would fail once more at exit if the reader has gone
    raw = _StandardOutput(number, "wb", closefd=closefd)
    return _PrintableText(raw, encoding=encoding, errors="backslashreplace", write_through=True)  # type: ignore[type-var]


def own_output() -> TextIO:
    """Discard Blender's own messages from now on; return a stream that still reaches the standard output.

    Raises
    ------
    OSError
        From the stream, with the file name :data:`STDOUT`: it is closed or full.
    """
    sys.stdout.flush()
    stream = _named_output(os.dup(1), "utf-8")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)
    return stream


def own_temporary_folder() -> None:
    """Let this process, Blender and all child processes put temporary files into one folder, removed at the end.

    Those that killed processes have left are removed. Where none can be made, nothing changes, and whoever needs a
    temporary file fails.
    """
    with suppress(OSError):
        _remove_abandoned(tempfile.gettempdir())
        folder = os.path.realpath(tempfile.mkdtemp(prefix=_PREFIX))
        _temporary.append(folder)
        tempfile.tempdir = os.environ["TMPDIR"] = folder
        _locks.append(open(os.path.join(folder, _LOCK), "wb"))  # noqa: SIM115  # as long as this process lives
        _take(_locks[-1])


def _remove_abandoned(folder: str) -> None:
    """Remove the folders of killed processes, which hold their locks no more."""
    for entry in os.scandir(folder):
        if entry.name.startswith(_PREFIX):
            with suppress(OSError):
                with open(os.path.join(entry.path, _LOCK), "r+b") as lock:
                    _take(lock)
                shutil.rmtree(entry.path, ignore_errors=True)


def _take(lock: IO[bytes]) -> None:
    lock_by_system(lock.fileno(), shared=False)


def end_process(code: int) -> NoReturn:
    """End this process at once, without its temporary files.

    ``sys.exit`` in a Blender program runs Blender's clean-up, which takes long after many renders; that of the bpy
    module may wait for its threads forever.
    """
    for number in ENDING_SIGNALS:
        with suppress(ValueError):  # another thread than the main one
            signal.signal(number, signal.SIG_IGN)
    for lock in _locks:
        lock.close()  # Windows removes no open files
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


def interrupt(number: int, _frame: FrameType | None) -> None:
    """The handler of the signals that end a process: raises ``KeyboardInterrupt``, once."""
    if _received or _settled:
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
        sys.stderr.write("error: " + " ".join(printable(str(error)).split()) + "\n")
