"""Rejection keeps the conditional distribution and ends; explicit lists are read exactly or refused."""

import json
import os

import numpy as np
import pytest

from oneframe.errors import InputError
from oneframe.poses.constraints import Constraints, Rejections, ViewStatistics, plan_given_pose, plan_pose
from oneframe.poses.distributions import ReferencePose, Shell
from oneframe.poses.pose_file import listed_poses, read_frame_poses, read_pose, read_poses
from oneframe.transforms import camera_centre, inverse_rigid, rigid, rotation_from_vector, rotation_vector
from tests.poses.test_distributions import ks_distance

COUNT = 1500
KS_BOUND = np.sqrt(np.log(2 / 1e-6) / (2 * COUNT))
PIVOT = np.array([2.0, -1.0, 5.0])
SHELL = Shell(reference=ReferencePose(rigid(translation=[3.0, -2.0, 100.0]), PIVOT), distance_min=1, distance_max=2)
DISTANCE = SHELL.reference.distance_mm
GIVEN_FROM_MODEL = rigid(translation=[10.0, -20.0, 300.0])


def probe(cam_from_model):
    """A surface that is the point PIVOT, its front towards +x: observed from x > 0, large from near."""
    offset = camera_centre(cam_from_model) - PIVOT
    distance = np.linalg.norm(offset)
    return ViewStatistics(
        surface_fraction=DISTANCE / distance, observed_fraction=float(offset[0] > 0), clearance_mm=distance
    )


def test_accepted_poses_follow_the_conditional_distribution():
    constraints = Constraints(min_surface=1 / 1.9, min_observed=0.5, min_clearance_mm=1.3 * DISTANCE)
    planned = [plan_pose(SHELL, constraints, probe, seed=4, index=index) for index in range(COUNT)]
    offset = (camera_centre(np.stack([plan.cam_from_model for plan in planned])) - PIVOT) / DISTANCE
    radius = np.linalg.norm(offset, axis=1)

    def volume_between(inner, outer):
        return lambda values: np.clip((values**3 - inner**3) / (outer**3 - inner**3), 0, 1)

    assert ks_distance(radius, volume_between(1.3, 1.9)) < KS_BOUND
    assert ks_distance(radius, volume_between(1, 2)) > 2 * KS_BOUND
    assert ks_distance(offset[:, 0] / radius, lambda values: np.clip(values, 0, 1)) < KS_BOUND
    assert ks_distance(offset[:, 1] / radius, lambda values: np.clip((values + 1) / 2, 0, 1)) < KS_BOUND

    # attempts are geometric, with the acceptance probability that the shell's volume gives
    accepted = (1.9**3 - 1.3**3) / 7 / 2
    attempts = np.array([plan.attempts for plan in planned])
    assert abs(attempts.mean() * accepted - 1) < 5 * np.sqrt((1 - accepted) / COUNT)
    assert abs((attempts == 1).mean() - accepted) < 5 * np.sqrt(accepted * (1 - accepted) / COUNT)
    rejected = attempts.sum() - COUNT
    for reason, probability in (("observed", 0.5), ("clearance", (1.3**3 - 1) / 7), ("surface", (8 - 1.9**3) / 7)):
        share = sum(getattr(plan.rejections, reason) for plan in planned) / rejected
        assert abs(share - probability / (1 - accepted)) < 5 * np.sqrt(0.25 / rejected)


def test_plan_depends_on_seed_and_index_only_and_keeps_the_statistics():
    constraints = Constraints(min_observed=1)
    plans = {index: plan_pose(SHELL, constraints, probe, seed=4, index=index) for index in (5, 0, 3)}
    again = plan_pose(SHELL, constraints, probe, seed=4, index=3)
    assert np.array_equal(again.cam_from_model, plans[3].cam_from_model)
    assert (again.attempts, again.rejections) == (plans[3].attempts, plans[3].rejections)
    assert again.statistics == probe(again.cam_from_model)
    assert not np.array_equal(plans[0].cam_from_model, plans[5].cam_from_model)
    free = plan_pose(SHELL, Constraints(), probe, seed=4, index=7)
    assert free.attempts == 1
    assert np.array_equal(free.cam_from_model, SHELL.draw(np.random.default_rng([4, 7])))


def test_impossible_constraints_end_with_counts():
    tried = []

    def counting_probe(cam_from_model):
        tried.append(probe(cam_from_model))
        return tried[-1]

    constraints = Constraints(min_surface=0.6, min_clearance_mm=5000, max_attempts=200)
    with pytest.raises(InputError, match=r"^view 17: .*lower min_clearance_mm") as caught:
        plan_pose(SHELL, constraints, counting_probe, seed=0, index=17)
    assert len(tried) == 200
    far = sum(each.surface_fraction < 0.6 for each in tried)
    assert f"the best: {max(each.clearance_mm for each in tried):.3g} mm" in str(caught.value)
    assert f"{far} showed less than 60 %" in str(caught.value)


