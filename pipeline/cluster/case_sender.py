"""The case, sent to each worker that asks for it."""

import threading
from collections.abc import Callable, Iterable, Iterator

from distributed import Client

from ..dataset.case_parcel import CaseParcel
from ..dataset.checksums import FileSum
from ..errors import RunError
from .file_streams import BLOCK_BYTES, fill_on_worker

AT_A_TIME = 4
"""Workers that are sent to side by side."""


class CaseSender:
    """Sends a case to workers, in the background."""

    def __init__(self, client: Client, parcel: CaseParcel, note: Callable[[str], None]) -> None:
        """Prepare; ``note`` gets a line if sending fails."""
        self._client, self._parcel, self._note = client, parcel, note
        self._slots = threading.BoundedSemaphore(AT_A_TIME)
        self.sent = 0
        """Number of workers that have the case."""

    def send(self, worker: str, folder: str) -> None:
        """Begin to fill an opened folder of a worker; returns at once."""
        threading.Thread(target=self._send, args=(worker, folder), daemon=True).start()

    def _send(self, worker: str, folder: str) -> None:
        files: dict[str, tuple[FileSum, Iterable[bytes]]] = {
            name: (known, self._blocks(name, known.bytes)) for name, known in self._parcel.sums.items()
        }
        with self._slots:
            try:
                fill_on_worker(self._client, worker, folder, files)
                self.sent += 1
            except (OSError, RunError) as error:
                self._note(f"the case could not be sent: {error}")

    def _blocks(self, name: str, size: int) -> Iterator[bytes]:
        # an empty file has one empty block, which creates it
        for offset in range(0, max(size, 1), BLOCK_BYTES):
            yield self._parcel.block(name, offset, BLOCK_BYTES)
