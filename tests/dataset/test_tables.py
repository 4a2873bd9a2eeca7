"""Laws of a dataset's files: images, run lengths, boxes, depth units, and tables that all tell the same poses."""

import csv
import io
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pipeline.camera.pinhole import PinholeCamera
from pipeline.dataset import layout as dataset
from pipeline.dataset.folder import Shard
from pipeline.dataset.layout import ViewPaths, finished_views
from pipeline.dataset.tables import record_pose, write_camera, write_models, write_poses, write_scene
from pipeline.dataset.view import depth_scale_for, mask_statistics, quantised_depth, read_record, view_files, write_view
from pipeline.errors import InputError
from pipeline.images.image_check import check_image_file
from pipeline.images.png import encode_png
from pipeline.surface.mesh import TriangleMesh
from pipeline.surface.mesh_reader import read_mesh
from pipeline.transforms import rigid, rotation_from_vector

CAMERA = PinholeCamera(width=20, height=14, fx=31.7, fy=29.3, cx=8.2, cy=7.9)
CENTRE = np.array([11.0, -7.0, 420.0])
POINTS = np.array([[1.0, 2.0, -3.0], [-4.0, 0.5, 2.0], [0.0, 0.0, 0.0]])

sides = st.integers(1, 40)
masks = hnp.arrays(bool, st.tuples(sides, sides)) | st.builds(
    lambda seed, shape, share: np.random.default_rng(seed).random(shape) < share,
    st.integers(0, 2**32 - 1), st.tuples(sides, sides), st.sampled_from([0.0, 0.01, 0.5, 0.99, 1.0]),
)  # fmt: skip


def noise(seed: int, shape: tuple[int, ...], dtype: type) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)


images = st.one_of(
    hnp.arrays(np.uint8, st.tuples(sides, sides)),
    hnp.arrays(np.uint16, st.tuples(sides, sides)),
    hnp.arrays(np.uint8, st.tuples(sides, sides, st.just(3))),
    st.builds(noise, st.integers(0, 2**32 - 1), st.tuples(sides, sides), st.sampled_from([np.uint8, np.uint16])),
    st.builds(noise, st.integers(0, 2**32 - 1), st.tuples(sides, sides, st.just(3)), st.just(np.uint8)),
)


@settings(deadline=None)
@given(images, st.booleans(), st.booleans())
def test_png_files_hold_what_another_decoder_reads(image, mirrored, transposed):
    if mirrored:
        image = image[:, ::-1]
    if transposed:
        image = image.swapaxes(0, 1)
    decoded = cv2.imdecode(np.frombuffer(encode_png(image), np.uint8), cv2.IMREAD_UNCHANGED)
    assert decoded.dtype == image.dtype
    np.testing.assert_array_equal(decoded[..., ::-1] if image.ndim == 3 else decoded, image)


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scratch") / "image.png"


@settings(deadline=None)
@given(images, st.data())
def test_a_png_file_with_any_byte_changed_or_lost_is_refused(scratch, image, data):
    whole = encode_png(image)
    scratch.write_bytes(whole)
    check_image_file(scratch, "image")
    place = data.draw(st.integers(0, len(whole) - 1))
    changed = bytearray(whole)
    changed[place] ^= data.draw(st.integers(1, 255))
    for damaged in (changed, whole[:place]):
        scratch.write_bytes(damaged)
        with pytest.raises(InputError, match=r"^image: expected"):
            check_image_file(scratch, "image")


@settings(deadline=None)
@given(masks)
def test_mask_statistics_are_those_counted_pixel_by_pixel(mask):
    found = mask_statistics(mask)
    pixels = [(int(x), int(y)) for y, x in np.argwhere(mask)]
    assert found["px_count_visib"] == len(pixels)
    if pixels:
        left, top = (min(pixel[axis] for pixel in pixels) for axis in (0, 1))
        right, bottom = (max(pixel[axis] for pixel in pixels) for axis in (0, 1))
        assert found["bbox_visib"] == [left, top, right - left, bottom - top]
    else:
        assert found["bbox_visib"] == [-1, -1, -1, -1]
    # COCO's uncompressed run lengths: down the columns, zeros first, then ones and zeros in turn
    column_major, value = [], 0
    for length in found["rle_counts"]:
        column_major += [value] * length
        value = 1 - value
    height, width = mask.shape
    assert len(column_major) == mask.size
    assert all(mask[y, x] == column_major[x * height + y] for y in range(height) for x in range(width))
    # only the first run may be empty: otherwise it would not be the one shortest code
    assert all(length > 0 for length in found["rle_counts"][1:])
    assert json.loads(json.dumps(found)) == found


@given(st.floats(1e-6, 1e9))
@example(65535.0)
@example(655.35)
@example(np.nextafter(655.35, np.inf))
@example(65535 * 5e-3)
def test_depth_scale_is_the_finest_of_1_2_5_that_holds_the_distance(farthest):
    candidates = [float(f"{digit}e{power}") for power in range(-13, 7) for digit in (1, 2, 5)]
    assert depth_scale_for(farthest) == min(scale for scale in candidates if farthest <= scale * 65535)


