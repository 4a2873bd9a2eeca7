"""What listens in processes, and what it gives to somebody who has no certificate of the run."""

import socket
import ssl
from collections.abc import Iterable
from contextlib import suppress

import psutil

ANY_INTERFACE = ("0.0.0.0", "::")
TLS_ALERT = b"\x15\x03"


def listeners(processes: Iterable[int]) -> set[tuple[str, int]]:
    """Addresses and ports on which processes, or those that they have started, accept connections."""
    found = set()
    for number in processes:
        with suppress(psutil.NoSuchProcess):
            for process in (one := psutil.Process(number), *one.children(recursive=True)):
                with suppress(psutil.NoSuchProcess):
                    found |= {c.laddr for c in process.net_connections("tcp") if c.status == psutil.CONN_LISTEN}
    return {(where.ip, where.port) for where in found}


def check_closed(addresses: Iterable[tuple[str, int]]) -> None:
    """Check that each listens on one interface, and gives a stranger no word of Dask and no page."""
    anybody = ssl.create_default_context()
    anybody.check_hostname, anybody.verify_mode = False, ssl.CERT_NONE
    for address in addresses:
        assert address[0] not in ANY_INTERFACE
        assert address[1] != 8787
        # a scheduler or worker without TLS greets at once; it would do so within TLS to one whom it admits
        plain = answered(address)
        if not plain.startswith(b"HTTP/1.1 404"):
            assert plain == b"" or plain.startswith(TLS_ALERT)
            assert answered(address, anybody) == b""


def answered(address: tuple[str, int], context: ssl.SSLContext | None = None) -> bytes:
    """All that a connection gives until the other side ends it."""
    text = b""
    with suppress(ConnectionError, ssl.SSLError), socket.create_connection(address, 60) as connection:
        if context is not None:
            connection = context.wrap_socket(connection)
        connection.sendall(b"GET /metrics HTTP/1.0\r\n\r\n")
        while block := connection.recv(1 << 16):
            text += block
            if context is None:
                connection.shutdown(socket.SHUT_WR)
    return text
