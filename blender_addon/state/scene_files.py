"""The files of a scene: which they are, whether they last, and whether they have changed; the latest ones opened."""

import tempfile
import time
from collections.abc import Callable, Collection, Mapping
from functools import lru_cache
from pathlib import Path

import bpy

from ..class_registration import at_end
from ..pipeline.errors import InputError
from ..pipeline.files.writing import write_bytes_atomically
from . import from_scene
from .case_of_file import further_frames

WATCH_S = 2.0

Stamp = tuple[int, int]
"""Modification time and size; (0, 0) for a file that cannot be read."""

saved: list[Callable[[bpy.types.Scene], None]] = []
"""Called when a scene's case was saved, with the scene: what belongs to the case is kept beside its file."""

_SESSION = "oneframe-session-"


def input_files(scene: bpy.types.Scene) -> dict[str, Path]:
    """Case file, frames, surface and structures, by what they are, which no operator replaces; those the scene has."""
    settings = scene.oneframe
    texts = {"case": settings.case_path, "frame": settings.frame_path}
    texts |= {f"frame {n}": str(each.image) for n, each in enumerate(further_frames(scene), start=2)}
    surface = from_scene.present_surface(scene)
    if surface is not None:
        texts["surface"] = surface.oneframe.mesh_path
        structures = [child for child in surface.children if child.oneframe.role == "STRUCTURE"]
        texts |= {f"structure {child.name}": child.oneframe.mesh_path for child in structures}
    return {name: from_scene.absolute_path(text) for name, text in texts.items() if text}


def usual_folder(scene: bpy.types.Scene) -> Path:
    """The folder of the case, the frame, the surface or the CT: of the first that is no file of this session."""
    for text in (*map(str, input_files(scene).values()), scene.oneframe_ct.path):
        if text and not is_temporary(path := from_scene.absolute_path(text)):
            return path.parent
    return Path()


def session_folder() -> Path:
    """A new folder for what has no case beside it yet; Blender removes it when it quits."""
    return Path(tempfile.mkdtemp(prefix=_SESSION, dir=bpy.app.tempdir))


def is_temporary(path: Path) -> bool:
    """Whether a file lies in such a folder, of this session or of an earlier one."""
    return any(part.startswith(_SESSION) for part in path.parts)


def check_lasting(files: Mapping[str, Path]) -> None:
    """Check that files, by what they are, do not end with a session."""
    for name, path in files.items():
        if is_temporary(path):
            raise InputError(
                f"{name}: expected a file that lasts, found {path.name}, which ends with this session of Blender; "
                "press Save Case, which keeps it beside the case"
            )


def known_stamp(path: Path) -> Stamp:
    """The file's stamp, at most :data:`WATCH_S` old, for drawing: a drive on the network may take seconds to answer."""
    return _stamp(path, int(time.monotonic() / WATCH_S))


@lru_cache(maxsize=4096)
def _stamp(path: Path, _period: int) -> Stamp:
    try:
        return from_scene.stamp(path)
    except InputError:
        return 0, 0


def forget_stamps() -> None:
    """Look again at files of which one was just written."""
    _stamp.cache_clear()


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


def remember(kind: str, path: Path, instead_of: Collection[Path] = ()) -> None:
    """Remember a file as the latest of its kind, instead of others.

    Raises
    ------
    OSError
        The list cannot be written.
    """
    if is_temporary(path):
        return
    others = [each for each in recent(kind) if each != path and each not in instead_of]
    text = "".join(f"{each}\n" for each in (path, *others)[: MOST[kind]])
    write_bytes_atomically(own_folder("recent") / f"{kind}.txt", text.encode("utf-8", errors="surrogateescape"))
    recent.cache_clear()


PARTS = (at_end(recent.cache_clear),)
