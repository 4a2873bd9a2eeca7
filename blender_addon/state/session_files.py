"""Files that end with this session of Blender: what was made in the window and has no case beside it yet."""

import tempfile
from pathlib import Path

import bpy

_PREFIX = "oneframe-session-"


def session_folder() -> Path:
    """A new folder, which Blender removes when it quits."""
    return Path(tempfile.mkdtemp(prefix=_PREFIX, dir=bpy.app.tempdir))


def is_temporary(path: Path) -> bool:
    """Whether a file lies in such a folder, of this session or of an earlier one."""
    return any(part.startswith(_PREFIX) for part in path.parts)
