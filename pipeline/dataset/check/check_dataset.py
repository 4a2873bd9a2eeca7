"""Check whether a dataset is complete and consistent: files, hashes, tables, images, and poses against pixels.

Images are decoded with OpenCV, and depths computed by projecting the model (:mod:`oneframe.dataset.check.depth`), apart
from the code that wrote them; tables are made again from the records. The check goes through the views one by one and
keeps little of each, so its memory does not grow with the masks. Needs cv2.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from ...case.case_file import Case
from ...errors import InputError
from ...progress import Progress
from ...projection.silhouette import SilhouetteEdges
from ...surface.mesh import TriangleMesh, diameter
from ..checksums import damaged_file
from ..dataset_file import Description, read_description
from ..identity import geometry_hash, poses_hash
from ..layout import (
    CASES,
    MODEL_FILES,
    OBJECT_ID,
    RECORD,
    SPLIT,
    WORK,
    ViewPaths,
    check_is_dataset,
    evenly_spaced,
)
from ..model_file import read_model
from ..run.resume_record import ViewRecord, read_record
from ..run.survey import unrecorded_views, view_ranges
from .comparison import read_table, require_equal, require_pose, require_rotation
from .contents import check_names, check_sums
from .depth import DepthAgreement
from .findings import Findings
from .images import check_images, check_pose
from .inputs import check_inputs
from .tables import check_tables

DEFAULT_VIEWS = 200
FOREIGN = "views of another run"
AGAIN = "run the same `oneframe render` again"

MODEL, MODELS_INFO, _, REDUCED_INFO = MODEL_FILES


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
            checked += (
                f"; the reprojected surface agrees with the depth images at {agreeing:.2%} of {pixels} px, "
                f"median |dz| = {dz:.2g} mm"
            )
        return f"dataset of {self.count} views: complete and consistent ({checked})"


def check_dataset(
    root: Path | str,
    *,
    views: int = DEFAULT_VIEWS,
    hashes: bool = True,
    case: Case | None = None,
    poses: Path | None = None,
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
    stream
        Stream for the progress.
    """
    root = Path(root)
    has_views = (root / SPLIT).is_dir() and not (root.parent / CASES).is_dir()
    check_is_dataset(root, has_views=has_views)
    findings = Findings(root)
    try:
        description = read_description(root / RECORD)
    except InputError as damage:
        if not has_views:
            raise
        findings.add("damaged files", damage)
        return CheckReport(0, findings, 0, ())
    report = _Check(root, description, findings, views=views, hashes=hashes).run(stream)
    if case is not None:
        check_inputs(description, case, poses, findings)
    return report


