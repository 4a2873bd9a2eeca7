"""Files that end with this session of Blender: what was made in the window and has no case beside it yet."""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import bpy

from ..pipeline.errors import InputError

_PREFIX = "oneframe-session-"


def session_folder() -> Path:
    """A new folder, which Blender removes when it quits."""
    return Path(tempfile.mkdtemp(prefix=_PREFIX, dir=bpy.app.tempdir))


def is_temporary(path: Path) -> bool:
    """Whether a file lies in such a folder, of this session or of an earlier one."""
    return any(part.startswith(_PREFIX) for part in path.parts)


def check_lasting(files: Mapping[str, Path]) -> None:
    """Check that files, by what they are, do not end with a session.

    Raises
    ------
    InputError
        One does.
    """
    for name, path in files.items():
        if is_temporary(path):
            raise InputError(
                f"{name}: expected a file that lasts, found {path.name}, which ends with this session of Blender; "
                "press Save Case, which keeps it beside the case"
            )
