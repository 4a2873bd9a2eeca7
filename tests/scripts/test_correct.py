"""The command as a user starts it: registered frames in; the corrected surface, its map and case out, or nothing."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from oneframe.alignment.pose_uncertainty import PoseUncertainty
from oneframe.case.case_file import Case, read_case
from oneframe.case.case_writer import write_case
from oneframe.case.loaded_case import load_case
from oneframe.errors import InputError
from oneframe.images.pixel_values import to_uint8
from oneframe.images.png import encode_png
from oneframe.registration.accepted_frames import accepted_frames
from oneframe.registration.pose_list import CHANGED, encoded_list, pose_entry
from oneframe.registration.pose_list import POSES as LIST
from oneframe.registration.register import RegisteredFrame
from oneframe.registration.register_frames import image_paths
from oneframe.registration.verdict import ACCEPTED, Verdict
from oneframe.surface.mesh_writer import write_ply
from oneframe.surface_correction import CASE, MAP, PAGE, SURFACE
from tests.surface_correction.test_surface_correction import CAMERA, LAMP, bump, photographs, surface


@pytest.fixture
def correct(run_oneframe):
    return partial(run_oneframe, "correct")


def written(folder, count, *, drilled=0) -> Case:
    """A case in metres, and so many frames beside it as ``oneframe register`` leaves them, the last ones drilled."""
    mesh, entries = surface(), []
    write_ply(folder / "surface.ply", mesh.scaled(1e-3))
    (folder / "registered").mkdir()
    frames = photographs(mesh)[: count + 1]
    if drilled:
        deeper = replace(mesh, vertices=mesh.vertices - bump(mesh, 2.0)[:, None] * [0, 0, 1])
        frames[-drilled:] = photographs(deeper)[count + 1 - drilled : count + 1]
    for number, frame in enumerate(frames):
        # their order is that of the names
        path = folder / "registered" / f"{number:0{len(str(count))}}.png"
        path.write_bytes(encode_png(to_uint8(frame.image)))
        pose = frame.cam_from_model
        uncertainty = PoseUncertainty.about_points(np.zeros(3), np.eye(6), mesh.vertices, pose)
        found = RegisteredFrame(Verdict(ACCEPTED, 0.99, "it fits"), pose, uncertainty)
        entries.append(pose_entry(path.name, number, found, np.eye(4), 1e3))
    (folder / "registered" / LIST).write_bytes(encoded_list(entries[1:]))
    case = Case(
        folder / "case.toml", 1e3, min((folder / "registered").iterdir()), CAMERA, None, folder / "surface.ply",
        frames[0].cam_from_model, light=LAMP,
    )  # fmt: skip
    write_case(case.path, case)
    return case


def test_the_corrected_case_stands_beside_the_old_one(tmp_path, correct):
    case, out = written(tmp_path, 10), tmp_path / "corrected"
    before = [path.read_bytes() for path in (case.path, case.mesh)]
    run = correct(case.path, tmp_path / "registered", "--out", out)
    assert run.returncode == 0, run.stderr
    assert "must not guide a surgeon" in run.stdout
    assert sorted(path.name for path in out.iterdir()) == sorted((SURFACE, MAP, PAGE, CASE))
    assert [path.read_bytes() for path in (case.path, case.mesh)] == before
    assert b"property float deviation\nproperty float std_mm\nproperty float confirmed" in (out / SURFACE).read_bytes()
    loaded = load_case(read_case(out / CASE))
    # a true surface, in the units of the case
    shift = loaded.surface.mesh.vertices + loaded.surface.mesh_from_model[:3, 3] - surface().vertices
    assert np.median(np.linalg.norm(shift, axis=1)) < 0.06
    assert "must not guide a surgeon" in (out / PAGE).read_text()
    assert "surface.ply" in (out / CASE).read_text()


def test_poses_go_with_the_names_of_their_images(tmp_path):
    loaded, folder = load_case(read_case(written(tmp_path, 3).path)), tmp_path / "registered"
    (folder / "00.png").write_bytes((folder / "0.png").read_bytes())
    found = accepted_frames(folder, None, loaded)
    names = [path.name for path in image_paths(folder)]
    stated = {entry["image"]: entry["cam_from_mesh"] for entry in json.loads((folder / LIST).read_text())}
    assert {names[number] for number in found.poses} == set(stated) == {"1.png", "2.png", "3.png"}
    for number, pose in found.poses.items():
        np.testing.assert_allclose(pose[:3, :3], np.array(stated[names[number]])[:3, :3], atol=1e-9)
    (folder / "2.png").unlink()
    with pytest.raises(InputError, match=r"2\.png is not there"):
        accepted_frames(folder, None, loaded)


def test_frames_in_which_drilling_went_on_are_cut_away(tmp_path, correct):
    case = written(tmp_path, 10, drilled=4)
    run = correct(case.path, tmp_path / "registered", "--out", tmp_path / "corrected")
    assert run.returncode == 2
    assert "the surface has changed after frame 6, so 4 later ones are left out" in run.stderr
    assert "at least 10 accepted frames that show what the case's frame shows, found 6 of 6" in run.stderr
    assert not (tmp_path / "corrected").exists()


def test_too_few_frames_before_a_change_are_refused_and_nothing_written(tmp_path, correct):
    case, poses = written(tmp_path, 10), tmp_path / "registered" / LIST
    entries = json.loads(poses.read_bytes())
    poses.write_bytes(encoded_list(entries[:5] + [entry | {CHANGED: True} for entry in entries[5:]]))
    run = correct(case.path, poses.parent, "--out", tmp_path / "corrected")
    assert run.returncode == 2
    assert "5 later frames, in which the surface has changed, are left out" in run.stdout
    assert "at least 10 accepted frames" in run.stderr
    assert not (tmp_path / "corrected").exists()
