"""The case, sent to each worker that asks for it."""

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from distributed import Client

from ..dataset.case_parcel import CaseParcel
from ..dataset.checksums import FileSum
from ..errors import RunError
from .file_streams import BLOCK_BYTES, fill_on_worker

AT_A_TIME = 4
"""Workers that are sent to side by side."""


class CaseSender:
    """Answers the workers' calls for the case; on Dask's topic of the run's case."""

    def __init__(self, client: Client, topic: str, parcel: CaseParcel, note: Callable[[str], None]) -> None:
        """Listen from now on; ``note`` gets a line if sending fails."""
        self._client, self._topic, self._parcel, self._note = client, topic, parcel, note
        self._slots = threading.BoundedSemaphore(AT_A_TIME)
        self.sent = 0
        """Number of workers that have the case."""
        client.subscribe_topic(topic, self._hear)

    def stop(self) -> None:
        """Answer no more."""
        self._client.unsubscribe_topic(self._topic)

    def _hear(self, event: tuple[float, Mapping[str, Any]]) -> None:
        # in Dask's loop, which must not wait
        threading.Thread(target=self._send, kwargs=dict(event[1]), daemon=True).start()

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
