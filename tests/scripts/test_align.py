"""The command as a user starts it: pairs in; pose, residuals and case out; what cannot be is refused."""

import json
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from oneframe.alignment import align_case
from oneframe.case.case_file import Case, read_case
from oneframe.case.landmarks import Landmark
from oneframe.commands.__main__ import dispatch
from oneframe.errors import InputError
from oneframe.surface.mesh_reader import read_mesh
from oneframe.transforms import transform_points
from tests.landmark_writer import write_landmarks
from tests.remembered import refinement, remembered

ROUGH = "cam_from_mesh = [[1, 0, 0, 300], [0, -1, 0, -7], [0, 0, -1, 700], [0, 0, 0, 1]]"
FINE = "--click-sigma-px=0.1"


@pytest.fixture
def case_path(tmp_path, write_tiny_case) -> Path:
    """The tiny case with a pose that does not show the surface; ``true.toml`` in the same folder has the true one."""
    path = write_tiny_case(tmp_path / "case")
    text = path.read_text()
    path.with_name("true.toml").write_text(text)
    path.write_text(re.sub("cam_from_mesh = .*", ROUGH, text))
    return path


@pytest.fixture
def align(run_oneframe):
    return partial(run_oneframe, "align")


def true_case(case_path: Path) -> Case:
    return read_case(case_path.with_name("true.toml"))


def clicked_landmarks(case_path: Path, count: int = 7) -> list[Landmark]:
    """Vertices all over the surface, where the true pose shows them."""
    case = true_case(case_path)
    mesh, _ = read_mesh(case.mesh)
    points = mesh.vertices[np.linspace(40, len(mesh.vertices) - 60, count).astype(int)]
    pixels = case.camera.project(transform_points(case.cam_from_mesh, points))
    return [
        Landmark(f"feature {number}", tuple(point), tuple(pixel))
        for number, (point, pixel) in enumerate(zip(points.tolist(), pixels.tolist(), strict=True))
    ]


def printed_matrix(output: str, name: str) -> np.ndarray:
    rows = output[output.index(f"{name}:") :].splitlines()[1:5]
    return np.array([json.loads(row.rstrip(",")) for row in rows])


def test_pairs_become_a_case_with_its_record(case_path, tmp_path, align):
    landmarks = clicked_landmarks(case_path)
    wrong = Landmark("wrong one", landmarks[0].point, (50.0, 40.0))
    unused = [Landmark("half", None, (3.0, 4.0)), Landmark("off", (0.0, 0.0, 0.0), (1.0, 1.0), enabled=False)]
    pairs, out = tmp_path / "pairs.csv", tmp_path / "out.toml"
    write_landmarks(pairs, [*landmarks, wrong, *unused])
    ended = align(case_path, "--landmarks", pairs, FINE, "--out", out)
    assert ended.returncode == 0, ended.stderr
    assert "note: Outlier: 'wrong one' has a reprojection error of" in ended.stdout
    assert re.search(r"wrong one .* left out\n", ended.stdout)
    assert "rms 0.00 px over 7 of 8 landmarks" in ended.stdout

    written = read_case(out)
    pose = printed_matrix(ended.stdout, "cam_from_mesh")
    assert pose == pytest.approx(true_case(case_path).cam_from_mesh, abs=1e-5)
    assert printed_matrix(ended.stdout, "mesh_from_cam") @ pose == pytest.approx(np.eye(4), abs=1e-9)
    assert np.array_equal(written.cam_from_mesh, pose)
    assert written.landmarks == (*landmarks, wrong, *unused)
    assert written.alignment.method == "landmarks"
    assert written.alignment.pairs == 7
    assert written.image.resolve() == read_case(case_path).image.resolve()

    # what was written holds the pairs itself, and aligns to the same pose again
    again = align(out, FINE)
    assert again.returncode == 0, again.stderr
    assert printed_matrix(again.stdout, "cam_from_mesh") == pytest.approx(pose, abs=1e-5)


def test_a_case_without_a_pose_gets_one_from_landmarks_alone(case_path, tmp_path, align, run_oneframe):
    pairs, outs = tmp_path / "pairs.csv", (tmp_path / "of_rough.toml", tmp_path / "of_none.toml")
    write_landmarks(pairs, clicked_landmarks(case_path))
    for out in outs:
        assert align(case_path, "--landmarks", pairs, FINE, "--out", out).returncode == 0
        case_path.write_text(re.sub(r"\[pose\]\ncam_from_mesh = .*", "", case_path.read_text()))
    assert np.allclose(*(read_case(out).cam_from_mesh for out in outs), atol=1e-6)
    ended = align(case_path, "--refine")
    assert (ended.returncode, ended.stderr.count("expected a pose or landmarks, found neither")) == (2, 1)
    ended = run_oneframe("overlay", case_path, "--out", tmp_path / "overlay.png")
    assert (ended.returncode, ended.stderr.count("expected a pose, found no [pose]; align the frame first")) == (2, 1)


def test_a_refused_refinement_leaves_the_pose_of_the_landmarks(case_path, tmp_path, align, monkeypatch):
    """The tiny frame is a pattern that has nothing to do with the surface, which takes long: it is looked at once."""
    monkeypatch.setattr(align_case, "refine_pose", remembered(align_case.refine_pose, refinement(decimals=3)))
    true, out = case_path.with_name("true.toml"), tmp_path / "refined.toml"
    ended = align(true, "--refine", "--out", out)
    assert ended.returncode == 2, ended.stdout
    assert ended.stderr.startswith("error: true.toml: ")
    assert not out.exists()
    # with landmarks there is a pose all the same
    write_landmarks(tmp_path / "pairs.csv", clicked_landmarks(case_path))
    pairs = ("--landmarks", tmp_path / "pairs.csv", FINE)
    ended = align(true, *pairs, "--refine", "--out", out)
    assert ended.returncode == 0, ended.stderr
    assert "note: " in ended.stdout
    assert read_case(out).alignment.method == "landmarks"


def test_a_case_of_another_frame_is_replaced_by_choice_only(case_path, write_tiny_case, tmp_path):
    other = write_tiny_case(tmp_path / "other")
    text, pairs = other.read_bytes(), tmp_path / "pairs.csv"
    write_landmarks(pairs, clicked_landmarks(case_path), mm_per_unit=1.0)
    line = ["align", str(case_path), "--landmarks", str(pairs), FINE, "--out", str(other)]
    with pytest.raises(InputError, match=r"another frame \(frame.png\) and another surface .* --overwrite"):
        dispatch(line)
    assert other.read_bytes() == text
    assert dispatch([*line, "--overwrite"]) == 0
    assert read_case(other).image.resolve() == case_path.with_name("frame.png")
    # its own result, again
    assert dispatch(line) == 0
