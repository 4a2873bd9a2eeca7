"""On a worker: where it finds the case and where it renders to, on machines that share no folder with the run's.

A worker's own folder holds its part of the dataset, under the dataset's description; it is locked like a shard, so that
no run on that machine renders into it at the same time. A case that was sent lies in the folder of the worker's
temporary files, and goes when the worker ends.
"""

import json
import secrets
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from ..dataset.case_parcel import CASE
from ..dataset.folder import RunFolder, Shard
from ..errors import RunError
from .file_streams import WorkerFolder

STALLED_SECONDS = 60.0
"""A case of which nothing has come for this long does not come."""
_SHARDS = 1 << 31
"""So many workers may lock one folder side by side."""

_lock = threading.Lock()
_locked: dict[tuple[Path, str], RunFolder] = {}
_used: dict[str, tuple[Path, str]] = {}


@dataclass(frozen=True)
class SentCase:
    """A case that is sent to workers.

    Attributes
    ----------
    sha256
        Its hash: see :attr:`.CaseParcel.sha256`.
    poses
        The list of poses in it; ``None`` if the poses are drawn.
    """

    sha256: str
    poses: str | None

    @property
    def folder(self) -> str:
        """The name by which run and worker know the folder."""
        return f"oneframe-case-{self.sha256[:16]}"


class Machine(Protocol):
    """What this asks of the worker."""

    @property
    def local_folder(self) -> Path:
        """Its folder for temporary files."""

    def open_folder(self, name: str, root: Path) -> WorkerFolder:
        """Let the run's machine read or fill a folder."""

    def ask_for_case(self, folder: str) -> None:
        """Ask the run's machine to fill an opened folder with the case."""

    def beat(self, state: str, done: int) -> None:
        """Tell that the order goes on."""


def sent_case(run: str, case: SentCase, machine: Machine) -> tuple[str, Sequence[str]]:
    """The case file of a case that is sent to this worker, once, and the arguments that go with it.

    Raises
    ------
    RunError
        It does not arrive.
    """
    root = machine.local_folder / case.folder
    with _lock:
        folder = machine.open_folder(case.folder, root)
        if run not in folder.asked_by and not folder.wait(0):
            folder.asked_by.add(run)
            machine.ask_for_case(case.folder)
    while not folder.wait(1.0):
        machine.beat("waiting for the case", 0)
        if folder.idle_seconds > STALLED_SECONDS:
            raise RunError(
                "the case that the run sends does not arrive; let the machine of the run connect to the worker's port "
                "(dask worker --worker-port), or copy the case there and give its path (--case-on-workers)"
            )
    return str(root / CASE), [] if case.poses is None else [f"--poses={root / case.poses}"]


def own_folder(run: str, out: str, identity: str, description: Mapping[str, object], machine: Machine) -> Path:
    """The worker's own folder for a run, locked until :func:`end_run` of the last run that uses it.

    Parameters
    ----------
    run
        The run's name, under which the folder is opened for the run's machine.
    out
        The folder; empty for one among the worker's temporary files.
    identity, description
        Of the dataset.
    machine
        The worker.

    Raises
    ------
    RunError
        It cannot be written to, is in use, or holds something else.
    """
    folder = Path(out) if out else machine.local_folder / f"oneframe-dataset-{identity[:16]}"
    with _lock:
        if run in _used:
            return folder
        if (folder, identity) not in _locked:
            try:
                shard = Shard(secrets.randbelow(_SHARDS), _SHARDS)
                _locked[folder, identity] = RunFolder(folder, json.loads(json.dumps(description)), shard)
            except RunError as error:
                raise RunError(str(error).replace("(--out)", "(--out-on-workers)")) from None
        _used[run] = folder, identity
        machine.open_folder(run, folder)
    return folder


def end_run(run: str) -> None:
    """Unlock the folder of a run, unless another one uses it."""
    with _lock:
        used = _used.pop(run, None)
        if used is not None and used not in _used.values():
            _locked.pop(used).__exit__(None, None, None)
