"""Check whether a dataset is complete and consistent: files, hashes, tables, images, and poses against pixels.

The check does not read the files with the code that wrote them: it decodes images with OpenCV, converts the poses and
intrinsics of every table itself, and computes depths by projecting the model (:mod:`pipeline.dataset.check.depth`).
Needs cv2 and OpenCV's video reader.
"""

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import cv2
import numpy as np

from ...errors import InputError
from ...images.image_check import check_image_file
from ...progress import Progress
from ...projection.silhouette import SilhouetteEdges
from ...surface.mesh import diameter
from ...surface.mesh_reader import read_mesh
from ..layout import CHECKSUMS, OBJECT_ID, RECORD, SPLIT, VIEWS_PER_SCENE, WORK, ViewPaths
from .depth import DepthAgreement
from .findings import Findings
from .images import check_view
from .records import DamagedFile, Identity, ViewRecord, mapping, numbers, read_identity, read_object, read_view_record
from .tables import (
    SCENE_TABLES,
    check_camera_file,
    check_nerf_file,
    check_pose_table,
    check_scene_tables,
    check_video_poses,
)

DEFAULT_VIEWS = 200
DESKTOP_FILES = {".DS_Store", "Thumbs.db", "desktop.ini"}
MODEL, MODELS_INFO = f"models/obj_{OBJECT_ID:06d}.ply", "models/models_info.json"
VIDEO, VIDEO_POSES = "video/trajectory.mp4", "video/poses.csv"
AGAIN = "run the same command of render_dataset.py again"


@dataclass(frozen=True)
class CheckReport:
    """The result of checking a dataset.

    Attributes
    ----------
    count
        Number of views of the dataset; 0 if it could not be read.
    findings
        What is wrong; empty if the dataset is complete and consistent.
    hashed
        Number of files whose hash was compared.
    compared
        Agreement of depth image and surface, for each view whose pixels were checked and fit.
    """

    count: int
    findings: Findings
    hashed: int
    compared: tuple[DepthAgreement, ...]

    def summary(self) -> str:
        """The result as one line."""
        if self.findings:
            wrong = len(self.findings)
            name = f"dataset of {self.count} views" if self.count else "dataset"
            return f"{name}: NOT complete and consistent, {wrong} finding{'s' * (wrong > 1)}"
        hashed = f"hashes of {self.hashed} files" if self.hashed else "no hashes"
        checked = f"checked: {hashed}, all tables, images and poses of {len(self.compared)} views"
        pixels = sum(view.compared for view in self.compared)
        if pixels:
            agreeing = sum(view.agreeing for view in self.compared) / pixels
            dz = np.median([view.median_dz_mm for view in self.compared if view.compared])
            shift = max(float(np.hypot(*view.shift_px)) for view in self.compared)
            checked += (
                f"; the reprojected surface agrees with the depth images at {agreeing:.2%} of {pixels} px, "
                f"median |dz| = {dz:.2g} mm, largest shift of a view {shift:.2g} px"
            )
        return f"dataset of {self.count} views: complete and consistent ({checked})"


