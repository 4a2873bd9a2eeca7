"""The tables of poses hold the same poses as the records, in their own conventions."""

import csv
import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.run.resume_record import read_record
from oneframe.dataset.tables.pose_tables import write_poses
from oneframe.transforms import rigid
from tests.dataset.synthetic_dataset import CAMERA, CENTRE, COUNT, DEPTH_SCALE, MESH, pose_of

pytestmark = pytest.mark.usefixtures("small_scenes")

POINTS = np.array([[1.0, 2.0, -3.0], [-4.0, 0.5, 2.0], [0.0, 0.0, 0.0]])


def pixels(k: np.ndarray, points_cam: np.ndarray) -> np.ndarray:
    return cv2.projectPoints(points_cam, np.zeros(3), np.zeros(3), k, None)[0][:, 0]


def test_nerf_poses_put_points_on_the_pixels_of_scene_gt(sound):
    """transforms.json: cameras look along -z with y up, and (0, 0) is the corner of the top-left pixel."""
    content = json.loads((sound / "transforms.json").read_text())
    k = np.array([[content["fl_x"], 0, content["cx"]], [0, content["fl_y"], content["cy"]], [0, 0, 1]])
    assert (content["w"], content["h"]) == CAMERA.size_wh
    assert np.tan(content["camera_angle_x"] / 2) == pytest.approx(CAMERA.width / 2 / CAMERA.fx)
    for index, frame in enumerate(content["frames"]):
        assert frame["file_path"] == f"train_synt/{index // 3:06d}/rgb/{index % 3:06d}.png"
        opengl = np.linalg.solve(np.array(frame["transform_matrix"]), np.c_[POINTS, np.ones(3)].T).T[:, :3]
        expected = pixels(CAMERA.k, POINTS @ pose_of(index)[:3, :3].T + pose_of(index)[:3, 3])
        np.testing.assert_allclose(pixels(k, opengl * [1, -1, -1]) - 0.5, expected, atol=1e-9)


def test_poses_of_the_table_hold_in_both_frames(sound):
    with (sound / "poses.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [int(row["index"]) for row in rows] == list(range(COUNT))
    for index, row in enumerate(rows):
        rotation = np.array([[float(row[f"r{i}{j}"]) for j in range(3)] for i in range(3)])
        from_model, from_mesh_frame = (
            np.array([float(row[f"{prefix}t{axis}_mm"]) for axis in "xyz"]) for prefix in ("", "mesh_")
        )
        expected = POINTS @ pose_of(index)[:3, :3].T + pose_of(index)[:3, 3]
        np.testing.assert_array_equal(POINTS @ rotation.T + from_model, expected)
        np.testing.assert_allclose((POINTS + CENTRE) @ rotation.T + from_mesh_frame, expected, atol=1e-9)
        np.testing.assert_array_equal(rigid(rotation, from_model), pose_of(index))


def test_instant_ngp_finds_the_surface_in_its_cube_and_depths_in_its_unit(sound, tmp_path):
    """As in its src/nerf_loader.cu: points * scale + offset; one scale for all depths; views without depth_path."""
    near = read_record(ViewPaths(sound, 0))
    records = [near, replace(near, depth_scale=2.5 * DEPTH_SCALE)]
    write_poses(tmp_path, records, CAMERA, rigid(translation=CENTRE), bounds=MESH.bounds, depth_scale=DEPTH_SCALE)
    content = json.loads((tmp_path / "transforms.json").read_text())
    corners = MESH.bounds * content["scale"] + content["offset"]
    assert ((corners > 0) & (corners < 1)).all()
    assert np.ptp(corners, axis=0).max() > 0.8
    assert content["aabb_scale"] == 1
    assert content["integer_depth_scale"] == DEPTH_SCALE
    paths = [(frame.get("depth_path"), frame["depth_file_path"]) for frame in content["frames"]]
    assert paths == [(paths[0][1], paths[0][1]), (None, paths[1][1])]
