"""The files of a dataset against the same rendered again from its case: what is wrong in all files alike shows here.

Under the versions that made the dataset pixels must be the same. Under others they must be almost, and so must those of
another renderer, which proves the one that made them.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TextIO

import cv2
import numpy as np

from ...errors import InputError
from ...files.content import read_content
from ...files.numbers import npy_array
from ...files.temporary import temporary_folder, writing_temporary
from ...progress import Progress
from ...surface.mesh import LARGEST_COORDINATE
from ...transforms import camera_centre
from ...video.film_reader import read_video_frame
from ..dataset_file import Description
from ..layout import ViewPaths
from .comparison import read_table, require_equal, require_pose
from .findings import Findings
from .video import VIDEO, VIDEO_POSES, read_video_poses

KIND = "files that differ from those rendered again"
ENCODED_CODES = 12
"""Allowed mean difference of two frames of the video, in codes: what H.264 keeps depends on the frames around.

Measured: up to 5 on tissue, 9.2 on noise of any strength, of which the encoder drops up to 34.
"""


@dataclass(frozen=True)
class _Allowed:
    """Pixels that differ by more codes, or in depth by more footprints (depth / f), may be this fraction and number."""

    codes: float = 0.0
    footprints: float = 0.0
    fraction: float = 0.0
    number: int = 0


EXACT, OTHER_VERSIONS = _Allowed(), _Allowed(8, 0.5, 0.01)
OTHER_RENDERER = _Allowed(1, 0.1, 1e-3, 8)
"""Measured between ``raster`` and Cycles, whose rays are off by up to 0.01 px: no pixel of a mask, 3e-5 of the pixels
of ``mask_observed`` and exact RGB, and 2e-4 of anti-aliased or filled RGB; 1e-5 of the depths."""


class Renderer(Protocol):
    """Renders the dataset again.

    Attributes
    ----------
    description
        The content of ``dataset.json`` that the case gives.
    same_renderer
        Whether what rendered the dataset also renders it again.
    """

    description: dict[str, Any]
    same_renderer: bool

    def view(self, index: int) -> tuple[dict[str, bytes], dict[str, Any]]:
        """The files of a view, by kind, and the object of its record."""

    def files(self) -> dict[str, bytes]:
        """The files that are made from the case alone, by path relative to the dataset."""

    def video_poses(self, frames: int) -> np.ndarray:
        """``(frames, 4, 4)`` poses of a video of so many frames, mm."""

    def write_video(self, path: Path, poses: np.ndarray) -> None:
        """Write the views from ``(N, 4, 4)`` poses, mm, as a video, encoded as the dataset's."""


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

    In the dataset's folder the other checks found nothing; ``findings`` receives what is wrong.
    """
    before = len(findings)
    same_versions = renderer.description["versions"] == description.content["versions"]
    for key in renderer.description.keys() | description.content.keys():
        if key != "versions":
            with findings.collecting(KIND):
                given, expected = ({key: content.get(key)} for content in (description.content, renderer.description))
                require_equal(given, expected, "dataset.json: not that of the case")
    if len(findings) > before:
        return
    for name, data in renderer.files().items():
        with findings.collecting(KIND):
            _compare_file(root, name, data, same_versions)
    focal_px = description.camera.fx
    with Progress(len(views), "views rendered again", stream=stream) as progress:
        for index in views:
            with findings.collecting(KIND):
                _compare_view(ViewPaths(root, index), renderer, same_versions, focal_px)
            progress.advance()
    if (root / "video").is_dir():
        with findings.collecting(KIND):
            _compare_video(root, renderer, len(views))


def _compare_file(root: Path, name: str, data: bytes, same_versions: bool) -> None:
    """Compare a file that is not a view's; of a model, other versions may change the last bit of a normal or colour."""
    found = read_content(root / name, "a file of the dataset", name)
    if found == data:
        return
    if name.endswith(".png"):
        _compare_images(name, _decoded(name, found), _decoded(name, data), EXACT if same_versions else OTHER_VERSIONS)
    elif same_versions or name.endswith((".md", ".json")):
        raise InputError(f"{name}: it has another content when it is made again")


