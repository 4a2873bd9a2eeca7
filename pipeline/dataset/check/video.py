"""The video of a dataset: as many frames as poses, and black beside the surface at them. Needs OpenCV."""

from pathlib import Path

import cv2
import numpy as np

from ...errors import InputError
from ...files.content import read_beginning, read_content
from ...surface.mesh import TriangleMesh
from ...video.film_reader import read_video_frame, video_info
from ..dataset_file import Description
from ..layout import VIDEO_FILES
from ..tables.pose_tables import POSE_COLUMNS
from .comparison import RELATIVE, require_rotation
from .depth import surface_depth

VIDEO, VIDEO_POSES = VIDEO_FILES
FRAMES_LOOKED_AT = 6
FRAMES_PER_SECOND = 24
DARK, FAR_PX = 60, 3
"""Code value that compression does not reach in a black background; distance from the surface at which it is one."""


def check_video(root: Path, description: Description, mesh: TriangleMesh | None) -> None:
    """Check the number and size of the video's frames and, if the model is known, some of them against their poses.

    Raises
    ------
    InputError
        They are not as they should be, or a file is damaged.
    """
    poses, camera = read_video_poses(root), description.camera
    if read_beginning(root / VIDEO, "a video", 8, VIDEO)[4:] != b"ftyp":
        raise InputError(f"{VIDEO}: expected an MP4 video, found another file")
    info = video_info(root / VIDEO)
    # H.264 has even sides
    width, height = (side + side % 2 for side in camera.size_wh)
    found = (info.frames, *info.size_wh)
    if found != (len(poses), width, height):
        raise InputError(
            f"{VIDEO}: expected {len(poses)} frames, as {VIDEO_POSES} has, of {width}x{height} px, found "
            f"{found[0]} of {found[1]}x{found[2]}"
        )
    if mesh is None:
        return
    near = np.ones(2 * (2 * FAR_PX + 1,), np.uint8)
    for index in np.unique(np.linspace(0, len(poses) - 1, FRAMES_LOOKED_AT).round().astype(int)).tolist():
        bright = read_video_frame(root / VIDEO, index)[: camera.height, : camera.width].max(axis=2) > DARK
        mask = surface_depth(mesh, camera, poses[index]).z > 0
        beside = bright & (cv2.dilate(mask.astype(np.uint8), near) == 0)
        if beside.sum() > 0.001 * beside.size:
            raise InputError(
                f"{VIDEO}: {int(beside.sum())} px of frame {index} lie beside the surface at its pose in {VIDEO_POSES}"
            )


def read_video_poses(root: Path) -> list[np.ndarray]:
    """The 4x4 poses of ``video/poses.csv``, mm.

    Raises
    ------
    InputError
        The file is damaged.
    """
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
