"""The pictures beside the views: the contact sheet has them, the overlay the frame's size, the video its poses."""

from pathlib import Path

import cv2
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...errors import InputError
from ...surface.mesh import TriangleMesh
from ...video.frame_reader import read_video_frame, video_info
from ..layout import ViewPaths
from .contents import VIDEO, VIDEO_POSES
from .depth import surface_depth
from .files import DamagedFile, opened
from .findings import Findings
from .png import PngHeader, read_png
from .records import Description

KIND = "damaged files"
SHEET, OVERLAY = "contact_sheet.png", "overlay.png"
SHEET_VIEWS, SHEET_COLUMNS, SHEET_TILE_PX, SHEET_GAP_PX = 24, 6, 240, 4
FRAMES_LOOKED_AT = 6
DARK, FAR_PX = 60, 3
"""Code value that compression does not reach in a black background; distance from the surface at which it is one."""


def check_overlay(root: Path, description: Description, findings: Findings) -> None:
    """Check that ``overlay.png`` is an image of the frame's size."""
    frame = description.content["frame"]
    try:
        read_png(root, OVERLAY, PngHeader(frame["width"], frame["height"], channels=3, bits=8))
    except DamagedFile as damage:
        findings.add(KIND, damage)


def check_contact_sheet(root: Path, description: Description, findings: Findings) -> None:
    """Check that ``contact_sheet.png`` shows the views: rows of six, averaged over areas to at most 240 px."""
    chosen = np.unique(np.linspace(0, description.count - 1, min(SHEET_VIEWS, description.count)).round().astype(int))
    width, height = description.camera.size_wh
    if width > SHEET_TILE_PX:
        width, height = SHEET_TILE_PX, max(1, round(height * SHEET_TILE_PX / width))
    columns = min(SHEET_COLUMNS, len(chosen))
    across, down = width + SHEET_GAP_PX, height + SHEET_GAP_PX
    size = (columns * across + SHEET_GAP_PX, -(-len(chosen) // columns) * down + SHEET_GAP_PX)
    try:
        sheet = read_png(root, SHEET, PngHeader(*size, channels=3, bits=8))
        for place, index in enumerate(chosen.tolist()):
            row, column = divmod(place, columns)
            top, left = row * down + SHEET_GAP_PX, column * across + SHEET_GAP_PX
            name = ViewPaths(root, index).relative("rgb")
            image = read_png(root, name, PngHeader(*description.camera.size_wh, channels=3, bits=8))
            tile = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
            found = sheet[top : top + height, left : left + width]
            if np.abs(found.astype(int) - tile).max() > 2:
                raise DamagedFile(f"{SHEET}: the picture in row {row + 1}, column {column + 1} is not {name}")
    except DamagedFile as damage:
        findings.add(KIND, damage)


def check_video(
    root: Path, description: Description, poses: list[np.ndarray], mesh: TriangleMesh | None, findings: Findings
) -> None:
    """Check the number and size of the video's frames and, if the model is known, some of them against their poses."""
    camera = description.camera
    # H.264 has even sides
    width, height = (side + side % 2 for side in camera.size_wh)
    try:
        with opened(root, VIDEO) as (stream, size):
            # the reader would take a playlist, and open what it names
            if stream.read(8)[4:] != b"ftyp" or size > len(poses) * width * height * 6 + (1 << 20):
                raise DamagedFile(f"{VIDEO}: expected an MP4 video of {len(poses)} frames, found {size} other bytes")
        info = video_info(root / VIDEO)
        found = (info.frames, *info.size_wh)
        if found != (len(poses), width, height):
            raise DamagedFile(
                f"{VIDEO}: expected {len(poses)} frames, as {VIDEO_POSES} has, of {width}x{height} px, found "
                f"{found[0]} of {found[1]}x{found[2]}"
            )
        if mesh is not None:
            _check_frames(root, camera, poses, mesh)
    except (DamagedFile, InputError) as damage:
        findings.add(KIND, damage)


def _check_frames(root: Path, camera: PinholeCamera, poses: list[np.ndarray], mesh: TriangleMesh) -> None:
    """Check that frames are black beside the surface at their poses."""
    chosen = np.unique(np.linspace(0, len(poses) - 1, FRAMES_LOOKED_AT).round().astype(int)).tolist()
    bright = [
        read_video_frame(root / VIDEO, index)[: camera.height, : camera.width].max(axis=2) > DARK for index in chosen
    ]
    masks = [surface_depth(mesh, camera, poses[index]).z > 0 for index in chosen]
    near = np.ones(2 * (2 * FAR_PX + 1,), np.uint8)
    for place, index in enumerate(chosen):
        beside = bright[place] & (cv2.dilate(masks[place].astype(np.uint8), near) == 0)
        if beside.sum() > 0.001 * beside.size:
            raise DamagedFile(
                f"{VIDEO}: {int(beside.sum())} px of frame {index} lie beside the surface at its pose in {VIDEO_POSES}"
            )
