"""A network learns where a picture shows which point of a surface; PnP makes a pose of that, which is judged."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import read_case
from oneframe.case.loaded_case import load_case
from oneframe.dataset.identity import geometry_hash
from oneframe.errors import InputError
from oneframe.images.png import encode_png
from oneframe.learning.pose_network import KEY, NetworkRecord, PoseNetwork, network_input, pose_of, sealed
from oneframe.learning.view_crops import FULL, NOTHING, ViewCrops
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.registration.verdict import ACCEPTED, REFUSED
from oneframe.transforms import inverse_rigid, rigid, rotation_angle_deg, rotation_from_vector, transform_points
from tests.alignment.test_refinement import hills
from tests.learning.onnx_by_hand import described, node, number, part, tensor
from tests.registration import test_registration as registration

CAMERA = PinholeCamera(128, 96, 150.0, 150.0, 63.5, 47.5)
POSE = rigid(rotation_from_vector(np.array([0.4, -0.3, 0.2])), np.array([3.0, -2.0, 200.0]))
RECORD = NetworkRecord("surface", "dataset", 1, 120, 0, 128, 96, 150.0, (0.0, 0.0, 0.0), 60.0)
MM = 150.0
"""Places along an axis that the colours stand for."""


def test_a_network_learns_points_and_finds_the_pose_of_what_it_trained_on():
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    pytest.importorskip("onnx", reason="onnx is not installed")
    from oneframe.learning.coordinate_network import onnx_file, trained_network

    views, rng = ViewCrops.of([plane_view(CAMERA, np.random.default_rng(0))]), np.random.default_rng(1)
    trained = trained_network(views, 120, 0, lambda: None)
    network = PoseNetwork(onnx_file(trained, RECORD), "network.onnx", views.rgba[0, ..., :3].reshape(-1, 3))
    assert network.record == RECORD
    for size_hw in ((96, 128), (64, 160)):
        images = rng.integers(0, 256, (2, *size_hw, 3), np.uint8)
        with torch.no_grad():
            expected = trained(torch.from_numpy(network_input(images)))
        np.testing.assert_allclose(network.output(images), expected, atol=1e-4)
    pose = network.pose(views.rgba[0, ..., :3], CAMERA)
    assert rotation_angle_deg(pose[:3, :3] @ POSE[:3, :3].T) < 10


def test_crops_are_on_what_surrounds_the_surface_and_on_anything():
    """Half of them each; that is nowhere surface to learn."""
    view, rng = plane_view(CAMERA, np.random.default_rng(0)), np.random.default_rng(1)
    view.mask_surround[:] = ~view.mask
    view.rgb[~view.mask] = [0, 255, 0]
    crops, green = ViewCrops.of([view]), 0
    assert (crops.around[0] == ~view.mask).all()
    assert (crops.codes[0][~view.mask] == NOTHING).all()
    for _ in range(40):
        image = crops.crop(rng)[0].astype(int)
        green += ((image[..., 1] > 120) & (image[..., [0, 2]].max(axis=2) < 60)).mean() > 0.1
    assert 10 < green < 30


def test_a_pose_stands_against_wrong_points_that_claim_to_be_sure():
    rng = np.random.default_rng(0)
    points = rng.uniform(-40, 40, (200, 3))
    pixels = CAMERA.project(transform_points(POSE, points)) + rng.normal(0, 0.3, (200, 2))
    points[:60] = rng.uniform(-40, 40, (60, 3))
    pose = pose_of(points, pixels, np.full(200, 1.0), CAMERA)
    assert rotation_angle_deg(pose[:3, :3] @ POSE[:3, :3].T) < 0.5
    assert pose_of(points[:5], pixels[:5], np.ones(5), CAMERA) is None


@pytest.fixture
def coded_case(tmp_path, monkeypatch):
    """A case, a blurred image that features do not find, its pose, and a network that reads places from colours."""
    monkeypatch.setattr(registration.known_views, "TILTS_DEG", ((0.0, 1),))
    mesh, pose = hills(1), registration.seen_from(45, 20)
    registration.write_case(tmp_path, mesh, registration.SOURCE)
    (tmp_path / "frames").mkdir()
    blurred = cv2.GaussianBlur(colour_coded(mesh, pose), (0, 0), 4)
    (tmp_path / "frames" / "0.png").write_bytes(encode_png(blurred))
    (tmp_path / "frame.png").write_bytes(encode_png(colour_coded(mesh, registration.SOURCE)))
    loaded = load_case(read_case(tmp_path / "case.toml"))
    middle = tuple((-loaded.surface.mesh_from_model[:3, 3]).tolist())
    camera = registration.CAMERA.resized(160, 120)
    record = replace(
        RECORD, surface=geometry_hash(loaded.surface.mesh), width=160, height=120, fx=camera.fx, centre_model=middle
    )
    (tmp_path / "network.onnx").write_bytes(network_of_colours(record))
    return tmp_path, pose, record


def colour_coded(mesh, cam_from_model: np.ndarray) -> np.ndarray:
    """The photograph of the registration's tests; red is more by x, green by y, relative to blue."""
    camera = registration.CAMERA
    inverse = rasterise_depth(mesh, camera, cam_from_model).inverse_depth
    points = camera.rays_cam(camera.pixel_grid()) / np.maximum(inverse, 1e-9)[..., None]
    points = transform_points(inverse_rigid(cam_from_model), points.reshape(-1, 3)).reshape(points.shape)
    image = registration.photograph(mesh, cam_from_model)
    image[..., :2] += np.where(inverse[..., None] > 0, points[..., :2] / MM, 0)
    return np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)


