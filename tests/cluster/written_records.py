"""Which finished views there are, and whether one was written again."""

from contextlib import suppress
from pathlib import Path


def records(root: Path) -> dict[str, tuple[int, int]]:
    """Each view's record, with what changes when it is written again."""
    found = {}
    for path in root.glob("*/*/frame/[0-9]*.json"):
        with suppress(OSError):  # it is being replaced
            state = path.stat()
            found[path.relative_to(root).as_posix()] = (state.st_ino, state.st_mtime_ns)
    return found
