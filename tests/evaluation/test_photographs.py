"""Lists of photographs: poses in the mesh's frame and units become poses of the model; what is no list is refused."""

import json

import numpy as np
import pytest

from oneframe.blender.case.load_case import read_photographs
from oneframe.camera.pinhole import PinholeCamera
from oneframe.transforms import inverse_rigid, rigid, rotation_from_vector

CAMERA = PinholeCamera(64, 48, 300.0, 300.0, 31.5, 23.5)
MESH_FROM_MODEL = rigid(rotation_from_vector(np.array([0.2, -0.1, 0.4])), np.array([20.0, -7.0, 3.0]))


@pytest.fixture
def loaded(loaded_case, bumpy_mesh, frontal_pose):
    image = np.zeros((48, 64, 3), np.float32)
    return loaded_case(bumpy_mesh, image, frontal_pose, CAMERA, mesh_from_model=MESH_FROM_MODEL, mm_per_unit=1000.0)


def listed(pose: object, image: object = "a.png") -> dict:
    return {"image": image, "cam_from_mesh": pose}


def test_poses_are_those_of_the_model_in_millimetres(tmp_path, loaded, oblique_pose):
    in_metres = oblique_pose @ inverse_rigid(MESH_FROM_MODEL)
    in_metres[:3, 3] /= 1000
    path = tmp_path / "list.json"
    path.write_text(json.dumps([listed(in_metres.tolist())]))
    (photograph,), messages = read_photographs(path, loaded.case)
    assert photograph.image == tmp_path / "a.png"
    assert not messages
    np.testing.assert_allclose(photograph.cam_from_mesh @ MESH_FROM_MODEL, oblique_pose, atol=1e-9)
