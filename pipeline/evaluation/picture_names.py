"""Names of the pictures of a comparison: one for each photograph, also where the photographs share a name."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

LONGEST_NAME = 200
"""Bytes of a picture's name before its extension; file systems allow 255 in all."""


def picture_names(photographs: Sequence[Path], taken: Sequence[str]) -> list[str]:
    """A file name ``*.png`` for each photograph: its own with another extension, with a number where that is taken.

    Parameters
    ----------
    photographs
        The files.
    taken
        Names of other files in the same folder.

    Returns
    -------
    Printable names that differ from each other and from ``taken`` also where a file system ignores case.
    """
    used, names = {name.casefold() for name in taken}, []
    numbers: Counter[str] = Counter()
    for photograph in photographs:
        stem = "".join(letter if letter.isprintable() else "_" for letter in photograph.stem)
        stem = stem.encode(errors="replace")[:LONGEST_NAME].decode(errors="ignore")
        name = f"{stem}.png"
        while name.casefold() in used:
            # goes on where the last photograph of this name stopped: a list may hold thousands
            numbers[stem.casefold()] += 1
            name = f"{stem}_{numbers[stem.casefold()] + 1}.png"
        used.add(name.casefold())
        names.append(name)
    return names


def shown_path(path: Path) -> str:
    """A file's name on one line, for messages and tables; it begins no formula in a spreadsheet.

    Control characters become escapes such as ``\\n``. A name that begins with ``=``, ``+``, ``-`` or ``@``, which
    spreadsheets would calculate, gets ``./`` before it and stays a name of the same file.
    """
    text = path.name.encode(errors="backslashreplace").decode()
    text = "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)
    return f"./{text}" if text.startswith(("=", "+", "-", "@")) else text
