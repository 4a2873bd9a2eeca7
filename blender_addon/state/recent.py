"""Files that the user has opened: the latest cases, and where a film of a name was, also for another session."""

from functools import lru_cache
from pathlib import Path

import bpy

from ..class_registration import at_end
from ..pipeline.files.content import write_bytes_atomically
from .scene_files import is_temporary

MOST = {"cases": 6, "films": 60}
"""Kind of file -> how many are remembered."""


def own_folder(name: str) -> Path:
    """A folder of the extension for the user's files; in a checkout, one that lasts for this session."""
    package = __package__.rpartition(".")[0] if __package__ else ""
    try:
        return Path(bpy.utils.extension_path_user(package, path=name, create=True))
    except ValueError:  # not an extension
        folder = Path(bpy.app.tempdir) / f"oneframe_{name}"
        folder.mkdir(exist_ok=True)
        return folder


@lru_cache(maxsize=2)
def recent(kind: str) -> tuple[Path, ...]:
    """The files of a kind that were opened, the latest first; those that are gone too."""
    file = own_folder("recent") / f"{kind}.txt"
    names = file.read_text("utf-8", errors="surrogateescape").splitlines() if file.exists() else []
    return tuple(map(Path, names))


def remember(kind: str, path: Path) -> None:
    """Remember a file as the latest of its kind.

    Raises
    ------
    OSError
        The list cannot be written.
    """
    if is_temporary(path):
        return
    names = list(dict.fromkeys(map(str, (path, *recent(kind)))))[: MOST[kind]]
    text = "".join(f"{name}\n" for name in names)
    write_bytes_atomically(own_folder("recent") / f"{kind}.txt", text.encode("utf-8", errors="surrogateescape"))
    recent.cache_clear()


PARTS = (at_end(recent.cache_clear),)
