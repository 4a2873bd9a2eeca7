"""Laws of what the reader computes: coordinates, normals, distances, and flow with what hides it."""

import cv2
import numpy as np
import pytest

from oneframe.dataset.truths import TRUTHS, Shot, points_model
from oneframe.errors import InputError
from oneframe.projection.rendered_view import RenderedView
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.reader import Dataset, open_dataset
from oneframe.reader.view import flow
from oneframe.transforms import camera_centre, inverse_rigid, rotation_angle_deg, transform_points
from tests.conftest import intersect
from tests.dataset.synthetic_dataset import CAMERA, MESH

GRID = CAMERA.pixel_grid()


@pytest.fixture(params=["folder", "pack", "16 bit"])
def opened(request, dataset, packed) -> Dataset:
    if request.param == "16 bit":
        copied = request.getfixturevalue("copied")
        path = copied / "dataset.json"
        path.write_text(path.read_text().replace('"float_depth": true', '"float_depth": false'))
        return open_dataset(copied)
    return open_dataset(dataset if request.param == "folder" else packed)


def test_the_pose_is_found_from_object_coordinates(opened):
    for view in opened:
        assert (np.isnan(view.points_model) == ~view.mask[..., None]).all()
        points, pixels = view.points_model[view.mask].astype(float), GRID[view.mask]
        _, turn, shift = cv2.solvePnP(points, pixels, view.k, None, flags=cv2.SOLVEPNP_ITERATIVE)
        rotation, _ = cv2.Rodrigues(turn)
        assert rotation_angle_deg(rotation @ view.cam_from_model[:3, :3].T) < 1e-3
        assert np.abs(shift[:, 0] - view.cam_from_model[:3, 3]).max() < 1e-2
        box = view.nocs[view.mask]
        assert (box.min() >= 0, box.max() <= 1) == (True, True)
        low, high = MESH.bounds
        assert np.abs(low + box * (high - low) - points).max() < 0.01


def test_the_distance_is_that_of_the_point_from_the_centre(opened):
    for view in opened:
        away = np.linalg.norm(view.points_model - camera_centre(view.cam_from_model), axis=2)
        np.testing.assert_allclose(view.distance_mm, np.nan_to_num(away), rtol=1e-6)


def test_normals_face_the_camera_and_are_those_that_would_be_stored(opened):
    for view in opened:
        seen, pose = view.mask, view.cam_from_model
        assert not view.normals_cam[~seen].any()
        normals = view.normals_cam.astype(float)
        np.testing.assert_allclose(np.linalg.norm(normals[seen], axis=1), 1, atol=1e-4)
        points_cam = transform_points(pose, view.points_model.reshape(-1, 3).astype(float)).reshape(normals.shape)
        assert ((normals * points_cam).sum(axis=2)[seen] < 0).all()
        # on one face, neighbours lie in its plane
        beside = np.diff(points_cam, axis=1)
        flat = (np.diff(normals, axis=1) == 0).all(axis=2) & seen[:, 1:] & seen[:, :-1]
        assert flat.sum() > 100
        slope = (beside * normals[:, 1:]).sum(axis=2)[flat]
        assert np.abs(slope).max() < (0.015 if "depth_mm" not in view.files.description.kinds else 1e-3)
        rendered = RenderedView(view.rgb, view.depth_mm, view.source_frame, np.zeros_like(seen))
        codes = TRUTHS["normals"].array(Shot(rendered, pose, MESH, CAMERA, 0.01))
        np.testing.assert_allclose(normals[seen], codes[seen] / 32767.5 - 1, atol=1e-6)


def test_flow_leads_to_the_same_point(opened):
    """As rays through the very places say, by another program."""
    for one, other in [(one, other) for one in opened for other in opened]:
        flow_px, visible = one.flow_to(other)
        assert (np.isnan(flow_px) == ~one.mask[..., None]).all()
        assert not visible[~one.mask].any()
        there, pose = (GRID + flow_px)[one.mask].astype(float), other.cam_from_model
        points = one.points_model[one.mask].astype(float)
        z, _ = intersect(MESH, CAMERA, pose, there)
        shown = np.abs(z - transform_points(pose, points)[:, 2]) < 0.1
        found = transform_points(inverse_rigid(pose), CAMERA.rays_cam(there) * z[:, None])
        assert np.linalg.norm(found - points, axis=1)[shown].max() < 0.12
        assert (visible[one.mask] != shown & CAMERA.contains(there)).mean() < 0.1
        if one.index == other.index:
            assert visible[one.mask].all()
            assert np.abs(flow_px[one.mask]).max() < 1e-3


def test_a_plate_hides_what_is_behind_it_up_to_a_pixel_of_its_outline(stepped_mesh, frontal_pose, oblique_pose):
    camera = CAMERA.resized(320, 240)
    poses = (frontal_pose, oblique_pose)
    depths = [rasterise_depth(stepped_mesh, camera, pose).depth_mm for pose in poses]
    for here, there in ((0, 1), (1, 0)):
        points = points_model(depths[here], camera, poses[here])
        flow_px, visible = flow(points, camera, poses[there], depths[there], 0.0)
        seen = depths[here] > 0
        places = (camera.pixel_grid() + flow_px)[seen].astype(float)
        far = transform_points(poses[there], points[seen].astype(float))[:, 2]
        # what is in front at the place, and a pixel around it
        around = np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)])
        asked = (places + around[:, None]).reshape(-1, 2)
        near = intersect(stepped_mesh, camera, poses[there], asked)[0].reshape(len(around), -1)
        hidden = (near > 0) & (near < far - 1.0)
        inside = camera.contains(places)
        assert 200 < (hidden[0] & inside).sum() < 0.2 * inside.sum()
        assert not visible[seen][hidden.all(axis=0)].any()
        assert visible[seen][inside & ~hidden.any(axis=0)].all()
        assert not visible[seen][~inside].any()


def test_flow_to_another_surface_is_a_sentence(dataset, copied):
    path = copied / "dataset.json"
    path.write_text(path.read_text().replace('"geometry_sha256": "', '"geometry_sha256": "0'))
    with pytest.raises(InputError, match="flow to view 1: expected a view of the same surface, found 'lumpy sphere'"):
        open_dataset(dataset)[0].flow_to(open_dataset(copied)[1])
