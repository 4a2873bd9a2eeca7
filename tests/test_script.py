"""What is public: the script of the documentation runs, and an import alone takes nothing along."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import oneframe
from oneframe.case.landmarks import Landmark
from oneframe.case.pose_record import PoseRecord
from oneframe.surface.mesh_reader import read_mesh
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import transform_points
from tests.landmark_writer import write_landmarks
from tests.volume.ball_ct import write_ball_ct

PAGE = Path(__file__).resolve().parents[1] / "docs" / "python.md"


@pytest.mark.render
def test_the_script_of_the_documentation_runs(write_tiny_case, tmp_path):
    case = oneframe.read_case(write_tiny_case(tmp_path / "case"))
    points = read_mesh(case.mesh)[0].vertices[::37]
    pixels = case.camera.project(transform_points(case.cam_from_mesh, points))
    pairs = enumerate(zip(points.tolist(), pixels.tolist(), strict=True))
    landmarks = [Landmark(f"feature {number}", tuple(point), tuple(pixel)) for number, (point, pixel) in pairs]
    write_landmarks(tmp_path / "landmarks.csv", landmarks)
    (script,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    ended = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert "dataset of 3 views: complete and consistent" in ended.stdout
    assert ended.stdout.count("(24, 32, 3)") == 5
    assert (tmp_path / "surface.glb").is_file()


@pytest.mark.render
def test_options_are_those_of_the_command(write_tiny_case, tmp_path):
    case = oneframe.read_case(write_tiny_case(tmp_path / "case"))
    np.save(tmp_path / "case" / "poses.npy", [case.cam_from_mesh])
    case = replace(case, dataset={"poses": "poses.npy", "count": 1})
    oneframe.render_dataset(case, tmp_path / "views", workers=1, stereo_mm=np.float64(10), for_training=True)
    view = oneframe.open_dataset(tmp_path / "views")[0]
    left_from_right = view.cam_from_model @ np.linalg.inv(view.right.cam_from_model)
    np.testing.assert_allclose(left_from_right[:3, 3], [10, 0, 0], atol=1e-9)
    with pytest.raises(oneframe.InputError, match="did you mean 'count'"):
        oneframe.render_dataset(case, tmp_path / "others", cont=1)
    with pytest.raises(oneframe.InputError, match="found 'vertices'"):
        oneframe.colour_surface(case, tmp_path / "surface.ply", colour="vertices")


@pytest.mark.render
def test_a_case_from_a_ct(tmp_path):
    write_ball_ct(tmp_path)
    mesh = oneframe.surface_from_ct(tmp_path / "ct.nii.gz")
    assert len(mesh.faces) > 100
    cv2.imwrite(str(tmp_path / "frame.png"), np.full((72, 96, 3), 99, np.uint8))
    (tmp_path / "k.json").write_text('{"fx": 900, "fy": 900, "cx": 47, "cy": 36, "width": 96, "height": 72}')
    write_ply(tmp_path / "bone.ply", mesh)
    given = {"frame": tmp_path / "frame.png", "camera": tmp_path / "k.json"}
    case = oneframe.make_case(tmp_path / "case", surface=tmp_path / "bone.ply", **given)
    assert case.alignment == PoseRecord("initial guess")
    assert len(oneframe.load_case(case).surface.mesh.faces) == len(mesh.faces)
    with pytest.raises(oneframe.InputError, match="does not exist"):
        oneframe.make_case(tmp_path / "other", surface=tmp_path / "no.ply", **given)


def test_the_name_of_a_file_may_be_text(write_tiny_case, tmp_path):
    case = oneframe.read_case(str(write_tiny_case(tmp_path / "case")))
    oneframe.write_case(f"{tmp_path}/case/again.toml", case)
    assert oneframe.read_case(f"{tmp_path}/case/again.toml").camera == case.camera
    for refused in (oneframe.check_dataset, oneframe.open_dataset, lambda folder: oneframe.pack_dataset(folder, "p")):
        with pytest.raises(oneframe.InputError, match="expected"):
            refused(f"{tmp_path}/none")


def test_everything_public_is_documented_and_found_late():
    page = PAGE.read_text()
    assert set(re.findall(r"auto(?:function|exception):: (\w+)$", page, re.M)) == set(oneframe.__all__)
    assert all(getattr(oneframe, name).__doc__ for name in oneframe.__all__)
    with pytest.raises(AttributeError):
        oneframe.no_such_name  # noqa: B018
    code = "import oneframe, sys; sys.exit(bool({'numpy', 'bpy', 'cv2'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
