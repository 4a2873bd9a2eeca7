"""Check whether a dataset is complete and consistent: files, hashes, tables, images, and poses against pixels.

The check does not read the files with the code that wrote them: it decodes images with OpenCV, converts the poses and
intrinsics of every table itself, and computes depths by projecting the model (:mod:`oneframe.dataset.check.depth`).
It goes through the scenes one by one and keeps little of a view, so its memory does not grow with the masks. Needs cv2
and OpenCV's video reader.
"""

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TextIO

import numpy as np

from ...case.case_file import Case
from ...errors import InputError
from ...progress import Progress
from ...projection.silhouette import SilhouetteEdges
from ..layout import RECORD, SPLIT, WORK, ViewPaths, scene_count, scene_folder, scene_views
from ..view_ranges import ranges_text, runs
from .checksums import Checksums, check_sums, poses_hash, read_checksums
from .contents import (
    CHECKSUMS,
    VIDEO,
    VIDEO_POSES,
    Contents,
    SceneContents,
    list_dataset,
    list_scene,
)
from .depth import DepthAgreement
from .files import DamagedFile
from .findings import Findings
from .images import check_view
from .inputs import check_inputs
from .model import check_model
from .pictures import OVERLAY, SHEET, check_contact_sheet, check_overlay, check_video
from .pose_tables import (
    ViewPose,
    check_camera_file,
    check_nerf_file,
    check_pose_table,
    check_targets,
    read_video_poses,
)
from .records import Description, ViewRecord, read_description, read_view_record
from .rerendered import Rerendering, check_rerendered
from .scene_tables import check_scene_tables

DEFAULT_VIEWS = 200
AGAIN = "run the same `oneframe render` again"


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
    rerendered
        Number of views that were rendered again; 0 also if something else was wrong before.
    """

    count: int
    findings: Findings
    hashed: int
    compared: tuple[DepthAgreement, ...]
    rerendered: int = 0

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
        if self.rerendered:
            checked += f"; {self.rerendered} views rendered again from the case are the same"
        return f"dataset of {self.count} views: complete and consistent ({checked})"


def check_dataset(
    root: Path,
    *,
    views: int = DEFAULT_VIEWS,
    hashes: bool = True,
    case: Case | None = None,
    poses: Path | None = None,
    rerendering: Rerendering | None = None,
    stream: TextIO | None = None,
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
    case
        The case that the dataset was rendered from, to compare its files.
    poses
        The file of the views' poses, if they were listed and the case does not name it.
    rerendering
        Renders views again, if nothing else is wrong.
    stream
        Stream for the progress.

    Raises
    ------
    InputError
        Not a dataset at all, or one of another format.
    """
    if not (root / RECORD).is_file() and not (root / SPLIT).is_dir():
        raise InputError(
            f"{root}: expected the folder of a dataset, found no {RECORD} in it; give the folder that --out named"
        )
    findings = Findings()
    try:
        description = read_description(root)
    except DamagedFile as damage:
        findings.add("damaged files", damage)
        return CheckReport(0, findings, 0, ())
    report = _Check(root, description, findings, views=views, hashes=hashes).run(stream)
    if case is not None:
        check_inputs(description, case, poses, findings)
    if rerendering is None or findings:
        return report
    chosen = sorted(_evenly_spaced(description.count, rerendering.views))
    with rerendering.open(description) as renderer:
        check_rerendered(root, description, renderer, chosen, findings, stream)
    return replace(report, rerendered=len(chosen))


