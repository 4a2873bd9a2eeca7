"""Files between the machine that runs the command and one worker, block by block, beside Dask's orders and results.

They go from one to the other directly, over the connections of Dask's workers (encrypted where Dask is set up so), and
never through the scheduler. A worker gives and takes only what lies in folders that a run has opened there.
"""

import asyncio
import os
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

from distributed import Client, Worker
from distributed.comm import CommClosedError

from ..dataset.checksums import FileSum, sum_of_file
from ..errors import RunError

BLOCK_BYTES = 4 << 20
_READ, _WRITE, _KEEP = "oneframe_read", "oneframe_write", "oneframe_keep"


class WorkerFolder:
    """A folder on a worker that the run's machine reads from, or fills: one object for each name and process."""

    _opened: ClassVar[dict[str, "WorkerFolder"]] = {}
    _opening: ClassVar = threading.Lock()

    def __init__(self, root: Path) -> None:
        """A folder that need not exist yet."""
        self.root = root
        self.asked_by: set[str] = set()
        self._changed = time.monotonic()
        self._is_whole = threading.Event()
        if root.is_dir():
            self._is_whole.set()

    @classmethod
    def open(cls, worker: Worker, name: str, root: Path) -> "WorkerFolder":
        """Open a folder under a name that the run's machine knows; the same object if it was opened before."""
        with cls._opening:
            worker.handlers.update({_READ: _read, _WRITE: _write, _KEEP: _keep})
            return cls._opened.setdefault(name, cls(root))

    @classmethod
    def named(cls, name: str) -> "WorkerFolder":
        """The opened folder of a name."""
        return cls._opened[name]

    @property
    def partial(self) -> Path:
        """Where files are until all of them have arrived."""
        return self.root.with_name(f"{self.root.name}.partial")

    def wait(self, seconds: float) -> bool:
        """Wait until all files have arrived, or for this time; whether they have."""
        return self._is_whole.wait(seconds)

    @property
    def idle_seconds(self) -> float:
        """Time since anything has arrived, or since the folder was opened."""
        return time.monotonic() - self._changed

    def read(self, name: str, offset: int) -> bytes:
        """A block of a file; an empty one at its end."""
        with (self.root / name).open("rb") as stream:
            stream.seek(offset)
            return stream.read(BLOCK_BYTES)

    def write(self, name: str, offset: int, data: bytes) -> None:
        """Put a block of a file in its place; the first one replaces what a broken connection has left."""
        path = self.partial / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb" if offset == 0 else "r+b") as stream:
            stream.seek(offset)
            stream.write(data)
        self._changed = time.monotonic()

    def keep(self, sums: Mapping[str, FileSum]) -> str:
        """Take the files as whole if their hashes are these; else what is wrong, as a clause."""
        for name, known in sums.items():
            if sum_of_file(self.partial / name) != known:
                return f"{name} did not arrive as it was sent"
        os.replace(self.partial, self.root)
        self._is_whole.set()
        return ""


async def _read(folder: str, name: str, offset: int) -> bytes:
    return await asyncio.to_thread(WorkerFolder.named(folder).read, name, offset)


async def _write(folder: str, name: str, offset: int, data: Any) -> bool:
    await asyncio.to_thread(WorkerFolder.named(folder).write, name, offset, bytes(data))
    return True


async def _keep(folder: str, sums: Mapping[str, tuple[str, int]]) -> str:
    known = {name: FileSum(*values) for name, values in sums.items()}
    return await asyncio.to_thread(WorkerFolder.named(folder).keep, known)


class OutOfReach(RunError):
    """No file can be exchanged with a worker: it has gone or begun anew, or no connection to it is possible."""


def read_from_worker(client: Client, address: str, folder: str, name: str) -> Iterator[bytes]:
    """The blocks of a file in an opened folder of a worker.

    Raises
    ------
    OutOfReach
        The worker cannot be reached from here, or no longer has the folder.
    RunError
        The worker cannot read the file.
    """
    offset = 0
    while True:
        block = bytes(_called(client, address, _READ, folder=folder, name=name, offset=offset))
        yield block
        offset += len(block)
        if len(block) < BLOCK_BYTES:
            return


def fill_on_worker(
    client: Client, address: str, folder: str, files: Mapping[str, tuple[FileSum, Iterable[bytes]]]
) -> None:
    """Send files to an opened folder of a worker, which then takes them as whole.

    Parameters
    ----------
    files
        Sum and blocks of each file, by its name.

    Raises
    ------
    OutOfReach
        The worker cannot be reached from here, or no longer has the folder.
    RunError
        The worker cannot keep the files.
    """
    for name, (_, blocks) in files.items():
        offset = 0
        for block in blocks:
            _called(client, address, _WRITE, folder=folder, name=name, offset=offset, data=block)
            offset += len(block)
    sums = {name: (known.sha256, known.bytes) for name, (known, _) in files.items()}
    problem = _called(client, address, _KEEP, folder=folder, sums=sums)
    if problem:
        raise RunError(f"{address}: {problem}; run the same command again")


def _called(client: Client, address: str, operation: str, **arguments: object) -> Any:
    async def call() -> Any:
        return await getattr(client.rpc(address), operation)(**arguments)

    try:
        answer = client.sync(call)
    except FileNotFoundError as error:
        raise RunError(f"{address}: {error.filename} is not there") from None
    except (KeyError, CommClosedError, ConnectionError, TimeoutError) as error:
        reason = "it has begun anew" if isinstance(error, KeyError) else str(error) or "no connection"
        raise OutOfReach(f"{address}: cannot exchange files with this worker ({reason})") from None
    except OSError as error:
        # Dask reports a failed connection as a plain one
        kind = RunError if error.errno else OutOfReach
        raise kind(f"{address}: cannot exchange files with this worker ({error.strerror or error})") from None
    if answer is None:
        # a worker's process that has not opened any folder does not know the operation
        raise OutOfReach(f"{address}: cannot exchange files with this worker (it has begun anew)")
    return answer