def network_of_colours(record: NetworkRecord) -> bytes:
    """One convolution: the mean colours of a cell to its place, at height 0."""
    weights, biases = np.zeros((5, 3, 8, 8)), np.array([0, 0, 0, np.log(0.03), 5.0])
    for axis in (0, 1):
        weights[axis, axis], weights[axis, 2] = 1, -1
    # of codes / 64 - 2
    weights *= 64 / 255 * MM / record.reach_mm / 64
    convolution = node("Conv", ["image", "weights", "biases"], "cells", kernel_shape=[8, 8], strides=[8, 8])
    tensors = tensor("weights", weights) + tensor("biases", biases)
    ends = described(11, "image", (4, 3, 128, 160)) + described(12, "cells", (4, 5, 16, 20))
    graph = convolution + part(2, "colours") + tensors + ends
    metadata = part(14, part(1, KEY) + part(2, record.text()))
    return sealed(number(1, 8) + part(7, graph) + part(8, number(2, 13)) + metadata)


def test_a_frame_in_which_features_fail_is_located_and_judged(coded_case):
    folder, true, _ = coded_case
    (entry,) = registration.registered(folder, "frames", folder / "registered")
    assert entry["state"] == REFUSED
    (entry,) = registration.registered(folder, "frames", folder / "located", "--network", folder / "network.onnx")
    assert entry["state"] == ACCEPTED
    assert rotation_angle_deg(np.array(entry["cam_from_mesh"])[:3, :3] @ true[:3, :3].T) < 0.5
    assert {path.name for path in (folder / "located").iterdir()} == {
        path.name for path in (folder / "registered").iterdir()
    }


def test_what_haze_hides_is_seen_at_the_second_try(coded_case):
    folder, _, _ = coded_case
    network = PoseNetwork.read(folder / "network.onnx", load_case(read_case(folder / "case.toml")))
    clear = colour_coded(hills(1), registration.SOURCE)
    hazy = np.rint(0.2 * clear + 0.8 * 220).astype(np.uint8)
    expected = network.pose(clear, registration.CAMERA)
    poses = list(network.poses(hazy, registration.CAMERA))
    first_mm, second_mm = (np.linalg.norm(pose[:3, 3] - expected[:3, 3]) for pose in poses)
    assert first_mm > 100
    assert second_mm < 5


@pytest.mark.parametrize("what", ["surface", "zoom", "record", "cut off", "damaged", "lie"])
def test_a_network_of_something_else_is_refused(coded_case, what):
    folder, _, record = coded_case
    data = {
        "surface": network_of_colours(replace(record, surface="0" * 64)),
        "zoom": network_of_colours(replace(record, fx=3 * record.fx)),
        "record": b"ONNX",
        "cut off": network_of_colours(record)[3000:],
        "damaged": network_of_colours(record).replace(b"Conv", b"Comv"),
        "lie": network_of_colours(record).replace(b'"width": 1', b'"width": 2'),
    }[what]
    words = {"surface": "another", "zoom": "zoom", "record": "oneframe train wrote"}.get(what, "again")
    (folder / "network.onnx").write_bytes(data)
    with pytest.raises(InputError, match=rf"network\.onnx: expected .*{words}"):
        registration.registered(folder, "frames", folder / "located", "--network", folder / "network.onnx")
    assert not (folder / "located").exists()


def test_larger_views_are_made_smaller_and_show_the_same_points():
    rng = np.random.default_rng(0)
    large = ViewCrops.of([plane_view(CAMERA.resized(640, 480), rng)])
    assert max(large.camera.size_wh) < 160
    small = ViewCrops.of([plane_view(large.camera, rng)])
    assert small.camera == large.camera
    seen = [crops.codes[0, ..., 0] != NOTHING for crops in (large, small)]
    assert (seen[0] != seen[1]).mean() < 0.01
    both = seen[0] & seen[1]
    assert np.abs(large.codes[0][both] / FULL - small.codes[0][both] / FULL).max() * 60 < 0.3


def plane_view(camera: PinholeCamera, rng: np.random.Generator) -> SimpleNamespace:
    """A view of a square of coarse patches."""
    rays = camera.rays_cam(camera.pixel_grid())
    normal = POSE[:3, 2]
    depth_mm = (normal @ POSE[:3, 3]) / (rays @ normal)
    points = transform_points(inverse_rigid(POSE), (rays * depth_mm[..., None]).reshape(-1, 3)).reshape(rays.shape)
    mask = np.abs(points).max(axis=-1) < 60
    texture = cv2.resize(rng.integers(0, 255, (12, 12, 3)).astype(np.uint8), (121, 121))
    rgb = cv2.remap(texture, *np.float32(points[..., :2] + 60).transpose(2, 0, 1), cv2.INTER_LINEAR)
    v, u = np.nonzero(mask)
    return SimpleNamespace(
        rgb=rgb * mask[..., None],
        mask=mask,
        mask_occluder=np.zeros_like(mask),
        mask_surround=np.zeros_like(mask),
        depth_mm=np.where(mask, depth_mm, 0).astype(np.float32),
        cam_from_model=POSE,
        boxes=SimpleNamespace(bbox_visib=(u.min(), v.min(), np.ptp(u), np.ptp(v))),
        files=SimpleNamespace(
            mesh=SimpleNamespace(bounds=np.array([[-60.0] * 3, [60.0] * 3])),
            description=SimpleNamespace(camera=camera),
        ),
    )
