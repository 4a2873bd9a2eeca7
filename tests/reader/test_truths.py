"""Laws of what the reader computes: coordinates, normals, distances."""

import cv2
import numpy as np
import pytest

from oneframe.dataset.truths import TRUTHS, Shot
from oneframe.projection.rendered_view import RenderedView
from oneframe.reader import Dataset, open_dataset
from oneframe.transforms import rotation_angle_deg, transform_points
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


def test_normals_face_the_camera_and_are_those_that_would_be_stored(opened):
    for view in opened:
        seen, pose = view.mask, view.cam_from_model
        assert not view.normals[~seen].any()
        normals = view.normals.astype(float)
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
