"""The video of a dataset: as many frames as poses; what they show is told by rendering again."""

from pathlib import Path

import numpy as np

from ...errors import InputError
from ...files.content import read_beginning, read_content
from ...video.film_reader import Film
from ..dataset_file import Description
from ..layout import VIDEO_FILES
from ..tables.pose_tables import POSE_COLUMNS
from .comparison import RELATIVE, require_rotation

VIDEO, VIDEO_POSES = VIDEO_FILES
FRAMES_PER_SECOND = 24


def check_video(root: Path, description: Description) -> None:
    """Check that the video can be decoded to its end, and has a frame of the right size for each pose."""
    poses = read_video_poses(root)
    if read_beginning(root / VIDEO, "a video", 8, VIDEO)[4:] != b"ftyp":
        raise InputError(f"{VIDEO}: expected an MP4 video, found another file")
    # H.264 has even sides
    width, height = (side + side % 2 for side in description.camera.size_wh)
    with Film(root / VIDEO) as film:
        found = (sum(1 for _ in film), *film.info.size_wh)
    if found != (len(poses), width, height):
        raise InputError(
            f"{VIDEO}: expected {len(poses)} frames, as {VIDEO_POSES} has, of {width}x{height} px, found "
            f"{found[0]} of {found[1]}x{found[2]}"
        )


def read_video_poses(root: Path) -> list[np.ndarray]:
    """The 4x4 poses of ``video/poses.csv``, mm."""
    header, *rows = read_content(root / VIDEO_POSES, "the poses of a video", VIDEO_POSES).splitlines()
    columns = ("frame", "time_s", *POSE_COLUMNS)
    try:
        values = np.array([row.split(b",") for row in rows], np.float64)
        numbers = np.arange(len(rows))
        times = np.stack([numbers, numbers / FRAMES_PER_SECOND], axis=1)
        near = np.allclose(values[:, :2], times, rtol=RELATIVE, atol=RELATIVE)
        if header.decode() != ",".join(columns) or not near or not np.isfinite(values).all():
            raise ValueError
        poses = np.tile(np.eye(4), (len(rows), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = values[:, 2:11].reshape(-1, 3, 3), values[:, 11:]
    except (ValueError, IndexError):
        raise InputError(
            f"{VIDEO_POSES}: expected the columns {', '.join(columns)} and a row of numbers for each frame, found "
            "another table"
        ) from None
    for number, pose in enumerate(poses):
        require_rotation(pose, f"{VIDEO_POSES}: row {number}")
    return [*poses]
