"""The files of a dataset against the same rendered again from its case: what is wrong in all files alike shows here.

Under the versions that made the dataset pixels must be the same, under others almost.
"""

import json
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TextIO

import cv2
import numpy as np

from ...errors import InputError
from ...files.numbers import npy_array
from ...progress import Progress
from ...video.frame_reader import read_video_frame
from ..layout import ViewPaths
from .comparison import require_equal, require_pose
from .contents import VIDEO, VIDEO_POSES
from .files import DamagedFile, hash_of, read_bytes
from .findings import Findings
from .pose_tables import read_video_poses
from .records import Description

KIND = "files that differ from those rendered again"
OTHER_CODES, OTHER_PX = 8, 0.01
"""Under other versions: a pixel differs if it does by more codes than this; allowed fraction of such pixels."""
COMPRESSION_CODES = 16
"""Allowed mean difference of a frame of the video, in codes."""


class Renderer(Protocol):
    """Renders the dataset again.

    Attributes
    ----------
    description
        The content of ``dataset.json`` that the case gives.
    """

    description: dict[str, Any]

    def view(self, index: int) -> tuple[dict[str, bytes], dict[str, Any]]:
        """The files of a view, by kind, and the object of its record."""

    def files(self) -> dict[str, bytes]:
        """The files that are made from the case alone, by path relative to the dataset."""

    def video_poses(self, frames: int) -> np.ndarray:
        """``(frames, 4, 4)`` poses of a video of so many frames, mm."""

    def picture(self, cam_from_model: np.ndarray) -> np.ndarray:
        """``(H, W, 3)`` uint8 view from a pose (4x4, mm)."""


@dataclass(frozen=True)
class Rerendering:
    """How to render a dataset again, from its description; how many views."""

    open: Callable[[Description], AbstractContextManager[Renderer]]
    views: int


def check_rerendered(
    root: Path,
    description: Description,
    renderer: Renderer,
    views: Sequence[int],
    findings: Findings,
    stream: TextIO | None,
) -> None:
    """Render some views, a frame of the video for each, and the files beside them again, and compare.

    Parameters
    ----------
    root, description
        The dataset's folder, in which the other checks found nothing; its description.
    renderer
        Renders the case.
    views
        Numbers of the views.
    findings
        Receives what is wrong.
    stream
        Stream for the progress.
    """
    before = len(findings)
    same_versions = renderer.description["versions"] == description.content["versions"]
    for key in renderer.description.keys() | description.content.keys():
        if key != "versions":
            _collect(findings, _compare_description, key, description.content.get(key), renderer.description.get(key))
    if len(findings) > before:
        return
    for name, data in renderer.files().items():
        _collect(findings, _compare_file, root, name, data, same_versions)
    with Progress(len(views), "views rendered again", stream=stream) as progress:
        for index in views:
            _collect(findings, _compare_view, ViewPaths(root, index), renderer, same_versions)
            progress.advance()
    if (root / "video").is_dir():
        _collect(findings, _compare_video, root, renderer, len(views))


def _collect(findings: Findings, check: Any, *arguments: Any) -> None:
    try:
        check(*arguments)
    except (DamagedFile, InputError) as damage:
        findings.add(KIND, damage)


def _compare_description(key: str, found: object, expected: object) -> None:
    require_equal({key: found}, {key: expected}, "dataset.json: not that of the case")


def _compare_file(root: Path, name: str, data: bytes, same_versions: bool) -> None:
    """Compare a file that is not a view's; of a model, other versions may change the last bit of a normal or colour."""
    if hash_of(root, name, len(data)) is None:
        raise DamagedFile(f"{name}: expected {len(data)} bytes, as it has when it is made again")
    found = read_bytes(root, name, len(data))
    if found == data:
        return
    if name.endswith(".png"):
        _compare_images(name, _decoded(name, found), _decoded(name, data), same_versions)
    elif same_versions or name.endswith((".md", ".json")):
        raise DamagedFile(f"{name}: it has another content when it is made again")


def _compare_view(paths: ViewPaths, renderer: Renderer, same_versions: bool) -> None:
    files, expected = renderer.view(paths.index)
    where = paths.relative("frame")
    found = json.loads(read_bytes(paths.root, where, 1 << 28))
    require_pose(_pose(found), _pose(expected), where, "the view rendered again")
    if same_versions:
        names = ("depth_scale", "gt_info", "px_count_observed", "attempts", "rejections")
        require_equal({name: found[name] for name in names}, {name: expected[name] for name in names}, where)
    for kind, data in files.items():
        name = paths.relative(kind)
        on_disk = read_bytes(paths.root, name, 1 << 30)
        if on_disk != data:
            _compare_images(name, _decoded(name, on_disk), _decoded(name, data), same_versions)


def _compare_video(root: Path, renderer: Renderer, frames: int) -> None:
    poses = read_video_poses(root, Findings())
    expected = renderer.video_poses(len(poses))
    for number, pose in enumerate(poses):
        require_pose(pose, expected[number], f"{VIDEO_POSES}: row {number}", "the trajectory of the case")
    for index in np.unique(np.linspace(0, len(poses) - 1, min(frames, len(poses))).round().astype(int)).tolist():
        picture = renderer.picture(expected[index])
        height, width = picture.shape[:2]
        found = read_video_frame(root / VIDEO, index)[:height, :width]
        off = float(np.abs(found.astype(float) - picture).mean())
        if off > COMPRESSION_CODES:
            raise DamagedFile(
                f"{VIDEO}: frame {index} differs by {off:.0f} codes on average from the one rendered again"
            )


def _compare_images(name: str, found: np.ndarray, expected: np.ndarray, same_versions: bool) -> None:
    if found.shape != expected.shape:
        raise DamagedFile(f"{name}: expected the shape {expected.shape} of the one rendered again, found {found.shape}")
    difference = np.abs(found.astype(np.float64) - expected)
    difference = difference if difference.ndim == 2 else difference.max(axis=2)
    # depths are compared on their own scale
    allowed = 0.0 if same_versions else OTHER_CODES if expected.dtype == np.uint8 else 1e-3 * expected
    wrong = int((difference > allowed).sum())
    if wrong > (0 if same_versions else OTHER_PX * difference.size):
        raise DamagedFile(
            f"{name}: {wrong} px differ from the image rendered again, the largest by {difference.max():g}"
        )


def _decoded(name: str, data: bytes) -> np.ndarray:
    if name.endswith(".npy"):
        return npy_array(data, name)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise DamagedFile(f"{name}: expected a PNG image, found a file that cannot be decoded")
    return image


def _pose(record: dict[str, Any]) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.reshape(record["cam_R_m2c"], (3, 3)), record["cam_t_m2c"]
    return pose
