"""Names in tables, of places in files, and on command lines: unknown and missing keys, and a hint for a misspelt one.

Imports neither numpy nor Blender: ``--help`` must not wait for them.
"""

import difflib
import re
from collections.abc import Mapping
from pathlib import Path

from ..errors import InputError


def check_keys(table: Mapping, required: tuple[str, ...], optional: tuple[str, ...], where: str) -> None:
    """Check the keys of a table; ``where`` begins the messages, such as ``"case.toml: [frame] "``."""
    known = required + optional
    for key in table:
        if key not in known:
            raise InputError(f"{where}unknown key {key!r}; {nearest_name(key, known)}")
    for key in required:
        if key not in table:
            raise InputError(f"{where}expected a key {key!r}, it is missing")


def nearest_name(name: str, known: tuple[str, ...]) -> str:
    """A hint for a misspelt name: the nearest known one, or all of them."""
    # no more of a name than a key can have: the time grows with its square
    near = difflib.get_close_matches(name[:100].lower(), [key.lower() for key in known], n=1, cutoff=0.5)
    if near:
        return f"did you mean {next(key for key in known if key.lower() == near[0])!r}?"
    return "expected one of " + ", ".join(repr(key) for key in known)


def file_and_place(path: Path) -> tuple[Path, str]:
    """A file, and what in it is meant: ``scene_camera.json#7``; empty where there is no # after a file's name."""
    text = str(path)
    ends = [match.start() for match in re.finditer("#", text)]
    end = next((end for end in ends if Path(text[:end]).is_file()), None)
    return (path, "") if end is None or path.is_file() else (Path(text[:end]), text[end + 1 :])


def described(value: object) -> str:
    """What a value of a file is, for a message: numbers, a short word, or its kind.

    Text stays out: in files of other programs it may name a patient.
    """
    if isinstance(value, str):
        return repr(value) if re.fullmatch(r"([a-z][a-z0-9_]{0,19})?", value) else "a text"
    if isinstance(value, list | tuple):
        is_short = len(value) <= 16 and all(isinstance(part, int | float) for part in value)
        return str(list(value)) if is_short else f"a list of {len(value)}"
    return "a table" if isinstance(value, Mapping) else repr(value)[:60]