def _compare_view(paths: ViewPaths, renderer: Renderer, same_versions: bool, focal_px: float) -> None:
    files, expected = renderer.view(paths.index)
    where = paths.relative("frame")
    found = read_table(paths.root, where)
    require_pose(_pose(found), _pose(expected), where, "the view rendered again")
    if same_versions:
        counts = ("gt_info", "px_count_observed") if renderer.same_renderer else ()
        names = ("depth_scale", "attempts", "rejections", *counts)
        require_equal({name: found[name] for name in names}, {name: expected[name] for name in names}, where)
    allowed = EXACT if renderer.same_renderer else OTHER_RENDERER
    for kind, data in files.items():
        name = paths.relative(kind)
        on_disk = read_content(paths.root / name, "a file of the view", name)
        if on_disk != data:
            images = _decoded(name, on_disk), _decoded(name, data)
            tolerance = allowed if same_versions else OTHER_VERSIONS
            _compare_images(name, *images, tolerance, focal_px, camera_centre(_pose(expected)))


def _compare_video(root: Path, renderer: Renderer, frames: int) -> None:
    poses = read_video_poses(root)
    expected = renderer.video_poses(len(poses))
    for number, pose in enumerate(poses):
        require_pose(pose, expected[number], f"{VIDEO_POSES}: row {number}", "the trajectory of the case")
    chosen = np.unique(np.linspace(0, len(poses) - 1, min(frames, len(poses))).round().astype(int))
    with temporary_folder() as folder:
        with writing_temporary():
            renderer.write_video(folder / "again.mp4", expected[chosen])
        for number, index in enumerate(chosen.tolist()):
            found, again = read_video_frame(root / VIDEO, index), read_video_frame(folder / "again.mp4", number)
            if found.shape != again.shape:
                raise InputError(f"{VIDEO}: expected frames of the shape {again.shape}, found {found.shape}")
            off = float(np.abs(found.astype(float) - again).mean())
            if off > ENCODED_CODES:
                raise InputError(
                    f"{VIDEO}: frame {index} differs by {off:.0f} codes on average from the one rendered again"
                )


def _compare_images(
    name: str,
    found: np.ndarray,
    expected: np.ndarray,
    allowed: _Allowed,
    focal_px: float = 1.0,
    centre_model: np.ndarray | float = 0.0,
) -> None:
    if found.shape != expected.shape:
        raise InputError(f"{name}: expected the shape {expected.shape} of the one rendered again, found {found.shape}")
    difference = np.abs(found.astype(np.float64) - expected)
    difference = difference if difference.ndim == 2 else difference.max(axis=2)
    limit: float | np.ndarray = allowed.codes
    if expected.dtype != np.uint8 and expected.ndim == 2:
        # depth, which a PNG rounds
        limit = allowed.footprints / focal_px * expected + (allowed is not EXACT and expected.dtype == np.uint16)
    elif expected.dtype == np.float32:
        # points, which move along their rays as depth differs
        limit = allowed.footprints / focal_px * np.linalg.norm(expected - centre_model, axis=2)
    wrong = int((difference > limit).sum())
    if wrong > allowed.fraction * difference.size + allowed.number:
        raise InputError(
            f"{name}: {wrong} px differ from the image rendered again, the largest by {difference.max():g}"
        )


def _decoded(name: str, data: bytes) -> np.ndarray:
    if name.endswith(".npy"):
        # a pixel without a point differs from any that has one
        return np.nan_to_num(npy_array(data, name), nan=LARGEST_COORDINATE)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputError(f"{name}: expected a PNG image, found a file that cannot be decoded")
    return image


def _pose(record: dict[str, Any]) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.reshape(record["cam_R_m2c"], (3, 3)), record["cam_t_m2c"]
    return pose