def test_statistics_on_the_limit_pass_and_nan_does_not():
    constraints = Constraints(min_surface=0.25, min_observed=0.5, min_clearance_mm=10)
    assert constraints.broken_by(ViewStatistics(0.25, 0.5, 10)) == Rejections()
    below = np.nextafter([0.25, 0.5, 10], 0)
    assert constraints.broken_by(ViewStatistics(*below)) == Rejections(1, 1, 1)
    assert constraints.broken_by(ViewStatistics(0.3, np.nan, 20)) == Rejections(observed=1)
    # a surface that fills a fifth of the frame is not asked to fill a quarter of a view
    small = Constraints(min_surface=0.25, reference_surface=0.2)
    assert not small.broken_by(ViewStatistics(0.05, 0, 0))
    assert small.broken_by(ViewStatistics(np.nextafter(0.05, 0), 0, 0)) == Rejections(surface=1)


def test_given_poses_are_kept_with_the_constraints_that_they_break():
    poses = np.stack([SHELL.draw(np.random.default_rng([1, index])) for index in range(40)])
    constraints = Constraints(min_observed=0.8, min_clearance_mm=1.5 * DISTANCE)
    planned = [plan_given_pose(pose, constraints, probe) for pose in poses]
    assert np.array_equal(np.stack([plan.cam_from_model for plan in planned]), poses)
    unobserved = [index for index, pose in enumerate(poses) if probe(pose).observed_fraction < 0.8]
    near = [index for index, pose in enumerate(poses) if probe(pose).clearance_mm < 1.5 * DISTANCE]
    assert 0 < len(unobserved) < 40
    assert [plan.rejections for plan in planned] == [
        Rejections(observed=int(index in unobserved), clearance=int(index in near)) for index in range(40)
    ]


def some_poses(count=5):
    rng = np.random.default_rng(6)
    return np.stack([rigid(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3) * 90) for _ in range(count)])


@pytest.mark.parametrize(
    ("dtype", "key"), [("<f8", "cam_from_mesh"), ("<f4", "cam_from_mesh"), (">f8", None), ("<i4", None)]
)
def test_json_and_npy_of_any_number_type_give_the_same_poses(tmp_path, dtype, key):
    poses = some_poses().astype(dtype)
    if dtype == "<i4":
        poses = np.array([[[0, 0, 1, 2], [1, 0, 0, -3], [0, 1, 0, 4], [0, 0, 0, 1]]])
    np.save(tmp_path / "poses.npy", np.asfortranarray(poses.astype(dtype)))
    stored = [{key: pose.tolist(), "note": 1} if key else pose.tolist() for pose in poses]
    (tmp_path / "poses.JSON").write_text(json.dumps(stored), encoding="utf-8-sig")
    np.save(tmp_path / "one.npy", poses[0])
    (tmp_path / "one.json").write_text(json.dumps(stored[0]))
    expected = poses.astype(float)
    expected[:, :3, 3] *= 1000
    for name, count in (("poses.npy", len(poses)), ("poses.JSON", len(poses)), ("one.npy", 1), ("one.json", 1)):
        read, _ = read_poses(tmp_path / name, mesh_from_model=GIVEN_FROM_MODEL, mm_per_unit=1000)
        assert read.dtype == np.float64
        # of the rotations in single precision, which are made exact
        atol = 1e-6 if dtype == "<f4" else 1e-12
        np.testing.assert_allclose(read @ inverse_rigid(GIVEN_FROM_MODEL), expected[:count], rtol=1e-12, atol=atol)


class Malicious:
    """Makes a folder when it is unpickled."""

    def __reduce__(self):
        return os.mkdir, ("executed",)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (some_poses()[:, :3], r"expected shape \(N, 4, 4\)"),
        (some_poses().astype(complex), "real numbers"),
        (some_poses() @ np.diag([1, 1, -1, 1]), "pose 0 .*reflection"),
        (np.swapaxes(some_poses(), 1, 2), "pose 0 .*last row"),
        (np.array([Malicious()], dtype=object), "never loaded"),
    ],
)
def test_arrays_that_are_not_poses_are_refused_and_never_executed(tmp_path, monkeypatch, array, message):
    monkeypatch.chdir(tmp_path)
    np.save(tmp_path / "bad.npy", array, allow_pickle=True)
    with pytest.raises(InputError, match=message):
        read_poses(tmp_path / "bad.npy", mesh_from_model=np.eye(4))
    assert [path.name for path in tmp_path.iterdir()] == ["bad.npy"]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("bad.json", "[]", "empty list"),
        ("bad.json", "3", "expected a list of poses"),
        ("bad.json", '[{"pose": 1}]', "pose 0 .*expected the key cam_from_mesh"),
        ("bad.json", json.dumps([np.eye(4).tolist(), np.diag([1.0, 1, 1, 9]).tolist()]), "pose 1 .*last row"),
        ("bad.txt", "a b", "found words"),
    ],
)
def test_text_that_is_not_poses_is_refused(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message):
        read_poses(tmp_path / name, mesh_from_model=np.eye(4))


