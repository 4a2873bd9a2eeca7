"""A list of poses gives back what it was written from, as does the record of a case; photographs have their poses."""

import json
from dataclasses import replace

import numpy as np
import pytest

from oneframe.alignment.pose_uncertainty import PoseUncertainty
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import read_case
from oneframe.case.case_queue import ALIGNED, DOUBTFUL, NewFrame, add_frames, state_of
from oneframe.case.pose_record import PoseRecord
from oneframe.registration.pose_list import (
    encoded_list,
    pose_entry,
    read_photographs,
    registered_of,
    registration_record,
)
from oneframe.registration.register import RegisteredFrame, accepted_poses
from oneframe.registration.verdict import ACCEPTED, REFUSED, Verdict
from oneframe.transforms import inverse_rigid, se3_exp

CAMERA = PinholeCamera(640, 480, 900.0, 900.0, 319.5, 239.5)


def pose_of(rng):
    return se3_exp(np.array([*rng.normal(0, 20, 2), rng.uniform(80, 200), *rng.normal(0, 0.5, 3)]))


def found_in(rng, state=ACCEPTED):
    if state == REFUSED:
        return RegisteredFrame(Verdict(REFUSED, 0.25, "it shares too few features"))
    pose, root = pose_of(rng), rng.normal(0, 0.1, (6, 6))
    points = rng.normal(0, 9, (50, 3))
    uncertainty = PoseUncertainty.about_points(points.mean(axis=0), root @ root.T, points, pose)
    verdict = Verdict(state, 0.9875, "12 of 40 places")
    return RegisteredFrame(verdict, pose, uncertainty, by_zoom=rng.normal(0, 1, 6))


def assert_same(one, other):
    assert (one.verdict, one.changed) == (other.verdict, other.changed)
    if one.cam_from_model is None:
        assert other.cam_from_model is other.uncertainty is None
        return
    np.testing.assert_allclose(one.cam_from_model, other.cam_from_model, atol=1e-9)
    for name in ("pivot_model", "covariance", "radius_mm", "pivot_cam"):
        np.testing.assert_allclose(getattr(one.uncertainty, name), getattr(other.uncertainty, name), atol=1e-9)


@pytest.mark.parametrize("mm_per_unit", [1.0, 1000.0])
def test_a_list_gives_back_what_was_found(write_tiny_case, tmp_path, mm_per_unit):
    rng = np.random.default_rng(3)
    mesh_from_model = se3_exp(np.array([300.0, -20.0, 5.0, 0.0, 0.0, 0.0]))
    frames = {7: found_in(rng), 2: found_in(rng, REFUSED), 30: replace(found_in(rng), changed=True)}
    entries = [pose_entry("a.png", number, found, mesh_from_model, mm_per_unit) for number, found in frames.items()]
    (tmp_path / "list.json").write_bytes(encoded_list(entries))
    back = registered_of(json.loads(encoded_list(entries)), mesh_from_model, mm_per_unit)
    assert back.keys() == frames.keys()
    for number, found in frames.items():
        assert_same(found, back[number])
        np.testing.assert_array_equal(found.by_zoom, back[number].by_zoom)
    assert list(accepted_poses(back)) == [7], "the surface has changed in the other one"
    with pytest.raises(ValueError, match="finite covariance"):
        registered_of([entries[0] | {"by_zoom_mm_rad": [np.nan] * 6}], mesh_from_model, mm_per_unit)
    # as photographs
    case = replace(read_case(write_tiny_case(tmp_path)), mm_per_unit=mm_per_unit)
    photographs, _ = read_photographs(tmp_path / "list.json", case)
    assert {each.image for each in photographs} == {tmp_path / "a.png"}
    poses = [found.cam_from_model for found in frames.values() if found.cam_from_model is not None]
    for photograph, pose in zip(photographs, poses, strict=True):
        np.testing.assert_allclose(photograph.cam_from_mesh @ mesh_from_model, pose, atol=1e-9)


@pytest.mark.parametrize("state", [ACCEPTED, "doubtful"])
def test_a_case_in_a_queue_keeps_pose_and_covariance_as_found(write_tiny_case, tmp_path, state):
    rng, like = np.random.default_rng(4), read_case(write_tiny_case(tmp_path / "like"))
    mesh_from_model = se3_exp(np.array([300.0, -20.0, 5.0, 0.0, 0.0, 0.0]))
    found, source = found_in(rng, state), PoseRecord("landmarks")
    record = registration_record(found, CAMERA, mesh_from_model, source, "first.png", "OneFrame", "2024-05-06")
    frame = NewFrame(like.image, ("film.mp4", 7), found.cam_from_model @ inverse_rigid(mesh_from_model), record)
    (path,) = add_frames(tmp_path / "queue", like, [frame])
    case = read_case(path)
    assert (case.video, state_of(case)) == (("film.mp4", 7), ALIGNED if state == ACCEPTED else DOUBTFUL)
    assert case.alignment.probability == found.verdict.probability
    pose = case.cam_from_mesh @ mesh_from_model
    stated = PoseUncertainty.stated(case.alignment, np.zeros((1, 3)), pose, mesh_from_model)
    assert_same(found, RegisteredFrame(found.verdict, pose, stated))
    # as the uncertainty of the pose of a surface of another size
    scaled = case.alignment.scaled(1000.0)
    for key, value in found.uncertainty.scaled(1000.0).entry(se3_exp(np.array([3e5, -2e4, 5e3, 0, 0, 0]))).items():
        np.testing.assert_allclose(getattr(scaled, key), value, rtol=1e-6)


def test_a_pose_that_is_found_goes_to_a_case_without_one_alone(write_tiny_case, tmp_path):
    like = read_case(write_tiny_case(tmp_path / "like"))
    queue, new = tmp_path / "queue", NewFrame(like.image)
    (path,) = add_frames(queue, like, [new])
    for shift, expected in ((1.0, 1.0), (2.0, 1.0)):
        pose = se3_exp(np.array([shift, 0, 0, 0, 0, 0])) @ like.cam_from_mesh
        add_frames(queue, like, [NewFrame(like.image, None, pose, PoseRecord("registered"))])
        case = read_case(path)
        assert case.alignment == PoseRecord("registered")
        assert case.cam_from_mesh[0, 3] - like.cam_from_mesh[0, 3] == pytest.approx(expected)