class _Check:
    """One check of one dataset."""

    def __init__(self, root: Path, description: Description, findings: Findings, *, views: int, hashes: bool) -> None:
        self._root, self._description, self._findings, self._hashes = root, description, findings, hashes
        self._contents: Contents = list_dataset(root, description.count, findings)
        self._sums: Checksums = read_checksums(root, self._contents, description.identity, findings)
        self._mesh = check_model(root, self._contents.missing, description.content["geometry_sha256"], findings)
        self._surface = None if self._mesh is None else SilhouetteEdges.of(self._mesh)
        self._chosen = _evenly_spaced(description.count, views)
        self._poses: dict[int, ViewPose] = {}
        self._same_poses: dict[bytes, int] = {}
        self._same_images: dict[bytes, int] = {}
        self._hashed, self._images_intact = 0, True
        self._compared: list[DepthAgreement] = []

    def run(self, stream: TextIO | None) -> CheckReport:
        """Check scene by scene, then what belongs to all views."""
        contents, findings = self._contents, self._findings
        count, unfinished = self._description.count, contents.unfinished
        if unfinished:
            findings.add(
                "unfinished parts",
                f"{WORK}: a run is still going on or was stopped: the dataset is unfinished ({contents.recorded} of "
                f"{count} views exist): {AGAIN}",
            )
        absent: list[range] = []
        missing = set(contents.missing)
        present = set(contents.scenes)
        with Progress(contents.recorded, "views checked", stream=stream) as progress:
            for number in range(scene_count(count)):
                if number not in present:
                    absent.append(scene_views(number, count))
                    continue
                scene = list_scene(self._root, number, count, self._description.kinds, findings, unfinished=unfinished)
                self._check_scene(number, scene, progress)
                absent += runs(scene.absent)
                missing |= scene.missing
        if absent and not unfinished:
            lost = sum(map(len, absent))
            findings.add(
                "missing files",
                f"{RECORD}: expected {count} views, found {count - lost}: nothing exists of {ranges_text(absent)}",
            )
        self._check_beside(frozenset(missing))
        return CheckReport(count, findings, self._hashed, tuple(self._compared))

    def _check_scene(self, number: int, scene: SceneContents, progress: Progress) -> None:
        root, findings = self._root, self._findings
        records: dict[int, ViewRecord] = {}
        digest = hashlib.sha256()
        for index in scene.recorded:
            paths = ViewPaths(root, index)
            progress.advance()
            try:
                record = read_view_record(paths, self._description)
            except DamagedFile as damage:
                findings.add("damaged files", damage)
                continue
            records[index] = record
            digest.update(record.data)
            self._check_view(paths, record, scene)
            visible = record.gt_info["visib_fract"]
            self._poses[index] = ViewPose(record.cam_from_model, record.depth_scale, visible)
        folder = scene_folder(number)
        expected = self._sums.records.get(folder)
        if expected is not None and len(records) == len(scene.views) and digest.hexdigest() != expected:
            findings.add(
                "damaged files", f"{folder}/frame: the records do not have the sha256 in {CHECKSUMS}: one was changed"
            )
        check_scene_tables(root, scene, records, self._description, findings, skipped=self._sums.outdated)

    def _check_view(self, paths: ViewPaths, record: ViewRecord, scene: SceneContents) -> None:
        """Check that the view is of this dataset and no copy, its files' hashes and, if it is chosen, its pixels."""
        root, findings, index = self._root, self._findings, paths.index
        if self._description.poses_differ:
            first = self._same_poses.setdefault(record.pose_hash, index)
            if first != index:
                findings.add("duplicated views", f"{record.where}: view {index} has the very pose of view {first}")
            images = "".join(record.files[paths.relative(kind)].sha256 for kind in ("rgb", "depth"))
            first = self._same_images.setdefault(hashlib.blake2b(images.encode(), digest_size=16).digest(), index)
            if first != index and record.gt_info["px_count_visib"]:
                findings.add("duplicated views", f"{record.where}: view {index} has the very images of view {first}")
        if record.identity != self._description.identity:
            findings.add(
                "views of another run",
                f"{record.where}: its identity is not that of {RECORD}: the view is of another run, or {RECORD} was "
                "changed",
            )
        wrong = check_sums(root, record.files, scene.missing, record.where, findings, hashes=self._hashes)
        self._hashed += len(record.files) * self._hashes
        if not wrong and scene.missing.isdisjoint(record.files) and index in self._chosen:
            before = len(findings)
            compared = check_view(paths, record, self._description, self._surface, findings)
            if compared is not None:
                self._compared.append(compared)
            wrong = len(findings) - before
        self._images_intact &= not wrong

    def _check_beside(self, missing: frozenset[str]) -> None:
        """Check the files that are not a view's, and the tables of all views."""
        root, description, findings, poses = self._root, self._description, self._findings, self._poses
        missing |= {name for name in self._sums.files if name not in self._contents.tables} | self._sums.outdated
        absent = self._absent_scene_tables()
        check_sums(root, self._sums.files, missing | absent, CHECKSUMS, findings, hashes=self._hashes)
        self._hashed += len(self._sums.files.keys() - missing - absent) * self._hashes
        if description.poses_hash is not None and len(poses) == description.count:
            found = poses_hash(poses[index].cam_from_model for index in range(description.count))
            if found != description.poses_hash:
                findings.add(
                    "views of another run", f"{RECORD}: poses_sha256 is not that of the views' poses: one was changed"
                )
        depth_scale = None
        if "camera.json" not in missing:
            depth_scale = check_camera_file(root, description, poses, findings)
        if "poses.csv" not in missing:
            check_pose_table(root, poses, description, findings)
        if "transforms.json" not in missing:
            check_nerf_file(root, poses, description, self._mesh, depth_scale, findings)
        if "test_targets_bop19.json" not in missing:
            check_targets(root, poses, description, findings)
        if OVERLAY not in missing:
            check_overlay(root, description, findings)
        if SHEET not in missing and len(poses) == description.count and self._images_intact:
            check_contact_sheet(root, description, findings)
        if VIDEO in self._contents.tables and not {VIDEO, VIDEO_POSES} & missing:
            video_poses = read_video_poses(root, findings)
            if video_poses:
                check_video(root, description, video_poses, self._mesh, findings)

    def _absent_scene_tables(self) -> set[str]:
        """The tables of scenes that have no folder: the views' absence says it all."""
        present = {scene_folder(number) for number in self._contents.scenes}
        return {
            name for name in self._contents.tables if name.count("/") == 2 and name.rpartition("/")[0] not in present
        }


def _evenly_spaced(count: int, views: int) -> set[int] | range:
    """Numbers of ``views`` evenly spaced ones of ``count`` views; all if ``views`` is 0 or too large."""
    if not views or views >= count:
        return range(count)
    return set(np.linspace(0, count - 1, views).round().astype(int).tolist())
