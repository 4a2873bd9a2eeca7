"""Datasets with instruments in front of the surface: exact masks, by any engine, and never through the surface."""

import dataclasses
import io
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.blender.dataset import run as dataset_run
from oneframe.blender.dataset.job import Job
from oneframe.blender.render.surface_tree import ViewProbe, surface_tree
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import read_case
from oneframe.dataset.check.check_dataset import CheckReport, check_dataset
from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.run.run_folder import Shard
from oneframe.images.png import encode_png
from oneframe.occlusion.occluders import draw_occluders, places_doubt
from oneframe.reader import open_dataset
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import rigid
from tests.conftest import OFFSET, tiny_surface
from tests.dataset.sealing import sealed

pytestmark = pytest.mark.render

VIEWS = 6
OPTIONS = DatasetOptions(
    count=VIEWS,
    seed=5,
    engine="raster",
    occluders=2.0,
    surroundings="frame",
    float_depth=True,
    points=True,
    normals=True,
)
CAMERA = PinholeCamera(640, 480, fx=3200.0, fy=3180.0, cx=304.5, cy=259.5)
POSE = rigid(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 300.0])


def render(case: Path, out: Path, options: DatasetOptions = OPTIONS, shard: Shard | None = None) -> Path:
    job = Job(read_case(case), out, options, shard or Shard())
    dataset_run.run(job, workers=1, worker_command=(), stream=io.StringIO())
    return out


def checked(root: Path, case: Path) -> CheckReport:
    """The report of the check, against the case."""
    return check_dataset(root, case=read_case(case), stream=io.StringIO())


@pytest.fixture(scope="module")
def case(tmp_path_factory, write_tiny_case) -> Path:
    return write_tiny_case(tmp_path_factory.mktemp("occluded case"))


@pytest.fixture(scope="module")
def occluded(case, tmp_path_factory) -> Path:
    return render(case, tmp_path_factory.mktemp("occluded") / "dataset")


def test_instruments_change_what_is_seen_and_nothing_else(case, occluded, tmp_path):
    plain = open_dataset(render(case, tmp_path / "plain", dataclasses.replace(OPTIONS, occluders=0.0)))
    assert not plain[0].mask_occluder.any()
    covered = 0
    for view, without in zip(open_dataset(occluded), plain, strict=True):
        front = view.mask_occluder
        covered += front.any()
        assert (view.mask_whole == without.mask_whole).all()
        assert (view.mask_visib == (without.mask & ~front)).all()
        assert (view.observed == (without.observed & ~front)).all()
        assert (view.mask_surround == (without.mask_surround & ~front)).all()
        assert not (without.mask_surround & without.mask).any()
        for name in ("rgb", "depth_mm", "points_model", "normals"):
            one, other = getattr(view, name)[~front], getattr(without, name)[~front]
            np.testing.assert_array_equal(one, other)
        assert (view.depth_mm[front & view.mask_whole] < without.depth_mm[front & view.mask_whole]).all()
        assert np.isnan(view.points_model[front]).all()
        assert not view.normals[front].any()
        whole = without.boxes.bbox_obj
        assert view.boxes.bbox_obj == whole
        assert view.visib_fract == pytest.approx(without.visib_fract * view.mask.sum() / without.mask.sum())
    assert covered >= VIEWS / 2


def test_surroundings_change_what_was_black_and_nothing_else(case, occluded, tmp_path):
    black = open_dataset(render(case, tmp_path / "black", dataclasses.replace(OPTIONS, surroundings="none")))
    for view, without in zip(open_dataset(occluded), black, strict=True):
        around = view.mask_surround
        assert around.any()
        assert not without.mask_surround.any()
        assert not without.rgb[around].any()
        assert view.rgb[around].any(axis=1).all()
        np.testing.assert_array_equal(view.rgb[~around], without.rgb[~around])
        for name in ("mask_whole", "mask_visib", "mask_occluder", "observed", "depth_mm", "points_model", "normals"):
            np.testing.assert_array_equal(getattr(view, name), getattr(without, name))
        assert (view.boxes, view.visib_fract) == (without.boxes, without.visib_fract)


def test_cycles_proves_the_masks_and_the_check_finds_damage(case, occluded, tmp_path):
    report = checked(occluded, case)
    assert not report.findings, report.findings.shown()
    by_cycles = open_dataset(render(case, tmp_path / "cycles", dataclasses.replace(OPTIONS, count=2, engine="cycles")))
    for view, proof in zip(open_dataset(occluded), by_cycles, strict=False):
        for name in ("mask_whole", "mask_visib", "mask_occluder", "mask_surround"):
            np.testing.assert_array_equal(getattr(view, name), getattr(proof, name))
    index = next(view.index for view in open_dataset(occluded) if view.mask_occluder.any())
    paths = ViewPaths(occluded, index)
    for kind, change in (
        ("mask_occluder", lambda image: 0 * image),
        ("mask_surround", lambda image: 255 - image),
        ("mask_visib", lambda image: cv2.erode(image, np.ones((3, 3)))),
        ("depth", lambda image: np.where(image > 0, image + 3000, 0).astype(np.uint16)),
    ):
        before = paths.file(kind).read_bytes()
        image = cv2.imread(str(paths.file(kind)), cv2.IMREAD_UNCHANGED)
        try:
            paths.file(kind).write_bytes(encode_png(change(image)))
            sealed(occluded)
            assert checked(occluded, case).findings
        finally:
            paths.file(kind).write_bytes(before)
            sealed(occluded)


def test_no_instrument_goes_through_the_surface():
    """No side of a face of the one leads through the other."""
    surface = tiny_surface().moved(-OFFSET)
    probe = ViewProbe(surface, CAMERA, lambda points, normals: np.ones(len(points), bool))
    drawn = [draw_occluders(3.0, (seed, 0), probe, CAMERA, POSE) for seed in range(12)]
    meshes = [each.mesh for each in drawn if each is not None]
    assert len(meshes) > 8
    for mesh in meshes:
        assert not pierced(mesh, surface)
        assert not pierced(surface, mesh)
        assert pierced(mesh.moved(np.array([0, 0, -12.0])), surface)


@pytest.mark.parametrize(("distance_mm", "focal_px"), [(300.0, 3200.0), (34.0, 880.0)])
def test_instruments_that_find_no_place_are_told_of(distance_mm, focal_px):
    surface, camera = tiny_surface().moved(-OFFSET), dataclasses.replace(CAMERA, fx=focal_px, fy=focal_px)
    probe = ViewProbe(surface, camera, lambda points, normals: np.ones(len(points), bool))
    poses = [rigid(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, distance_mm])] * 4
    said = places_doubt(2.0, 3, probe, camera, poses)
    assert ("instruments find no place" in said) == (distance_mm < 100)


def pierced(edges_of: TriangleMesh, at: TriangleMesh) -> bool:
    start = edges_of.vertices[edges_of.faces].reshape(-1, 3)
    end = edges_of.vertices[edges_of.faces[:, [1, 2, 0]]].reshape(-1, 3)
    tree, length = surface_tree(at), np.linalg.norm(end - start, axis=1)
    return any(tree.ray_cast(*edge, far)[0] is not None for *edge, far in zip(start, end - start, length, strict=True))
