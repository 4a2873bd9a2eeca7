"""Lists of photographs: poses in the mesh's frame and units become poses of the model; what is no list is refused."""

import json

import numpy as np
import pytest

from oneframe.camera.distortion import Distortion
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.frame import load_frame, load_posed_frame
from oneframe.errors import InputError
from oneframe.images.png import encode_png
from oneframe.registration.pose_list import read_photographs
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


def test_a_photograph_as_the_lens_took_it_is_undistorted(tmp_path, loaded, oblique_pose):
    """As the frame of a case with this distortion, and only where its entry says so."""
    v, u = np.mgrid[:48, :64]
    codes = np.stack([u * 4, v * 5, 255 - u - v], -1).astype(np.uint8)
    (tmp_path / "a.png").write_bytes(encode_png(codes))
    path, lens = tmp_path / "list.json", [0.4, -0.1, 0.002, 0.001, 0.0]
    entry = listed(oblique_pose.tolist())
    for distortion in (None, lens):
        path.write_text(json.dumps([entry if distortion is None else entry | {"distortion": distortion}]))
        (photograph,), _ = read_photographs(path, loaded.case)
        shown = load_posed_frame(photograph, MESH_FROM_MODEL, name="case.toml")
        expected = Distortion(*distortion) if distortion else None
        image, valid = load_frame(tmp_path / "a.png", CAMERA, expected, name="case.toml")
        np.testing.assert_array_equal(shown.image, image)
        np.testing.assert_array_equal(shown.valid, valid)
        assert np.array_equal(np.rint(image * 255), codes) == (distortion is None)
    path.write_text(json.dumps([entry | {"distortion": "none"}]))
    with pytest.raises(InputError, match=r"list\.json: entry 0: distortion"):
        read_photographs(path, loaded.case)
