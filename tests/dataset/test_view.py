"""Laws of a view's files: depth units, images, ground truth of the whole silhouette, and a record written last."""

import io
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.options import OPTIONS
from oneframe.dataset.run.resume_record import read_record
from oneframe.dataset.tables.bop import run_lengths
from oneframe.dataset.truths import TRUTHS, Shot, Stored, depth_scale_for, quantised_depth
from oneframe.dataset.view import RenderedSample, RenderedView, encode_view, file_sums
from oneframe.poses.constraints import PlannedPose, Rejections, ViewStatistics
from oneframe.projection.silhouette import SilhouetteEdges
from tests.dataset.blank_dataset import CAMERA, record_of, write_view
from tests.dataset.synthetic_dataset import CAMERA as WIDE
from tests.dataset.synthetic_dataset import COUNT, MESH, cast_rays, encoded, pose_of

sides = st.integers(1, 40)


@given(st.floats(1e-6, 1e9))
@example(65535.0)
@example(655.35)
@example(np.nextafter(655.35, np.inf))
@example(65535 * 5e-3)
def test_depth_scale_is_the_finest_of_1_2_5_that_holds_the_distance(farthest):
    candidates = [float(f"{digit}e{power}") for power in range(-13, 7) for digit in (1, 2, 5)]
    assert depth_scale_for(farthest) == min(scale for scale in candidates if farthest <= scale * 65535)


@given(
    hnp.arrays(np.float32, st.tuples(sides, sides), elements=st.floats(0, 1, width=32)),
    st.floats(1e-3, 1e5),
)
def test_quantised_depth_is_within_half_a_unit_and_never_0_on_the_surface(part, farthest):
    depth = (part * np.float32(farthest)).astype(np.float32)
    scale = depth_scale_for(float(max(depth.max(), farthest)))
    units = quantised_depth(depth, scale)
    assert units.dtype == np.uint16
    np.testing.assert_array_equal(units > 0, depth > 0)
    error = np.abs(units * scale - depth.astype(np.float64))
    # single precision: 65535 units times 2^-23
    allowed = np.where(units == 1, 1.0, 0.51) * scale
    assert (error <= allowed).all()


def test_a_view_is_its_files_and_then_its_record(tmp_path):
    depth = np.zeros(CAMERA.shape_hw, np.float32)
    depth[3:9, 4:15] = np.linspace(250, 300, 11, dtype=np.float32)
    rgb = np.full((*CAMERA.shape_hw, 3), [0.0, 0.5, 1.2], np.float32)
    source = np.where(depth > 270, np.uint8(2), np.uint8(0))
    files = encoded(rgb, depth, source, 0.01)
    decoded = {
        kind: cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        for kind, data in files.items()
        if kind != "depth_mm"
    }
    assert (decoded["rgb"] == [255, 128, 0]).all()
    np.testing.assert_array_equal(decoded["depth"], np.rint(depth / 0.01))
    for kind, expected in (("mask", depth > 0), ("mask_visib", depth > 0), ("mask_observed", depth > 270)):
        np.testing.assert_array_equal(decoded[kind], 255 * expected)
    np.testing.assert_array_equal(decoded["source_frame"], source)
    np.testing.assert_array_equal(np.load(io.BytesIO(files["depth_mm"])), depth)

    paths = ViewPaths(tmp_path, 1003)
    write_view(paths, files, record_of(1003))
    assert paths.relative("mask_observed") == "train_synt/000001/mask_observed/000003_000000.png"
    record = read_record(paths)
    assert record.index == 1003
    assert {tmp_path / name for name in record.files} == {paths.file(kind) for kind in files}
    written = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
    assert written == {*record.files, "train_synt/000001/frame/000003.json"}


