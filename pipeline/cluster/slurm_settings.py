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
    """Jobs that workers run in, by the keys that *On a Slurm cluster* explains; ``None`` for Slurm's own choice."""

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
    check_keys(table, (), tuple(entry.name for entry in dataclasses.fields(SlurmSettings)), f"{where}: ")
    values: dict[str, Any] = dict(table)
    for name, value in values.items():
        if name in _LARGEST:
            expected = f"a whole number from 1 to {_LARGEST[name]}"
            is_valid = type(value) is int and 1 <= value <= _LARGEST[name]
        elif name == "options":
            expected = 'a list such as ["--qos=long"]'
            is_valid = isinstance(value, list) and all(isinstance(one, str) and one.startswith("-") for one in value)
        else:
            pattern, expected = _PATTERNS.get(name, (r"\S+", "a name"))
            is_valid = isinstance(value, str) and re.fullmatch(pattern, value) is not None
        if not is_valid:
            raise InputError(f"{where}: {name}: expected {expected}, found {value!r}")
    return SlurmSettings(**{**values, "options": tuple(values.get("options", ()))})


def read_slurm_settings(path: Path) -> SlurmSettings:
    """Read a TOML file of these keys, or one with a table ``[cluster]`` of them; raises ``InputError``."""
    table = parsed_toml(read_content(path, "settings of a cluster", most=LARGEST_TEXT), path.name)
    inside = table.get("cluster")
    if isinstance(inside, dict) and len(table) == 1:
        return checked_slurm_settings(inside, f"{path.name}: [cluster]")
    return checked_slurm_settings(table, path.name)
