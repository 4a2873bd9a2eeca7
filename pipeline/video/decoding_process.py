"""Decoding in a process of its own: FFmpeg crashes on some damaged films.

The child is the same Python without Blender. Its answers are parts of bytes: nothing is unpickled.
"""

import faulthandler
import json
import os
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, cast

from ..errors import InputError

PART_SECONDS = 120.0
"""Longest wait for a part; an empty one comes now and then as long as there is nothing else to send."""

_PACKAGE = Path(__file__).resolve().parents[1]
"""Its name is that of the folder: ``pipeline`` in a checkout and in the add-on, ``oneframe`` where it is installed."""

_VALUE, _REFUSED, _END = b"v", b"r", b"e"
_HEAD = struct.Struct("<cI")


class DecodingError(RuntimeError):
    """The child gave no answer: it crashed, or hung."""


def decoded_apart(path: Path, *arguments: object) -> Iterator[bytes]:
    """The parts that :func:`.decoder.film` yields, without empty ones; close the iterator to end early.

    Raises
    ------
    DecodingError
        The process crashed, or a part took too long.
    """
    places = [*filter(None, sys.path), str(_PACKAGE.parent)]
    with subprocess.Popen(
        [sys.executable, "-P", "-m", f"{_PACKAGE.name}.video.decoding_process", str(path), json.dumps(arguments)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(places), "OPENBLAS_NUM_THREADS": "1"},
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
    ) as child:
        stream = cast(BinaryIO, child.stdout)
        try:
            while True:
                head = stream.read(_HEAD.size)
                kind, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (b"", 0)
                content = stream.read(length)
                if kind == _END:
                    return
                if kind == _REFUSED:
                    raise InputError(content.decode())
                if kind != _VALUE or len(content) < length:
                    raise DecodingError(f"its decoder crashes, or takes longer than {PART_SECONDS:g} s")
                if content:
                    yield content
        finally:
            child.kill()


def undecodable(path: Path, error: DecodingError) -> InputError:
    """The error to report if a film cannot be decoded."""
    return InputError(
        f"{path.name}: expected a video, cannot decode it ({error}); copy it again, or convert it to MP4 (H.264)"
    )


def _answer(name: str, arguments: str) -> None:
    """In the child: write what the decoder yields to the standard output, part by part."""
    out = os.fdopen(os.dup(1), "wb")
    # libraries print what they like
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)

    def write(kind: bytes, content: bytes) -> None:
        # the reader may take its time
        faulthandler.cancel_dump_traceback_later()
        out.write(_HEAD.pack(kind, len(content)) + content)
        out.flush()
        faulthandler.dump_traceback_later(PART_SECONDS, exit=True)

    faulthandler.dump_traceback_later(PART_SECONDS, exit=True)
    try:
        from .decoder import film

        for part in film(Path(name), *json.loads(arguments)):
            write(_VALUE, part)
        write(_END, b"")
    except InputError as error:
        write(_REFUSED, str(error).encode(errors="backslashreplace"))
    except ImportError as error:
        write(_REFUSED, f"it needs the Python package {error.name}, which is not installed".encode())
    except BrokenPipeError:
        pass  # the reader has had enough
    os._exit(0)


if __name__ == "__main__":
    _answer(*sys.argv[1:])