def test_frames_without_a_pose_are_told_in_three_ways(tmp_path):
    poses = some_poses()
    shown = [0, 2, 3]
    array = np.full((len(poses), 4, 4), np.nan)
    array[shown] = poses[shown]
    np.save(tmp_path / "poses.npy", array)
    listed = [pose.tolist() if number in shown else None for number, pose in enumerate(poses)]
    (tmp_path / "list.json").write_text(json.dumps(listed))
    keyed = [{"frame": number, "cam_from_mesh": poses[number].tolist()} for number in reversed(shown)]
    (tmp_path / "keyed.json").write_text(json.dumps(keyed))
    for name in ("poses.npy", "list.json", "keyed.json"):
        found, messages = read_frame_poses(
            tmp_path / name, len(poses), mesh_from_model=rigid(translation=np.array([1.0, 2, 3])), mm_per_unit=1000.0
        )
        assert messages == []
        assert [number for number, pose in enumerate(found) if pose is not None] == shown
        for number in shown:
            expected = poses[number].copy()
            expected[:3, 3] *= 1000
            np.testing.assert_allclose(found[number], expected @ rigid(translation=np.array([1.0, 2, 3])), atol=1e-9)


ONE = np.eye(4).tolist()


@pytest.mark.parametrize(
    ("listed", "message"),
    [
        ([ONE] * 3, "for each of the 4 frames of the video, found 3"),
        ([None] * 4, "for some of the 4 frames, found none"),
        ([ONE, ONE, np.diag([1, 1, 2, 1]).tolist(), ONE], "pose of frame 2 "),
        ([{"frame": 4, "cam_from_mesh": ONE}], "entry 0 .*frame = 0 to 3"),
        ([{"frame": 1, "cam_from_mesh": ONE}] * 2, "another one for frame 1"),
        ([{"frame": 1, "cam_from_mesh": ONE}, ONE], "entry 1 .*: expected the key frame"),
        ([{"frame": 1, "image": "1.png", "cam_from_mesh": ONE}], "found an image of a folder; register the video"),
    ],
)
def test_poses_that_do_not_fit_the_frames_are_refused(tmp_path, listed, message):
    (tmp_path / "poses.json").write_text(json.dumps(listed))
    with pytest.raises(InputError, match=message):
        read_frame_poses(tmp_path / "poses.json", 4, mesh_from_model=np.eye(4))


def test_tables_of_bop_and_colmap_give_the_same_photographs(tmp_path):
    poses, scene, cameras, lines = some_poses(), {}, {}, ["# two lines an image"]
    for number, pose in enumerate(poses):
        turn = {"cam_R_m2c": pose[:3, :3].ravel().tolist(), "cam_t_m2c": pose[:3, 3].tolist(), "obj_id": 5}
        scene[str(number)] = [turn] if number else [turn, turn | {"obj_id": 6}]
        cameras[str(number)] = {"cam_K": [900 + number, 0, 9, 0, 900, 9, 0, 0, 1]}
        vector = rotation_vector(pose[:3, :3])
        half = np.linalg.norm(vector) / 2
        quaternion = [np.cos(half), *(np.sin(half) / (2 * half) * vector)]
        lines += [
            f"{number + 1} {' '.join(map(repr, map(float, [*quaternion, *pose[:3, 3]])))} 1 an image {number}.png",
            "",
        ]
    for name, content in (("scene_gt", scene), ("scene_camera", cameras)):
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    (tmp_path / "images.txt").write_text("\n".join(lines))
    for name in ("scene_gt.json#/5", "images.txt"):
        read, messages = read_poses(tmp_path / name, mesh_from_model=np.eye(4))
        np.testing.assert_allclose(read, poses, atol=1e-9)
        assert messages == []
    for name in ("scene_gt.json#1", "scene_gt.json#1/5", "images.txt#an image 1.png"):
        np.testing.assert_allclose(read_pose(tmp_path / name)[0], poses[1], atol=1e-9)
    assert listed_poses(tmp_path / "scene_camera.json#2")[0]["camera"] == "scene_camera.json#2"
    (tmp_path / "short.txt").write_text("\n".join(line for line in lines if line))
    (tmp_path / "long.txt").write_text(f"1 1e308 {' '.join(lines[1].split()[2:])}")
    scene["1"] *= 2
    (tmp_path / "twice.json").write_text(json.dumps(scene))
    for name, message in (
        ("scene_gt.json", "image 0: expected one object, found 2; write which after #: scene_gt.json#/OBJECT"),
        ("scene_gt.json#1/7", "image or object that # names, found none"),
        ("images.txt#an image 1.png", "expected --units mm or m"),
        ("short.txt", "expected two lines for each image"),
        ("long.txt", "expected ten words in each image's line"),
        ("twice.json#1/5", "image 1: expected one object, found 2; keep one of them"),
    ):
        with pytest.raises(InputError, match=message):
            read_pose(tmp_path / name, mm_per_unit=None)