@pytest.mark.parametrize(("index", "scale"), [(0, 1e-4), (COUNT - 1, 0.01)])
def test_an_encoded_view_tells_the_silhouette_also_outside_the_image(tmp_path, index, scale):
    pose, (height, width) = pose_of(index), WIDE.shape_hw
    wide = cast_rays(MESH, WIDE, pose, beyond=1)
    depth = wide[height : 2 * height, width : 2 * width].astype(np.float32)
    mask, observed = depth > 0, (depth > 0) & (np.arange(width) > 12)
    view = RenderedView(np.zeros((height, width, 3), np.float32), depth, observed.astype(np.uint8), np.zeros_like(mask))
    planned = PlannedPose(pose, ViewStatistics(1, 1, 1), 5, Rejections(surface=4))
    paths = ViewPaths(tmp_path, 1007)
    files, record = encode_view(
        paths,
        RenderedSample(planned, view),
        SilhouetteEdges.of(MESH),
        WIDE,
        identity="ab",
        depth_scale=scale,
        kinds=("rgb", "depth"),
    )
    rows = np.argwhere(wide > 0)
    (top, left), (bottom, right) = rows.min(axis=0), rows.max(axis=0)
    info = record.gt_info
    assert info.bbox_obj == pytest.approx((left - width, top - height, right - left, bottom - top), abs=1)
    assert info.px_count_all == pytest.approx(len(rows), abs=4)
    assert (info.px_count_valid, info.px_count_visib) == (mask.sum(), mask.sum())
    assert info.visib_fract == mask.sum() / info.px_count_all
    assert record.px_count_observed == observed.sum()
    assert record.rle_counts == run_lengths(mask)
    assert (record.index, record.attempts, record.rejections) == (1007, 5, Rejections(surface=4))
    # a depth image that cannot hold the farthest surface gets a coarser unit
    assert record.depth_scale == (scale if scale == 0.01 else depth_scale_for(float(depth.max())))
    units = cv2.imdecode(np.frombuffer(files["depth"], np.uint8), cv2.IMREAD_UNCHANGED)
    assert np.abs(units * record.depth_scale - depth).max() <= 0.51 * record.depth_scale
    assert record.files == file_sums(paths, files)


def test_the_docs_list_every_array_as_it_is_declared():
    docs = Path("docs/dataset-format.md").read_text(encoding="utf-8")
    for name, truth in TRUTHS.items():
        asked = "; with further frames" if truth.of_several else ""
        asked += f"; with {OPTIONS[truth.option].flag}" if truth.option else ""
        path = f"{name}/000000{truth.form.ending}"
        assert f"    {path:<34} {truth.form.about}: {truth.about}{asked}\n" in docs


def test_normals_are_those_that_the_inverse_depth_of_a_ray_cast_gives():
    """On a plane n . X = d the inverse depth is n . ray / d, affine in the pixel: its gradient gives n / d."""
    pose, camera = pose_of(1), WIDE.resized(160, 120)
    height, width = camera.shape_hw
    depth = cast_rays(MESH, camera, pose)
    view = RenderedView(np.zeros((height, width, 3)), depth.astype(np.float32), np.zeros(depth.shape), depth > 0)
    truth = TRUTHS["normals"]
    codes = truth.array(Shot(view, pose, MESH, camera, 0.01))
    stored = {"normals": codes, "mask": 255 * view.mask}
    assert not any(wrong.any() for wrong, _ in truth.flaws(Stored(stored, 0.01, 1, camera, pose)))
    assert cv2.imdecode(np.frombuffer(truth.form.encoded(codes), np.uint8), -1)[..., ::-1].tolist() == codes.tolist()
    with np.errstate(divide="ignore"):
        w = np.where(view.mask, 1 / depth, np.nan)
    step_v, step_u = np.gradient(w)
    flat = np.zeros(w.shape, bool)
    flat[1:-1, 1:-1] = (np.abs(np.diff(w, 2, axis=1))[1:-1] < 1e-9) & (np.abs(np.diff(w, 2, axis=0))[:, 1:-1] < 1e-9)
    v, u = np.mgrid[:height, :width]
    expected = np.stack(
        [camera.fx * step_u, camera.fy * step_v, w - (u - camera.cx) * step_u - (v - camera.cy) * step_v], axis=-1
    )[flat]
    expected *= -1 / np.linalg.norm(expected, axis=1, keepdims=True)
    assert flat.sum() > 100
    assert np.abs(codes[flat] / 32767.5 - 1 - expected).max() < 1e-3


@pytest.mark.parametrize(
    ("harm", "clause"),
    [
        (lambda points, pose: points + pose[2, :3] * 0.02, "at the depth of"),
        (lambda points, pose: points + pose[0, :3] * 1e-3, "on the rays"),
        (lambda points, pose: np.where(np.isnan(points), 0, points), "mask"),
        (lambda points, pose: np.where(points > 20, np.nan, points), "mask"),
    ],
)  # fmt: skip
def test_points_are_held_against_depth(harm, clause):
    pose = pose_of(1)
    depth = cast_rays(MESH, WIDE, pose).astype(np.float32)
    view = RenderedView(np.zeros((*depth.shape, 3)), depth, np.zeros(depth.shape), depth > 0)
    shot, truth = Shot(view, pose, MESH, WIDE, 0.01), TRUTHS["points"]
    points = np.load(io.BytesIO(truth.form.encoded(truth.array(shot))))
    arrays = {"mask": 255 * view.mask, "depth": TRUTHS["depth"].array(shot)}

    def flaws(points):
        stored = Stored(arrays | {"points": points}, 0.01, 1, WIDE, pose)
        return [clause for wrong, clause in truth.flaws(stored) if wrong.any()]

    assert flaws(points) == []
    assert any(clause in found for found in flaws(harm(points, pose)))
