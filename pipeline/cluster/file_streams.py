"""Files between the machine that runs the command and one worker, block by block, beside Dask's orders and results.

They go from one to the other directly, over the connections of Dask's workers (encrypted where Dask is set up so), and
never through the scheduler. A worker gives and takes only what lies in folders that a run has opened there.
"""

import asyncio
import os
import shutil
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

from distributed import Client, Worker

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
        self.asked = False
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

    def wait(self, stalled_seconds: float) -> bool:
        """Wait until all files have arrived; False if nothing has come for this long."""
        self._changed = time.monotonic()
        while not self._is_whole.wait(0.1):
            if time.monotonic() - self._changed > stalled_seconds:
                return False
        return True

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

    def keep(self, sums: Mapping[str, FileSum]) -> str | None:
        """Take the files as whole if their hashes are these; else what is wrong, as a clause."""
        for name, known in sums.items():
            if sum_of_file(self.partial / name) != known:
                return f"{name} did not arrive as it was sent"
        os.replace(self.partial, self.root)
        self._is_whole.set()
        return None

    def remove(self) -> None:
        """Remove the folder and everything in it."""
        self._is_whole.clear()
        for folder in (self.root, self.partial):
            shutil.rmtree(folder, ignore_errors=True)


async def _read(folder: str, name: str, offset: int) -> bytes:
    return await asyncio.to_thread(WorkerFolder.named(folder).read, name, offset)


async def _write(folder: str, name: str, offset: int, data: Any) -> None:
    await asyncio.to_thread(WorkerFolder.named(folder).write, name, offset, bytes(data))


async def _keep(folder: str, sums: Mapping[str, tuple[str, int]]) -> str | None:
    known = {name: FileSum(*values) for name, values in sums.items()}
    return await asyncio.to_thread(WorkerFolder.named(folder).keep, known)


def read_from_worker(client: Client, address: str, folder: str, name: str) -> Iterator[bytes]:
    """The blocks of a file in an opened folder of a worker.

    Raises
    ------
    RunError
        The worker cannot be reached from here, or cannot read the file.
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
    RunError
        The worker cannot be reached from here, or cannot keep the files.
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
        return client.sync(call)
    except OSError as error:
        # a closed connection is one too
        reason = error.strerror or str(error) or "no connection"
        raise RunError(f"{address}: cannot exchange files with this worker ({reason})") from None