class _Check:
    """One check of one dataset."""

    def __init__(self, root: Path, description: Description, findings: Findings, *, views: int, hashes: bool) -> None:
        self._root, self._description, self._findings, self._hashes = root, description, findings, hashes
        self._chosen = set(evenly_spaced(description.count, views))
        self._poses: dict[int, np.ndarray] = {}
        self._finest_scale = np.inf
        self._compared: list[DepthAgreement] = []

    def run(self, stream: TextIO | None) -> CheckReport:
        """Check view by view, then what belongs to all of them."""
        root, description, findings = self._root, self._description, self._findings
        count, unfinished = description.count, (root / WORK).exists()
        missing = unrecorded_views(root, count)
        if unfinished:
            findings.add(
                "unfinished parts",
                f"{WORK}: a run is still going on or was stopped: the dataset is unfinished ({count - len(missing)} of "
                f"{count} views exist): {AGAIN}",
            )
        elif missing:
            findings.add(
                "missing files",
                f"{RECORD}: expected {count} views, found {count - len(missing)} with a record: {view_ranges(missing)} "
                f"are missing, the first is {ViewPaths(root, missing[0]).relative('frame')}: {AGAIN}",
            )
        check_names(root, description, findings, unfinished=unfinished)
        hashed = 0 if unfinished else check_sums(root, description, findings, hashes=self._hashes)
        mesh = None if unfinished and not (root / "models").exists() else check_model(root, description, findings)
        surface = None if mesh is None else SilhouetteEdges.of(mesh)
        with findings.collecting("tables that disagree"):
            camera = description.camera
            numbers = {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
            require_equal(description.content["camera"], numbers | {"K": camera.k.tolist()}, f"{RECORD}: camera")
        absent = set(missing)
        with Progress(count - len(missing), "views checked", stream=stream) as progress:
            for index in range(count):
                if index not in absent:
                    self._check_record(index, surface)
                    progress.advance()
        if len(self._poses) == count and not unfinished:
            self._check_poses()
            self._check_further()
            if mesh is not None and FOREIGN not in findings.counts:
                check_tables(root, description, self._finest_scale, findings)
        hashed += len(self._poses) * len(description.kinds) * self._hashes
        return CheckReport(count, findings, hashed, tuple(self._compared))

    def _check_record(self, index: int, surface: SilhouetteEdges | None) -> None:
        """Check a view that has a record."""
        paths = ViewPaths(self._root, index)
        with self._findings.collecting("damaged files"):
            record = read_record(paths)
            require_rotation(record.cam_from_model, paths.relative("frame"))
            self._poses[index] = record.cam_from_model
            self._finest_scale = min(self._finest_scale, record.depth_scale)
            self._check_view(paths, record, surface)

    def _check_view(self, paths: ViewPaths, record: ViewRecord, surface: SilhouetteEdges | None) -> None:
        """Check that the view is of this dataset, the sums of its files and, if it is chosen, its pixels."""
        root, description, findings = self._root, self._description, self._findings
        where = paths.relative("frame")
        if record.identity != description.identity:
            findings.add(
                FOREIGN,
                f"{where}: its identity is not that of {RECORD}: the view is of another run, or {RECORD} was changed",
            )
        if record.files.keys() != {paths.relative(kind) for kind in description.kinds}:
            raise InputError(f"{where}: expected sums of the view's {len(description.kinds)} files, found others")
        problems = [damaged_file(root, name, known, hashes=self._hashes) for name, known in record.files.items()]
        for problem in filter(None, problems):
            findings.add("damaged files", f"{problem}, as {where} tells")
        if any(problems) or paths.index not in self._chosen:
            return
        with findings.collecting("images that disagree"):
            stored = check_images(paths, record, description)
            if surface is not None:
                with findings.collecting("views whose pose does not fit the pixels"):
                    self._compared.append(check_pose(paths, record, stored, surface))

    def _check_poses(self) -> None:
        """Compare listed poses with their hash."""
        expected = self._description.poses_hash
        if expected is None:
            return
        poses = np.stack([self._poses[index] for index in range(self._description.count)])
        if poses_hash(poses) != expected:
            self._findings.add(FOREIGN, f"{RECORD}: poses_sha256 is not that of the views' poses: one was changed")

    def _check_further(self) -> None:
        """Compare the datasets in the folder with this one: the same views by cameras beside these."""
        for folder in self._description.further:
            with self._findings.collecting(f"{folder} eyes that are missing or of other views"):
                beside = self._description.read_further(self._root, folder).camera_from_planned
                for index, pose in self._poses.items():
                    paths = ViewPaths(self._root / folder, index)
                    found, where = read_record(paths).cam_from_model, f"{folder}/{paths.relative('frame')}"
                    require_pose(found, pose if beside is None else beside @ pose, where, "the left eye, beside it")


def check_model(root: Path, description: Description, findings: Findings) -> TriangleMesh | None:
    """Check the models and what is said of them; the mesh, or ``None`` if it cannot be read."""
    mesh = None
    with findings.collecting("damaged files"):
        mesh = read_model(root, MODEL)
        # a surface whose back the frame sees is written with its faces turned
        hashes = {geometry_hash(side) for side in (mesh, mesh.flipped())}
        if description.content.get("geometry_sha256") not in hashes:
            raise InputError(f"{MODEL}: its vertices and faces do not have the geometry_sha256 of dataset.json")
        off = float(np.abs(mesh.vertices.mean(axis=0)).max())
        if off > 2e-6 * mesh.radius:
            raise InputError(f"{MODEL}: expected the mean of the vertices at the origin, it is {off:.2g} mm off")
    if mesh is None:
        return None
    for name in (MODELS_INFO, REDUCED_INFO):
        with findings.collecting("tables that disagree"):
            # of the model whose coordinates were rounded
            relative = 2e-6 * max(mesh.radius, 1.0)
            require_equal(read_table(root, name), {str(OBJECT_ID): _info(mesh)}, name, relative=relative)
    return mesh


def _info(mesh: TriangleMesh) -> dict[str, object]:
    low, high = mesh.bounds
    expected: dict[str, object] = {"diameter": diameter(mesh.vertices), "box_centre_mm": ((low + high) / 2).tolist()}
    for name, values in (("min", low), ("size", high - low)):
        expected |= {f"{name}_{axis}": float(value) for axis, value in zip("xyz", values, strict=True)}
    return expected