@pytest.mark.parametrize("distance", [0.0, -1.0, np.nan, np.inf])
def test_depth_scale_of_no_distance(distance):
    with pytest.raises(InputError, match="expected a positive distance"):
        depth_scale_for(distance)


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


def test_view_files_and_record(tmp_path):
    depth = np.zeros(CAMERA.shape_hw, np.float32)
    depth[3:9, 4:15] = np.linspace(250, 300, 11, dtype=np.float32)
    rgb = np.full((*CAMERA.shape_hw, 3), [0.0, 0.5, 1.2], np.float32)
    files = view_files(rgb, depth, depth > 270, depth_scale=0.01, float_depth=True)
    decoded = {
        kind: cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        for kind, data in files.items()
        if kind != "depth_mm"
    }
    assert (decoded["rgb"] == [255, 128, 0]).all()
    np.testing.assert_array_equal(decoded["depth"], np.rint(depth / 0.01))
    for kind, expected in (("mask", depth > 0), ("mask_visib", depth > 0), ("mask_observed", depth > 270)):
        np.testing.assert_array_equal(decoded[kind], 255 * expected)
    np.testing.assert_array_equal(np.load(io.BytesIO(files["depth_mm"])), depth)

    paths = ViewPaths(tmp_path, 1003)
    write_view(paths, files, {"depth_scale": 0.01})
    assert paths.relative("mask_observed") == "train_pbr/000001/mask_observed/000003_000000.png"
    record = read_record(paths)
    assert record["index"] == 1003
    assert {tmp_path / name for name in record["sha256"]} == {paths.file(kind) for kind in files}
    assert finished_views(tmp_path, range(1010)) == {1003}
    written = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
    assert written == {*record["sha256"], "train_pbr/000001/frame/000003.json"}


@given(st.integers(1, 5000), st.integers(1, 12), st.sampled_from([10, 1000]))
def test_shards_share_all_views_out(total, parts, scene):
    shards = [Shard(part, parts).frames(total, scene) for part in range(parts)]
    assert [index for shard in shards for index in shard] == list(range(total))
    if total >= scene * parts:
        assert all(shard.start % scene == 0 for shard in shards)


def pose_of(index: int) -> np.ndarray:
    return rigid(rotation_from_vector(np.array([0.3 * index, -0.7, 0.2 * index + 1.5])), [1.0, -0.5, 60.0 + index])


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five views in two scenes with their tables; the images are blank, the fourth shows nothing."""
    root = tmp_path_factory.mktemp("dataset")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dataset, "VIEWS_PER_SCENE", 3)
        for index in range(5):
            pose, seen = pose_of(index), 0 if index == 3 else 6 + index
            info = {"bbox_obj": [1, 2, 3, 4], "px_count_all": 80, "px_count_valid": seen, "visib_fract": seen / 80}
            statistics = mask_statistics(np.arange(CAMERA.width * CAMERA.height).reshape(CAMERA.shape_hw) < seen)
            record = {
                "cam_R_m2c": pose[:3, :3].ravel().tolist(),
                "cam_t_m2c": pose[:3, 3].tolist(),
                "depth_scale": 0.002,
                "gt_info": {**info, **{name: statistics[name] for name in ("bbox_visib", "px_count_visib")}},
                "rle_counts": statistics["rle_counts"],
            }
            write_view(ViewPaths(root, index), {"rgb": b""}, record)
        write_camera(root, CAMERA, 0.002)
        write_scene(root, range(3), CAMERA)
        write_scene(root, range(3, 5), CAMERA)
        write_poses(root, range(5), CAMERA, rigid(translation=CENTRE))
    return root


def scene_tables(root: Path, scene: int) -> dict[str, dict]:
    folder = root / "train_pbr" / f"{scene:06d}"
    return {path.stem: json.loads(path.read_text()) for path in folder.glob("*.json")}


@pytest.mark.parametrize(("scene", "views"), [(0, [0, 1, 2]), (1, [3, 4])])
def test_scene_tables_have_the_entries_of_bop(written, scene, views):
    """Names and nesting of bop_toolkit's docs/bop_datasets_format.md and inout.load_scene_gt/camera."""
    tables = scene_tables(written, scene)
    assert tables.keys() == {"scene_camera", "scene_gt", "scene_gt_info", "scene_gt_coco"}
    for name in ("scene_camera", "scene_gt", "scene_gt_info"):
        assert list(tables[name]) == [str(image) for image in range(len(views))]
    for image, view in enumerate(views):
        pose, (truth,), (info,) = pose_of(view), tables["scene_gt"][str(image)], tables["scene_gt_info"][str(image)]
        assert truth.keys() == {"cam_R_m2c", "cam_t_m2c", "obj_id"}
        np.testing.assert_array_equal(np.reshape(truth["cam_R_m2c"], (3, 3)), pose[:3, :3])
        np.testing.assert_array_equal(truth["cam_t_m2c"], pose[:3, 3])
        camera = tables["scene_camera"][str(image)]
        assert camera.keys() == {"cam_K", "depth_scale", "cam_R_w2c", "cam_t_w2c"}
        assert camera["cam_K"] == [31.7, 0, 8.2, 0, 29.3, 7.9, 0, 0, 1]
        counts = {"px_count_all", "px_count_valid", "px_count_visib"}
        assert info.keys() == {"bbox_obj", "bbox_visib", "visib_fract", *counts}


