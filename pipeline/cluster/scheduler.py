"""The connection with a running scheduler of Dask."""

import logging
import re
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from ipaddress import ip_address
from typing import Any

from distributed import Client

from ..errors import InputError, RunError

CONNECT_SECONDS = 10.0


@contextmanager
def open_scheduler(address: str, *, insecure: bool = False) -> Iterator[Client]:
    """A client of the scheduler at an address, with the certificates of Dask's configuration.

    ``insecure`` takes a scheduler of another machine that admits anyone.
    """
    _check_address(address, insecure=insecure)
    # whatever matters to the user is said in OneFrame's words
    logging.disable(logging.CRITICAL)
    try:
        with warnings.catch_warnings(), _connected(address) as client:
            warnings.filterwarnings("ignore", module=r"distributed\b.*")
            yield client
    finally:
        logging.disable(logging.NOTSET)


def _check_address(address: str, *, insecure: bool) -> None:
    if not re.fullmatch(r"([a-z]+://)?(\[[0-9a-fA-F:.]+\]|[^\s:/]+):[0-9]+/?", address):
        raise InputError(
            f"--cluster: expected the address of a Dask scheduler, such as tls://host:8786, found {address!r}"
        )
    scheme, _, place = address.rpartition("://")
    host = place.rpartition(":")[0].strip("[]")
    is_here = host == "localhost"
    with suppress(ValueError):
        is_here = is_here or ip_address(host).is_loopback
    if scheme not in ("tls", "wss") and not is_here and not insecure:
        raise InputError(
            f"--cluster: expected tls:// for the scheduler of another machine, found {address}, by which everybody in "
            "its network can run programs as you; set up TLS (docs/cluster.md), or add --insecure"
        )


class _WholeClient(Client):
    """A client that closes itself where it finds no scheduler.

    Dask leaves it half-made: it would close wherever garbage is collected, also in a thread that holds Dask's locks.
    """

    def start(self, **kwargs: Any) -> None:
        try:
            super().start(**kwargs)
        except BaseException:
            with losing_scheduler(self):
                self.close(timeout=2)
            raise


@contextmanager
def _connected(address: str) -> Iterator[Client]:
    found: list[Client | str] = []

    def connect() -> None:
        try:
            found.append(_WholeClient(address, timeout=CONNECT_SECONDS, set_as_default=False))
        except Exception as error:  # whatever Dask makes of the answer; reported below
            found.append(" ".join(str(error.__cause__ or error).split()))

    # Dask waits for an answer without end where something else listens, such as a web server
    thread = threading.Thread(target=connect, daemon=True)
    thread.start()
    thread.join(CONNECT_SECONDS + 2)
    client = found[0] if found else None
    if not isinstance(client, Client):
        host, _, port = address.rstrip("/").rpartition(":")
        answer = (client or "no answer that Dask understands")[-200:]
        raise RunError(
            f"--cluster: expected a Dask scheduler at {address}, found none within {CONNECT_SECONDS:.0f} s "
            f"({answer}); start it (dask scheduler --host {host} --port {port}) and "
            f"workers (dask worker {address}), or correct the address, or the certificates (distributed.comm.tls in "
            "Dask's configuration)"
        )
    try:
        yield client
    finally:
        with losing_scheduler(client):
            client.close(timeout=2)


@contextmanager
def losing_scheduler(client: Client) -> Iterator[None]:
    """Wrap calls of a scheduler, which may go at any moment: that is no error here; the client's status shows it."""
    try:
        yield
    except Exception as error:
        # a client that has just been closed raises whatever its parts raise
        if client.status == "running" and not isinstance(error, OSError | TimeoutError):
            raise