def check_dataset(
    root: Path, *, views: int = DEFAULT_VIEWS, hashes: bool = True, stream: TextIO | None = None
) -> CheckReport:
    """Check a dataset.

    Parameters
    ----------
    root
        The dataset's folder.
    views
        Compare the pixels of this many views, evenly spaced; 0 for all.
    hashes
        Compare the hashes of all files.
    stream
        Stream for the progress.

    Raises
    ------
    InputError
        Not a dataset at all.
    """
    if not (root / RECORD).is_file() and not (root / SPLIT).is_dir():
        raise InputError(
            f"{root}: expected the folder of a dataset, found no {RECORD} in it; give the folder that --out named"
        )
    findings = Findings()
    try:
        identity = read_identity(root)
    except DamagedFile as damage:
        findings.add("damaged files", damage)
        return CheckReport(0, findings, 0, ())
    missing = _check_files(root, identity, findings)
    surface = _read_model(root, missing, findings)
    chosen = _evenly_spaced(identity.count, views)
    records: dict[int, ViewRecord] = {}
    hashed, compared = 0, []
    progress = Progress(identity.count, "views checked", stream=stream)
    for first in range(0, identity.count, VIEWS_PER_SCENE):
        scene = range(first, min(first + VIEWS_PER_SCENE, identity.count))
        for index in scene:
            paths = ViewPaths(root, index)
            record = _read_record(paths, identity, missing, findings)
            if record is not None:
                records[index] = record
                intact = missing.isdisjoint(record.sha256)
                if hashes:
                    wrong = _check_hashes(root, record, missing, findings)
                    intact &= not wrong
                    hashed += len(record.sha256)
                if intact and index in chosen:
                    compared.append(check_view(paths, record, identity, surface, findings))
            progress.advance()
        scene_records = {index: records[index] for index in scene if index in records}
        check_scene_tables(root, scene, scene_records, identity, missing, findings)
    progress.close()
    _check_whole(root, identity, records, missing, findings)
    return CheckReport(identity.count, findings, hashed, tuple(view for view in compared if view is not None))


def _evenly_spaced(count: int, views: int) -> set[int]:
    """Numbers of ``views`` evenly spaced ones of ``count`` views; all if ``views`` is 0 or too large."""
    if not views or views >= count:
        return set(range(count))
    return set(np.linspace(0, count - 1, views).round().astype(int).tolist())


def _check_files(root: Path, identity: Identity, findings: Findings) -> set[str]:
    """Compare the files in the folder with those expected; return the missing ones, relative to the folder."""
    present, views, tables = set(_files(root)), set(), set(_tables_beside_scenes(root))
    for index in range(identity.count):
        paths = ViewPaths(root, index)
        views |= {paths.relative(kind) for kind in (*identity.kinds, "frame")}
        if paths.image_id == 0:
            tables |= {f"{paths.scene.relative_to(root).as_posix()}/{name}" for name in SCENE_TABLES}
    missing = (views | tables) - present
    unfinished = (root / WORK).exists()
    if unfinished:
        done = identity.count - sum("/frame/" in name for name in missing)
        findings.add(
            "unfinished parts",
            f"{WORK}: a run is still going on or was stopped: the dataset is unfinished ({done} of "
            f"{identity.count} views exist): {AGAIN}",
        )
    else:
        for name in sorted(missing):
            findings.add("missing files", f"{name}: expected a file, found none")
    for name in sorted(present - views - tables):
        if "/.partial-" in f"/{name}":
            if not unfinished:
                findings.add("stray files", f"{name}: left by a run that was stopped: remove it")
        elif name.startswith(f"{SPLIT}/") and Path(name).name not in DESKTOP_FILES:
            findings.add("stray files", f"{name}: expected no such file in a dataset of {identity.count} views")
    return missing


def _tables_beside_scenes(root: Path) -> Iterator[str]:
    yield from (CHECKSUMS, "camera.json", "poses.csv", "transforms.json", "contact_sheet.png", "overlay.png")
    yield from (MODEL, MODELS_INFO)
    if (root / "video").is_dir():
        yield from (VIDEO, VIDEO_POSES)


def _files(root: Path) -> Iterator[str]:
    """Every file below a folder, relative to it, with forward slashes; without the work files of a run."""
    for folder, folders, names in os.walk(root):
        relative = Path(folder).relative_to(root)
        if relative == Path():
            folders[:] = [name for name in folders if name != WORK]
        prefix = "" if relative == Path() else relative.as_posix() + "/"
        yield from (prefix + name for name in names)


def _read_record(paths: ViewPaths, identity: Identity, missing: set[str], findings: Findings) -> ViewRecord | None:
    if paths.relative("frame") in missing:
        return None
    try:
        return read_view_record(paths, identity.kinds)
    except DamagedFile as damage:
        findings.add("damaged files", damage)
        return None


