"""Undo takes back what a step through a queue has saved: the frame's files are as they were, and redo saves again."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
from bpy.app.handlers import persistent

from ..class_registration import listening
from ..pipeline.case.case_history import history_path
from ..pipeline.files.content import write_files_atomically
from ..state import workbench
from ..state.scene_files import forget_stamps

Content = bytes | None
"""Of a file; ``None`` if there is none."""

_saves: list[dict[Path, tuple[Content, Content]]] = []
"""The saves of this session: the contents of their files before and after. The scene has their count, for undo."""

_done = 0
"""How many of them the files hold."""


@contextmanager
def undoable(scene: bpy.types.Scene, path: Path) -> Iterator[None]:
    """Save to a case file inside the block, in an operator that is an undo step."""
    global _done
    files = path, history_path(path)
    before = [_content(file) for file in files]
    yield
    after = [_content(file) for file in files]
    _saves[_done:] = [dict(zip(files, zip(before, after, strict=True), strict=True))]
    _done = scene.oneframe.queue_saves = len(_saves)


def _content(path: Path) -> Content:
    return path.read_bytes() if path.exists() else None


@persistent
def _follow(*_arguments: object) -> None:
    """Undo or redo: bring the files to what the scene counts. Those that another program wrote meanwhile stay."""
    global _done
    scene = workbench.existing()
    wanted = _done if scene is None else scene.oneframe.queue_saves
    while _done != wanted and wanted <= len(_saves):
        is_undo = wanted < _done
        files = _saves[_done - 1 if is_undo else _done]
        states = {path: contents if is_undo else contents[::-1] for path, contents in files.items()}
        if all(_content(path) == present for path, (_, present) in states.items()):
            for path in (path for path, (content, _) in states.items() if content is None):
                path.unlink(missing_ok=True)
            write_files_atomically({path: content for path, (content, _) in states.items() if content is not None})
        _done += -1 if is_undo else 1
        forget_stamps()


@persistent
def _forget(*_arguments: object) -> None:
    """Another file: its scene counts what another session has saved."""
    global _done
    _saves.clear()
    _done = 0
    if (scene := workbench.existing()) is not None:
        scene.oneframe.queue_saves = 0


PARTS = (
    listening(bpy.app.handlers.undo_post, _follow),
    listening(bpy.app.handlers.redo_post, _follow),
    listening(bpy.app.handlers.load_post, _forget),
)
