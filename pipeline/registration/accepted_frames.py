"""The frames that ``oneframe register`` has accepted, with their poses, read again from its folder."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..case.frame import PosedFrame
from ..case.loaded_case import LoadedCase
from ..errors import InputError
from ..files.content import LARGEST_FILE, read_content
from ..files.tables import parsed_json
from .colour_sources import evenly
from .pose_list import POSES, found_of
from .register_frames import LONGER_SIDE_PX, CaseRegistrar, accepted_poses, frame_files, image_paths, small_frame
from .verdict import ACCEPTED

MOST = 12
"""Frames that are taken: of more, evenly chosen ones."""


@dataclass(frozen=True)
class AcceptedFrames:
    """The poses in a folder of ``oneframe register``.

    Attributes
    ----------
    poses
        ``cam_from_model`` ``(4, 4)``, mm, by a frame's number.
    images
        The folder or the film.
    changed
        How many more are accepted, of later in the film, where it no longer shows what the case's frame shows.
    """

    poses: dict[int, np.ndarray]
    images: Path
    changed: int = 0

    @property
    def files(self) -> dict[str, Path]:
        """All that is read of the frames, by what it is."""
        return frame_files(self.images)

    def until(self, pose: np.ndarray) -> "AcceptedFrames":
        """Those up to the one that has this very pose."""
        last = max((number for number, own in self.poses.items() if own is pose), default=-1)
        return replace(self, poses={number: own for number, own in self.poses.items() if number <= last})


def accepted_frames(folder: Path, video: Path | None, loaded: LoadedCase) -> AcceptedFrames:
    """Read the list of poses in a folder; ``video`` if the frames are those of a film.

    Raises
    ------
    InputError
        There is no such list, none of its frames is accepted, or their images are not there.
    """
    path = folder / POSES if folder.is_dir() else folder
    content = read_content(path, "the poses of registered frames", most=LARGEST_FILE)
    try:
        entries: Any = parsed_json(content, str(path))
        found = found_of(entries, loaded.surface.mesh_from_model, loaded.case.mm_per_unit)
        named = {int(entry["frame"]): Path(entry["image"]) for entry in entries if entry.get("image")}
    except (InputError, AttributeError, KeyError, TypeError, ValueError):
        raise InputError(
            f"{path}: expected the poses that oneframe register writes, found something else; name the folder that it "
            "wrote, and the video of these frames with --video"
        ) from None
    poses = accepted_poses(found)
    if not poses:
        raise InputError(f"{path}: expected accepted frames, found none among {len(found)}")
    if video is None and not poses.keys() <= named.keys():
        raise InputError(f"{path}: expected the names of images, found frames of a video; name it with --video")
    if video is not None and named:
        raise InputError(f"{path}: expected frames of a video for --video, found the images of a folder")
    left_out = sum(each.changed and each.verdict.state == ACCEPTED for each in found.values())
    if video is not None:
        return AcceptedFrames(poses, video, left_out)
    images = path.parent / named[min(named)].parent
    # an image that was added or removed since changes the numbers of others
    numbers = {each.name: number for number, each in enumerate(image_paths(images) if images.is_dir() else ())}
    if missing := [named[number].name for number in poses if named[number].name not in numbers]:
        raise InputError(
            f"{images}: expected the images that were registered, {missing[0]} is not there; bring it back, or "
            "register the others again"
        )
    return AcceptedFrames({numbers[named[number].name]: pose for number, pose in poses.items()}, images, left_out)


def small_frames(
    loaded: LoadedCase, accepted: AcceptedFrames | None, most: int = MOST, longer_side_px: int = LONGER_SIDE_PX
) -> list[PosedFrame]:
    """The case's frames and at most so many of the accepted ones, evenly chosen, at a size up to registration's.

    Raises
    ------
    InputError
        The images cannot be read, or are not the case's.
    """
    frames = list(loaded.frames)
    if accepted is None:
        return [small_frame(frame, longer_side_px) for frame in frames]
    numbers = sorted(accepted.poses)
    chosen = {numbers[at] for at in evenly(len(numbers), most)}
    registrar = CaseRegistrar(loaded)
    with registrar.frames(accepted.images) as opened:
        frames += [
            PosedFrame(
                frame.image.astype(np.float32) / 255, frame.valid, registrar.camera, accepted.poses[frame.number]
            )
            for frame in opened.frames
            if frame.number in chosen and not frame.problem
        ]
    return [small_frame(frame, longer_side_px) for frame in frames]
