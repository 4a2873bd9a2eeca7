"""A function in a process of its own, where a parser in C++ can neither crash this one nor fill its memory.

The child is the same Python without Blender. It gets bytes and gives bytes: nothing is unpickled.
"""

import importlib
import json
import os
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import BinaryIO, cast

from ..errors import InputError

SECONDS = 60.0
"""Of waiting, on a busy computer."""

CPU_SECONDS = 4.0
"""Of computing, where the system can limit it (not on Windows)."""

MEGABYTES = 600.0
"""Of memory beyond what the imports take, where the system can limit it (Linux)."""

_PACKAGE = Path(__file__).resolve().parents[1]
_ROOT = __name__.rpartition(".files.")[0]
"""This package's name: as a part of the installed add-on it is not ``oneframe``."""

_CHILD = """
import importlib.util, json, sys
package, sys.path[:], *call = json.loads(sys.argv[1])
spec = importlib.util.spec_from_file_location("oneframe", package)
sys.modules["oneframe"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(sys.modules["oneframe"])
from oneframe.files.child_process import answer
answer(*call)
"""
_STREAMING_CHILD = _CHILD.replace("answer", "answer_in_parts")
_VALUE, _REFUSED, _END = b"v", b"r", b"e"
_LENGTH = struct.Struct("<I")


class ChildError(RuntimeError):
    """The child gave no answer; the message says why in a few words."""