@pytest.mark.parametrize(("scene", "views"), [(0, 3), (1, 2)])
def test_coco_tables_refer_to_their_images_and_hold_their_masks(written, scene, views):
    tables = scene_tables(written, scene)
    coco = tables["scene_gt_coco"]
    assert [image["id"] for image in coco["images"]] == list(range(views))
    assert len({annotation["id"] for annotation in coco["annotations"]}) == views
    for image, annotation in zip(coco["images"], coco["annotations"], strict=True):
        assert (written / "train_pbr" / f"{scene:06d}" / image["file_name"]).exists()
        assert (image["width"], image["height"]) == CAMERA.size_wh
        assert annotation["image_id"] == image["id"]
        assert annotation["category_id"] == coco["categories"][0]["id"]
        runs, (info,) = annotation["segmentation"], tables["scene_gt_info"][str(image["id"])]
        assert runs["size"] == [CAMERA.height, CAMERA.width]
        assert sum(runs["counts"][1::2]) == annotation["area"] == info["px_count_visib"]
        assert annotation["bbox"] == info["bbox_obj"]
        # bop_toolkit's calc_gt_coco.py
        assert annotation["ignore"] == (info["visib_fract"] < 0.1)


def pixels(k: np.ndarray, points_cam: np.ndarray) -> np.ndarray:
    return cv2.projectPoints(points_cam, np.zeros(3), np.zeros(3), k, None)[0][:, 0]


def test_nerf_poses_put_points_on_the_pixels_of_scene_gt(written):
    """transforms.json: cameras look along -z with y up, and (0, 0) is the corner of the top-left pixel."""
    content = json.loads((written / "transforms.json").read_text())
    k = np.array([[content["fl_x"], 0, content["cx"]], [0, content["fl_y"], content["cy"]], [0, 0, 1]])
    assert (content["w"], content["h"]) == CAMERA.size_wh
    assert np.tan(content["camera_angle_x"] / 2) == pytest.approx(CAMERA.width / 2 / CAMERA.fx)
    for index, frame in enumerate(content["frames"]):
        assert frame["file_path"] == f"train_pbr/{index // 3:06d}/rgb/{index % 3:06d}.png"
        opengl = np.linalg.solve(np.array(frame["transform_matrix"]), np.c_[POINTS, np.ones(3)].T).T[:, :3]
        expected = pixels(CAMERA.k, POINTS @ pose_of(index)[:3, :3].T + pose_of(index)[:3, 3])
        np.testing.assert_allclose(pixels(k, opengl * [1, -1, -1]) - 0.5, expected, atol=1e-9)


def test_poses_of_the_table_hold_in_both_frames(written):
    with (written / "poses.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [int(row["index"]) for row in rows] == list(range(5))
    for index, row in enumerate(rows):
        rotation = np.array([[float(row[f"r{i}{j}"]) for j in range(3)] for i in range(3)])
        from_model, from_given = (
            np.array([float(row[f"{prefix}t{axis}_mm"]) for axis in "xyz"]) for prefix in ("", "given_")
        )
        expected = POINTS @ pose_of(index)[:3, :3].T + pose_of(index)[:3, 3]
        np.testing.assert_array_equal(POINTS @ rotation.T + from_model, expected)
        np.testing.assert_allclose((POINTS + CENTRE) @ rotation.T + from_given, expected, atol=1e-9)
        np.testing.assert_array_equal(
            record_pose({"cam_R_m2c": rotation.ravel(), "cam_t_m2c": from_model}), pose_of(index)
        )


def test_model_and_camera_files(tmp_path, written):
    rng = np.random.default_rng(4)
    vertices = rng.normal(scale=20, size=(40, 3))
    mesh = TriangleMesh(vertices, rng.permuted(np.tile(np.arange(40), (60, 1)), axis=1)[:, :3].astype(np.int32))
    write_models(tmp_path, mesh, rng.integers(0, 256, (40, 3)).astype(np.uint8))
    read, _ = read_mesh(tmp_path / "models" / "obj_000001.ply")
    np.testing.assert_allclose(read.vertices, vertices, rtol=1e-6)
    np.testing.assert_array_equal(read.faces, mesh.faces)
    info = json.loads((tmp_path / "models" / "models_info.json").read_text())["1"]
    distances = np.linalg.norm(vertices[:, None] - vertices[None], axis=2)
    assert info["diameter"] == pytest.approx(distances.max())
    for axis, name in enumerate("xyz"):
        assert info[f"min_{name}"] == vertices[:, axis].min()
        assert info[f"size_{name}"] == pytest.approx(np.ptp(vertices[:, axis]))
    camera = json.loads((written / "camera.json").read_text())
    assert camera == {"fx": 31.7, "fy": 29.3, "cx": 8.2, "cy": 7.9, "width": 20, "height": 14, "depth_scale": 0.002}
