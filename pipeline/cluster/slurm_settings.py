"""What jobs of Slurm the workers run in: the table ``[cluster]`` of a case file, or a file of its own."""

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..files.content import LARGEST_TEXT, read_content
from ..files.keys import check_keys
from ..files.tables import parsed_toml


@dataclass(frozen=True)
class SlurmSettings:
    """Jobs that workers run in.

    Attributes
    ----------
    jobs
        How many, at most: the run begins with the first that Slurm starts, and one that ends is replaced.
    cores
        CPUs of a job; one process renders on each.
    memory
        Of a job, such as "8GB".
    walltime
        Of a job, such as "04:00:00".
    queue, account
        Partition and account; ``None`` for Slurm's own.
    interface
        Network interface of the nodes and of this machine, such as "ib0".
    options
        Further options of sbatch, such as "--qos=long".
    """

    jobs: int = 10
    cores: int = 1
    memory: str = "4GB"
    walltime: str = "04:00:00"
    queue: str | None = None
    account: str | None = None
    interface: str | None = None
    options: tuple[str, ...] = ()


_PATTERNS = {
    "memory": (r"[0-9]+(\.[0-9]+)? ?[KMGT]i?B", 'a size such as "8GB"'),
    "walltime": (r"([0-9]+-)?[0-9]+(:[0-9]{2}){1,2}", 'a time such as "04:00:00"'),
}
_LARGEST = {"jobs": 10_000, "cores": 1024}


def checked_slurm_settings(table: Mapping[str, object], where: str) -> SlurmSettings:
    """Check a table; keys that are missing keep their defaults.

    Raises
    ------
    InputError
        An unknown key, or a value of another kind.
    """
    fields = {entry.name: entry for entry in dataclasses.fields(SlurmSettings)}
    check_keys(table, (), tuple(fields), f"{where}: ")
    values: dict[str, Any] = {}
    for name, value in table.items():
        if name in _LARGEST:
            whole = isinstance(value, int) and not isinstance(value, bool)
            if not whole or not 1 <= value <= _LARGEST[name]:  # type: ignore[operator]
                raise InputError(
                    f"{where}: {name}: expected a whole number from 1 to {_LARGEST[name]}, found {value!r}"
                )
        elif name == "options":
            if not isinstance(value, list) or not all(isinstance(one, str) and one.startswith("-") for one in value):
                raise InputError(f'{where}: options: expected a list such as ["--qos=long"], found {value!r}')
            value = tuple(value)
        else:
            pattern, expected = _PATTERNS.get(name, (r"\S+", "a name"))
            if not isinstance(value, str) or not re.fullmatch(pattern, value):
                raise InputError(f"{where}: {name}: expected {expected}, found {value!r}")
        values[name] = value
    return SlurmSettings(**values)


def read_slurm_settings(path: Path) -> SlurmSettings:
    """Read a TOML file of these keys, or one with a table ``[cluster]`` of them.

    Raises
    ------
    InputError
        It cannot be read, or as :func:`checked_slurm_settings`.
    """
    table = parsed_toml(read_content(path, "settings of a cluster", most=LARGEST_TEXT), path.name)
    inside = table.get("cluster")
    if isinstance(inside, dict) and len(table) == 1:
        return checked_slurm_settings(inside, f"{path.name}: [cluster]")
    return checked_slurm_settings(table, path.name)
