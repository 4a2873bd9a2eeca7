"""The command as a user starts it: registered frames in; the case with its lamp out, or a sentence and nothing else."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from oneframe.alignment.pose_uncertainty import PoseUncertainty
from oneframe.case.case_file import Case, read_case
from oneframe.case.case_writer import write_case
from oneframe.images.pixel_values import to_uint8
from oneframe.images.png import encode_png
from oneframe.light.lens_light import LensLight
from oneframe.registration.pose_list import POSES as LIST
from oneframe.registration.pose_list import encoded_list, pose_entry
from oneframe.registration.register import RegisteredFrame
from oneframe.registration.verdict import ACCEPTED, Verdict
from oneframe.surface.mesh_writer import write_ply
from tests.light.test_find_lamp import CAMERA, LAMP, POSES, hills, lit_by, photograph, sun


@pytest.fixture
def light(run_oneframe):
    return partial(run_oneframe, "light")


def written(folder, law) -> Case:
    """A case of the hills, and beside it three frames as ``oneframe register`` leaves them, the last one refused."""
    mesh, entries = hills(), []
    write_ply(folder / "surface.ply", mesh)
    for place in ("frames", "registered"):
        (folder / place).mkdir()
    for number, pose in enumerate(POSES):
        path = folder / "frames" / f"{number}.png"
        path.write_bytes(encode_png(to_uint8(photograph(mesh, law, pose).image)))
        uncertainty = PoseUncertainty.about_points(np.zeros(3), np.eye(6), mesh.vertices, pose)
        found = RegisteredFrame(Verdict(ACCEPTED, 0.99, "it fits"), pose, uncertainty)
        entries.append(pose_entry(f"../frames/{path.name}", number, found, np.eye(4), 1.0))
    (folder / "registered" / LIST).write_bytes(encoded_list(entries))
    case = Case(folder / "case.toml", 1.0, folder / "frames/0.png", CAMERA, None, folder / "surface.ply", POSES[0])
    write_case(case.path, case, comment="mine")
    return case


def test_the_case_gets_its_lamp_and_keeps_all_else(tmp_path, light):
    case = written(tmp_path, lit_by(LAMP))
    before = case.path.read_text()
    run = light(case.path, tmp_path / "registered", "--out", tmp_path / "lit.toml")
    assert run.returncode == 0, run.stderr
    assert "explains" in run.stdout
    assert case.path.read_text() == before
    lit = read_case(tmp_path / "lit.toml").light
    np.testing.assert_allclose(lit.lamp_cam_mm, LAMP.lamp_cam_mm, atol=1.5)
    assert lit.origin["method"] == "found"
    assert lit.origin["frames"] == 5
    # over the case itself, and anew over an older lamp
    write_case(case.path, replace(case, light=LensLight((1.0, 2.0, 3.0), 0.5)), comment="mine")
    assert light(case.path, tmp_path / "registered").returncode == 0
    assert read_case(case.path).light == lit


def test_a_sun_is_refused_with_its_figures_and_nothing_is_written(tmp_path, light):
    case = written(tmp_path, sun)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    run = light(case.path, tmp_path / "registered")
    assert run.returncode == 2
    (line,) = run.stderr.splitlines()
    assert "explains" in line
    assert "lamp at the lens" in line
    assert before == {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}


def test_frames_that_are_none_are_named(tmp_path, light):
    case = written(tmp_path, lit_by(LAMP))
    registered = tmp_path / "registered"

    def refusal(*arguments) -> str:
        run = light(case.path, *arguments)
        assert run.returncode == 2
        return run.stderr

    assert "expected FRAMES with it" in refusal("--video", tmp_path / "film.mp4")
    assert "expected frames of a video" in refusal(registered, "--video", tmp_path / "film.mp4")
    assert "poses of registered frames" in refusal(tmp_path / "frames")
    entries = json.loads((registered / LIST).read_text())
    for changed, words in (
        ([entry | {"state": "doubtful"} for entry in entries], "expected accepted frames, found none among 4"),
        ([{**entry, "image": ""} for entry in entries], "frames of a video with --video"),
        ([[1, 2]], "expected the poses that oneframe register writes"),
    ):
        (registered / LIST).write_text(json.dumps(changed))
        assert words in refusal(registered)