def _check_hashes(root: Path, record: ViewRecord, missing: set[str], findings: Findings) -> int:
    """Compare the hashes of a view's files; return how many differ."""
    wrong = 0
    for name, expected in record.sha256.items():
        if name in missing:
            continue
        try:
            with (root / name).open("rb") as stream:
                same = hashlib.file_digest(stream, "sha256").hexdigest() == expected
            problem = f"its sha256 is not the one in {record.where}: the file was changed or damaged"
        except OSError as error:
            same, problem = False, f"cannot read the file ({error.strerror})"
        if not same:
            wrong += 1
            findings.add("damaged files", f"{name}: {problem}")
    return wrong


def _read_model(root: Path, missing: set[str], findings: Findings) -> SilhouetteEdges | None:
    """Read the model and compare it with ``models_info.json``; ``None`` if it cannot be read."""
    if MODEL in missing:
        return None
    try:
        mesh, messages = read_mesh(root / MODEL)
    except InputError as error:
        findings.add("damaged files", f"{MODEL}: {error}")
        return None
    for message in messages:
        findings.add("damaged files", f"{MODEL}: {message}")
    # coordinates are stored in single precision
    rounding = 2e-6 * mesh.radius
    off = float(np.abs(mesh.vertices.mean(axis=0)).max())
    if off > rounding:
        findings.add(
            "damaged files", f"{MODEL}: expected the mean of the vertices at the origin, it is {off:.2g} mm off"
        )
    if MODELS_INFO in missing:
        return SilhouetteEdges.of(mesh)
    low, high = mesh.bounds
    expected = {"diameter": diameter(mesh.vertices)}
    expected |= {f"min_{axis}": value for axis, value in zip("xyz", low, strict=True)}
    expected |= {f"size_{axis}": value for axis, value in zip("xyz", high - low, strict=True)}
    try:
        content = read_object(root / MODELS_INFO, MODELS_INFO)
        info = mapping(content, str(OBJECT_ID), MODELS_INFO)
        for name, value in expected.items():
            if abs(numbers(info, name, (), MODELS_INFO) - value) > rounding:
                raise DamagedFile(f"{MODELS_INFO}: {name} is {info[name]}, {MODEL} has {value:.9g}")
    except DamagedFile as damage:
        findings.add("tables that disagree", damage)
    return SilhouetteEdges.of(mesh)


def _check_whole(
    root: Path, identity: Identity, records: dict[int, ViewRecord], missing: set[str], findings: Findings
) -> None:
    """Check the files outside the scenes."""
    if "camera.json" not in missing:
        finest = min((record.depth_scale for record in records.values()), default=np.inf)
        check_camera_file(root, identity.camera, finest, findings)
    if "poses.csv" not in missing:
        check_pose_table(root, records, identity, findings)
    if "transforms.json" not in missing:
        check_nerf_file(root, records, identity, findings)
    for picture in {"contact_sheet.png", "overlay.png"} - missing:
        try:
            check_image_file(root / picture, picture)
        except InputError as error:
            findings.add("damaged files", error)
    if (root / "video").is_dir() and not {VIDEO, VIDEO_POSES} & missing:
        _check_video(root, identity, check_video_poses(root, findings), findings)


def _check_video(root: Path, identity: Identity, frames: int, findings: Findings) -> None:
    video = cv2.VideoCapture(str(root / VIDEO))
    found = tuple(
        round(video.get(what))
        for what in (cv2.CAP_PROP_FRAME_COUNT, cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
    )
    video.release()
    # H.264 has even sides
    width, height = (side + side % 2 for side in identity.camera.size_wh)
    if frames and found != (frames, width, height):
        findings.add(
            "damaged files",
            f"{VIDEO}: expected {frames} frames, as {VIDEO_POSES} has, of {width}x{height} px, found {found[0]} of "
            f"{found[1]}x{found[2]}",
        )
