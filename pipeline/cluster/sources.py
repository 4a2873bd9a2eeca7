"""Where workers come from: a running scheduler, processes on this machine, or jobs of Slurm."""

import logging
import re
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from distributed import Client

from ..errors import InputError, RunError
from .local_workers import local_workers
from .slurm_settings import SlurmSettings
from .slurm_workers import slurm_workers

CONNECT_SECONDS = 10.0


@dataclass(frozen=True)
class WorkerSource:
    """A scheduler, and what is known about its workers.

    Attributes
    ----------
    client
        Connected to the scheduler.
    about
        One line about it for the user.
    address
        The scheduler's address.
    can_join
        Whether workers may join that nobody has started yet.
    expected
        Number of threads of the workers that are about to join.
    on_this_machine
        Whether all workers are on this machine, where they may start what this process starts.
    no_workers
        What to do if no worker is connected, as a sentence.
    threads
        Render threads of a process.
    """

    client: Client
    about: str
    address: str
    can_join: bool
    expected: int
    on_this_machine: bool
    no_workers: str
    threads: int = 1


@contextmanager
def open_source(where: str, slurm: SlurmSettings | None = None) -> Iterator[WorkerSource]:
    """Workers from the value of ``--cluster``; those that were started for it end with the context.

    Parameters
    ----------
    where
        The value.
    slurm
        The jobs of ``slurm``.

    Raises
    ------
    InputError
        The value is neither an address nor ``local:N`` nor ``slurm``.
    RunError
        There is no scheduler at the address.
    """
    kind, _, rest = where.partition(":")
    opened: Callable[[str], object]
    if kind == "local":
        opened = _local
    elif where == "slurm":
        settings = slurm or SlurmSettings()
        opened = lambda _rest: _slurm(settings)  # noqa: E731
    elif re.fullmatch(r"([a-z]+://)?(\[[0-9a-fA-F:.]+\]|[^\s:/]+):[0-9]+/?", where):
        opened, rest = _connected, where
    else:
        raise InputError(
            f"--cluster: expected the address of a Dask scheduler, such as tcp://host:8786, local:N or slurm, "
            f"found {where!r}"
        )
    with quiet_dask(), opened(rest) as source:  # type: ignore[attr-defined]
        yield source


@contextmanager
def _connected(address: str) -> Iterator[WorkerSource]:
    with connected_client(address) as client:
        yield WorkerSource(
            client=client,
            about=f"workers of the scheduler {address}",
            address=address,
            can_join=True,
            expected=1,
            on_this_machine=False,
            no_workers=f"start one on any machine: dask worker {address}",
        )


@contextmanager
def _local(count: str) -> Iterator[WorkerSource]:
    if not count.isdecimal() or not 1 <= int(count) <= 1024:
        raise InputError(f"--cluster: expected local:N with N from 1 to 1024, found local:{count}")
    number = int(count)
    with local_workers(number) as (address, threads), connected_client(address) as client:
        yield WorkerSource(
            client=client,
            about=f"{number} workers on this machine",
            address=address,
            can_join=False,
            expected=number,
            on_this_machine=True,
            no_workers="they are started again by themselves",
            threads=threads,
        )


@contextmanager
def _slurm(settings: SlurmSettings) -> Iterator[WorkerSource]:
    with slurm_workers(settings) as address, connected_client(address) as client:
        yield WorkerSource(
            client=client,
            about=f"at most {settings.jobs} jobs of Slurm, {settings.cores} workers in each; scheduler {address}",
            address=address,
            can_join=True,
            expected=1,
            on_this_machine=False,
            no_workers="they join when Slurm starts their jobs: squeue --name oneframe-workers shows why they wait",
        )


@contextmanager
def connected_client(address: str) -> Iterator[Client]:
    """A client of a scheduler; leaving the context disconnects it, whatever state the scheduler is in.

    Raises
    ------
    RunError
        There is no scheduler at the address.
    """
    found: list[Client | Exception] = []

    def connect() -> None:
        try:
            found.append(Client(address, timeout=CONNECT_SECONDS, set_as_default=False))
        except Exception as error:  # whatever Dask makes of the answer; reported below
            found.append(error)

    # Dask waits for an answer without end where something else listens, such as a web server
    thread = threading.Thread(target=connect, daemon=True)
    thread.start()
    thread.join(CONNECT_SECONDS + 2)
    client = found[0] if found else None
    if not isinstance(client, Client):
        port = address.rstrip("/").rpartition(":")[2]
        # Dask puts the system's reason at the end of the cause's text
        text = " ".join(str("" if client is None else client.__cause__ or client).split())
        why = text.rpartition("] ")[2] if "[Errno" in text else text[:200]
        if not why or isinstance(client, MemoryError):
            # Dask takes the first bytes of any answer for a length
            why = "no answer that Dask understands"
        raise RunError(
            f"--cluster: expected a Dask scheduler at {address}, found none within {CONNECT_SECONDS:.0f} s ({why}); "
            f"start it (dask scheduler --port {port}) and workers (dask worker {address}), or correct the address"
        )
    try:
        yield client
    finally:
        with losing_scheduler(client):
            client.close(timeout=2)


def is_connected(client: Client) -> bool:
    """Whether the client has a connection to its scheduler; Dask restores a lost one if it can."""
    return bool(client.status == "running")


@contextmanager
def losing_scheduler(client: Client) -> Iterator[None]:
    """Wrap calls of a scheduler, which may go at any moment: that is no error here; :func:`is_connected` shows it."""
    try:
        yield
    except Exception as error:
        # a client that has just been closed raises whatever its parts raise
        if is_connected(client) and not isinstance(error, OSError | TimeoutError):
            raise


@contextmanager
def quiet_dask() -> Iterator[None]:
    """Keep Dask's own messages from the terminal: whatever matters to the user is said in OneFrame's words."""
    loggers = [logging.getLogger(name) for name in ("distributed", "tornado", "asyncio", "dask_jobqueue")]
    levels = [logger.level for logger in loggers]
    # children have levels of their own
    loggers += [
        child
        for name, child in logging.root.manager.loggerDict.items()
        if name.startswith(("distributed.", "tornado.")) and isinstance(child, logging.Logger)
    ]
    levels += [child.level for child in loggers[len(levels) :]]
    try:
        for logger in loggers:
            logger.setLevel(logging.CRITICAL + 1)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module=r"distributed\b.*")
            yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
