"""Files of the frames that are taken: beside the video at first, beside the case once that is saved."""

import os
import shutil
import tempfile
from pathlib import Path

import bpy

from ..pipeline.errors import InputError
from ..pipeline.files.kinds import PNG
from ..pipeline.files.outputs import check_outputs, companion, writing
from ..state import from_scene

_PREFIX = "oneframe-video-"


def folder_for(video: Path) -> Path:
    """The folder of the video; a temporary one if nothing can be written there."""
    if os.access(video.parent, os.W_OK):
        return video.parent
    return Path(tempfile.mkdtemp(prefix=_PREFIX, dir=bpy.app.tempdir))


def keep_frame_beside(scene: bpy.types.Scene, folder: Path) -> list[Path]:
    """Copy the case's frame into a folder if it was taken from the video, and use the copy from now on.

    Returns
    -------
    The file that was written, if any.

    Raises
    ------
    InputError
        There is another picture of this name.
    """
    settings, video = scene.oneframe, scene.oneframe_video
    if not video.taken_path or settings.frame_path != video.taken_path:
        return []
    source = from_scene.absolute_path(settings.frame_path)
    target = folder / source.name
    if source.parent.resolve() == folder.resolve():
        return []
    is_there = target.exists() and target.read_bytes() == source.read_bytes()
    if not is_there:
        if target.exists():
            raise InputError(
                f"{target}: expected no such file, or one with this frame, found another image; rename it, or save "
                "the case in another folder"
            )
        check_outputs([companion(target, PNG)], {"frame": source})
        with writing(target):
            partial = target.with_name(f".partial-{target.name}")
            shutil.copyfile(source, partial)
            partial.replace(target)
    settings.frame_path = video.taken_path = str(target.resolve())
    return [] if is_there else [target]