def called_apart(
    function: Callable[..., bytes],
    data: bytes,
    arguments: Sequence[str | int | float] = (),
    *,
    seconds: float = SECONDS,
    cpu_seconds: float = CPU_SECONDS,
    megabytes: float = MEGABYTES,
) -> bytes:
    """Call ``function(data, *arguments)``, a public function of this package, in a process of its own.

    Parameters
    ----------
    function, data, arguments
        What to call with which standard input and arguments.
    seconds, cpu_seconds, megabytes
        Limits of waiting, computing and memory; see :data:`SECONDS`, :data:`CPU_SECONDS` and :data:`MEGABYTES`.

    Raises
    ------
    InputError
        Raised by the function.
    ChildError
        The process crashed, or took too long or too much memory.
    """
    name = "oneframe" + function.__module__.removeprefix(_ROOT)
    call = [str(_PACKAGE / "__init__.py"), sys.path, name, function.__name__, cpu_seconds, megabytes, list(arguments)]
    try:
        ended = subprocess.run(
            [sys.executable, "-I", "-c", _CHILD, json.dumps(call)],
            input=data,
            capture_output=True,
            timeout=seconds,
            check=False,
            # threads of OpenBLAS take memory each
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
    except subprocess.TimeoutExpired:
        raise ChildError(f"it takes longer than {seconds:g} s") from None
    except OSError as error:
        raise ChildError(f"cannot start {sys.executable}: {error.strerror}") from None
    kind, content = ended.stdout[:1], ended.stdout[1:]
    if kind == _VALUE:
        return content
    if kind == _REFUSED:
        raise InputError(content.decode())
    raise ChildError("it takes too much time or memory, or it crashes its parser")


def streamed_apart(
    function: Callable[..., Iterator[bytes]],
    arguments: Sequence[str | int | float | None] = (),
    *,
    seconds: float = SECONDS,
    most_bytes: int,
) -> Iterator[bytes]:
    """The parts that ``function(*arguments)``, a public generator of this package, yields in a process of its own.

    Close the iterator to end the process early.

    Parameters
    ----------
    function, arguments
        As for :func:`called_apart`.
    seconds
        Longest wait for one part; how long all of them take is not limited.
    most_bytes
        Longest part that is accepted.

    Raises
    ------
    InputError
        Raised by the function.
    ChildError
        The process crashed, or a part took too long or too much memory.
    """
    name = "oneframe" + function.__module__.removeprefix(_ROOT)
    call = [str(_PACKAGE / "__init__.py"), sys.path, name, function.__name__, list(arguments)]
    try:
        child = subprocess.Popen(
            [sys.executable, "-I", "-c", _STREAMING_CHILD, json.dumps(call)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
    except OSError as error:
        raise ChildError(f"cannot start {sys.executable}: {error.strerror}") from None
    stream = cast(BinaryIO, child.stdout)
    watch = _Watch(child, seconds)
    try:
        while True:
            kind, content = _read_part(watch, stream, most_bytes)
            if kind == _END:
                return
            if kind == _REFUSED:
                raise InputError(content.decode())
            if kind != _VALUE:
                raise ChildError(
                    f"it takes longer than {seconds:g} s"
                    if watch.expired
                    else "it takes too much time or memory, or it crashes its parser"
                )
            yield content
    finally:
        watch.stop()
        child.kill()
        stream.close()
        child.wait()


class _Watch:
    """Kills a child whose part is read for too long; the time between parts is that of the reader."""

    def __init__(self, child: subprocess.Popen[bytes], seconds: float) -> None:
        self.expired = False
        self._child, self._seconds, self._since = child, seconds, 0.0
        self._ended = threading.Event()
        threading.Thread(target=self._run, daemon=True).start()

    def begin(self) -> None:
        self._since = time.monotonic()

    def end(self) -> None:
        self._since = 0.0

    def stop(self) -> None:
        self._ended.set()

    def _run(self) -> None:
        while not self._ended.wait(min(1.0, self._seconds / 4)):
            since = self._since
            if since and time.monotonic() - since > self._seconds:
                self.expired = True
                self._child.kill()
                return


def _read_part(watch: _Watch, stream: BinaryIO, most_bytes: int) -> tuple[bytes, bytes]:
    """Kind and content of the next part; no kind if the child has gone or writes nonsense."""
    watch.begin()
    try:
        head = stream.read(1 + _LENGTH.size)
        if len(head) < 1 + _LENGTH.size:
            return b"", b""
        (length,) = _LENGTH.unpack(head[1:])
        if length > most_bytes:
            return b"", b""
        content = stream.read(length)
        return (head[:1], content) if len(content) == length else (b"", b"")
    finally:
        watch.end()


def answer(
    module: str, function: str, cpu_seconds: float, megabytes: float, arguments: Sequence[str | int | float]
) -> None:
    """In the child: call the function with the standard input, and write its answer to the standard output."""
    out = os.fdopen(os.dup(1), "wb")
    # libraries print what they like
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    call = getattr(importlib.import_module(module), function)
    data = sys.stdin.buffer.read()
    _limit(cpu_seconds, megabytes)
    try:
        result = _VALUE + call(data, *arguments)
    except InputError as error:
        result = _REFUSED + str(error).encode(errors="backslashreplace")
    except ImportError as error:
        result = _REFUSED + f"it needs the Python package {error.name}, which is not installed".encode()
    out.write(result)
    out.flush()
    os._exit(0)


def answer_in_parts(module: str, function: str, arguments: Sequence[str | int | float | None]) -> None:
    """In the child: write what the generator yields to the standard output, part by part."""
    out = os.fdopen(os.dup(1), "wb")
    # libraries print what they like
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    call = getattr(importlib.import_module(module), function)
    _limit(None)

    def write(kind: bytes, content: bytes) -> None:
        out.write(kind + _LENGTH.pack(len(content)))
        out.write(content)
        out.flush()

    try:
        for part in call(*arguments):
            write(_VALUE, part)
        write(_END, b"")
    except InputError as error:
        write(_REFUSED, str(error).encode(errors="backslashreplace"))
    except ImportError as error:
        write(_REFUSED, f"it needs the Python package {error.name}, which is not installed".encode())
    except BrokenPipeError:
        pass  # the reader has had enough
    os._exit(0)


def _limit(cpu_seconds: float | None, megabytes: float = MEGABYTES) -> None:
    """Limit this process from now on; its time not at all if that is ``None``."""
    if os.name == "nt":
        return
    import resource

    def lower(what: int, value: int) -> None:
        _, most = resource.getrlimit(what)
        value = value if most == resource.RLIM_INFINITY else min(value, most)
        resource.setrlimit(what, (value, most))

    lower(resource.RLIMIT_CORE, 0)
    if cpu_seconds is not None:
        used = resource.getrusage(resource.RUSAGE_SELF)
        lower(resource.RLIMIT_CPU, int(used.ru_utime + used.ru_stime + cpu_seconds) + 1)
    if sys.platform == "linux":
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        lower(resource.RLIMIT_AS, pages * resource.getpagesize() + int(megabytes * 2**20))
