"""Rejection keeps the conditional distribution and ends; explicit lists are read exactly or refused."""

import io
import json
import os

import numpy as np
import pytest

from oneframe.errors import InputError
from oneframe.poses.constraints import Constraints, Rejections, ViewStatistics, plan_given_poses, plan_pose
from oneframe.poses.distributions import ReferencePose, Shell
from oneframe.poses.pose_file import read_frame_poses, read_poses
from oneframe.transforms import camera_centre, inverse_rigid, rigid, rotation_from_vector

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


def ks_distance(values, distribution_function):
    expected = distribution_function(np.sort(values))
    steps = np.arange(len(values) + 1) / len(values)
    return max((steps[1:] - expected).max(), (expected - steps[:-1]).max())


# --- rejection ----------------------------------------------------------------------------------------------------


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
        tried.append(cam_from_model)
        return probe(cam_from_model)

    constraints = Constraints(min_surface=0.6, min_clearance_mm=5000, max_attempts=200)
    with pytest.raises(InputError) as caught:
        plan_pose(SHELL, constraints, counting_probe, seed=0, index=17)
    assert len(tried) == 200
    best = max(probe(pose).clearance_mm for pose in tried)
    far = sum(probe(pose).surface_fraction < 0.6 for pose in tried)
    message = str(caught.value)
    assert message.startswith("view 17: found no pose")
    assert f"of 200 poses tried, 200 came nearer than 5000 mm to the surface (the best: {best:.3g} mm)" in message
    assert f"{far} showed less than 60 % of the surface that the frame shows" in message
    assert "lower min_clearance_mm, which" in message
    assert "observed" not in message


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


def test_given_poses_are_kept_and_those_that_break_constraints_are_reported():
    poses = np.stack([SHELL.draw(np.random.default_rng([1, index])) for index in range(40)])
    constraints = Constraints(min_observed=0.8, min_clearance_mm=1.5 * DISTANCE)
    planned, messages = plan_given_poses(poses, constraints, probe)
    assert np.array_equal(np.stack([plan.cam_from_model for plan in planned]), poses)
    unobserved = [index for index, pose in enumerate(poses) if probe(pose).observed_fraction < 0.8]
    near = [index for index, pose in enumerate(poses) if probe(pose).clearance_mm < 1.5 * DISTANCE]
    assert 0 < len(unobserved) < 40
    assert [plan.rejections for plan in planned] == [
        Rejections(observed=int(index in unobserved), clearance=int(index in near)) for index in range(40)
    ]
    assert len(messages) == 2
    assert f"{len(unobserved)} of 40 poses" in messages[0]
    assert "(min_observed = 0.8)" in messages[0]
    assert f"first is pose {unobserved[0]} " in messages[0]
    assert f"{len(near)} of 40 poses came nearer" in messages[1]
    assert plan_given_poses(poses, Constraints(), probe)[1] == []


# --- explicit lists -----------------------------------------------------------------------------------------------


def some_poses(count=5):
    rng = np.random.default_rng(6)
    return np.stack([rigid(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3) * 90) for _ in range(count)])


def as_objects(key):
    return lambda poses: [{key: pose.tolist(), "note": 1} for pose in poses]


@pytest.mark.parametrize(
    "stored",
    [
        lambda poses: poses.tolist(),
        as_objects("cam_from_mesh"),
        as_objects("cam_from_model"),
    ],
)
def test_json_and_npy_give_the_same_poses(tmp_path, stored):
    poses = some_poses()
    np.save(tmp_path / "poses.npy", poses)
    (tmp_path / "poses.JSON").write_text(json.dumps(stored(poses)), encoding="utf-8-sig")
    from_npy, messages = read_poses(tmp_path / "poses.npy", mesh_from_model=GIVEN_FROM_MODEL)
    from_json, _ = read_poses(str(tmp_path / "poses.JSON"), mesh_from_model=GIVEN_FROM_MODEL)
    assert messages == []
    assert np.allclose(from_npy @ inverse_rigid(GIVEN_FROM_MODEL), poses, rtol=0, atol=1e-12)
    assert np.allclose(from_json, from_npy, rtol=0, atol=1e-12)


@pytest.mark.parametrize("dtype", ["<f4", ">f8", "<i4"])
def test_metres_single_poses_and_other_number_types(tmp_path, dtype):
    pose = np.array([[0, 0, 1, 2], [1, 0, 0, -3], [0, 1, 0, 4], [0, 0, 0, 1]])
    for stored in (pose, np.asfortranarray(pose[None])):
        np.save(tmp_path / "one.npy", stored.astype(dtype))
        read, _ = read_poses(tmp_path / "one.npy", mesh_from_model=np.eye(4), mm_per_unit=1000)
        expected = pose.astype(float)
        expected[:3, 3] *= 1000
        assert read.dtype == np.float64
        assert np.array_equal(read, expected[None])
    for stored in (pose.tolist(), {"cam_from_mesh": pose.tolist()}):
        (tmp_path / "one.json").write_text(json.dumps(stored))
        read, _ = read_poses(tmp_path / "one.json", mesh_from_model=np.eye(4), mm_per_unit=1000)
        assert np.array_equal(read, expected[None])


def test_rounded_rotations_are_made_exact_and_reported_once(tmp_path):
    np.save(tmp_path / "rounded.npy", some_poses().round(4))
    poses, messages = read_poses(tmp_path / "rounded.npy", mesh_from_model=np.eye(4))
    rotation = poses[:, :3, :3]
    assert np.abs(rotation @ np.swapaxes(rotation, 1, 2) - np.eye(3)).max() < 1e-12
    assert len(messages) == 2
    assert messages[0].startswith("rounded.npy: pose 0 (counted from 0): rotation off by ")
    assert messages[1] == "rounded.npy: the rotations of 4 other poses were corrected too"


def broken(index, change):
    poses = some_poses()
    change(poses[index])
    return poses


def reflect(pose):
    pose[1, :3] *= -1


def transpose(pose):
    pose[:] = pose.T.copy()


BAD_POSES = [(broken(3, reflect), "pose 3 .*reflection"), (broken(1, transpose), "pose 1 .*last row")]


@pytest.mark.parametrize(("poses", "message"), BAD_POSES)
def test_poses_that_are_not_rigid_are_refused_by_index(tmp_path, poses, message):
    np.save(tmp_path / "bad.npy", poses)
    (tmp_path / "bad.json").write_text(json.dumps(poses.tolist()))
    for name in ("bad.npy", "bad.json"):
        with pytest.raises(InputError, match=f"{name}: {message}"):
            read_poses(tmp_path / name, mesh_from_model=np.eye(4))


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.empty((0, 4, 4)), "found an empty list"),
        (some_poses()[:, :3], r"expected shape \(N, 4, 4\) or \(4, 4\), found \(5, 3, 4\)"),
        (some_poses().astype(complex), "real numbers, found type complex128"),
    ],
)
def test_arrays_that_are_not_poses_are_refused(tmp_path, array, message):
    np.save(tmp_path / "bad.npy", array)
    with pytest.raises(InputError, match=message):
        read_poses(tmp_path / "bad.npy", mesh_from_model=np.eye(4))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "found an empty list"),
        ("3", "expected a list of poses, found float"),
        ("[" * 100_000, "expected JSON"),
        ('[{"pose": 1}]', "pose 0 .*expected the key cam_from_mesh, found pose"),
        (json.dumps([np.eye(4).tolist(), np.diag([1.0, 1, 1, 9]).tolist()]), "pose 1 .*last row"),
        (json.dumps([np.eye(4).tolist()]).replace("0.0", "1" + "0" * 400, 1), "pose 0 .*finite"),
    ],
)
def test_json_that_is_not_poses_is_refused(tmp_path, text, message):
    (tmp_path / "bad.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=message):
        read_poses(tmp_path / "bad.json", mesh_from_model=np.eye(4))


@pytest.mark.parametrize(
    ("name", "mm_per_unit", "message"),
    [
        ("none.npy", 1, "none.npy: expected a list of poses, it does not exist; correct the path"),
        ("poses.txt", 1, r"\.npy or \.json file, found extension '.txt'"),
        ("none.npy", 0, "positive number of mm per unit of the poses, found 0"),
    ],
)
def test_wrong_files_and_units_are_refused(tmp_path, name, mm_per_unit, message):
    with pytest.raises(InputError, match=message):
        read_poses(tmp_path / name, mesh_from_model=np.eye(4), mm_per_unit=mm_per_unit)


class Malicious:
    """Makes a folder when it is unpickled."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return os.mkdir, (self.path,)


def object_array(payload):
    stream = io.BytesIO()
    np.save(stream, np.array([payload], dtype=object), allow_pickle=True)
    return stream.getvalue()


def test_pickles_are_refused_and_never_executed(tmp_path):
    trace = tmp_path / "executed"
    (tmp_path / "evil.npy").write_bytes(object_array(Malicious(trace)))
    with pytest.raises(InputError, match="never loaded"):
        read_poses(tmp_path / "evil.npy", mesh_from_model=np.eye(4))
    assert not trace.exists()


def test_damaged_npy_files_give_an_input_error_or_poses(tmp_path):
    np.save(tmp_path / "p.npy", some_poses(3))
    whole = (tmp_path / "p.npy").read_bytes()
    rng = np.random.default_rng(2)
    refused = 0
    for _ in range(300):
        data = bytearray(whole)
        for position in rng.integers(0, 128, 2):
            data[position] = rng.choice(list(b"(),'{}0123456789-:\xff"))
        (tmp_path / "p.npy").write_bytes(data[: rng.choice([len(data), rng.integers(0, len(data))])])
        try:
            read_poses(tmp_path / "p.npy", mesh_from_model=np.eye(4))
        except InputError:
            refused += 1
    assert refused > 200


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
        ([ONE] * 3, "expected a pose for each of the 4 frames of the video, found 3; write null"),
        ([None] * 4, "expected a pose for some of the 4 frames, found none"),
        ([ONE, ONE, np.diag([1, 1, 2, 1]).tolist(), ONE], "pose of frame 2 .*deviates from orthonormal"),
        ([{"frame": 4, "cam_from_mesh": ONE}], "entry 0 .*: expected frame = 0 to 3, found 4"),
        ([{"frame": 1, "cam_from_mesh": ONE}] * 2, "expected one pose for each frame, found another one for frame 1"),
        ([{"frame": 1, "cam_from_mesh": ONE}, ONE], "entry 1 .*: expected the key frame"),
    ],
)
def test_poses_that_do_not_fit_the_frames_are_refused(tmp_path, listed, message):
    (tmp_path / "poses.json").write_text(json.dumps(listed))
    with pytest.raises(InputError, match=message):
        read_frame_poses(tmp_path / "poses.json", 4, mesh_from_model=np.eye(4))
    if isinstance(listed, list) and listed and isinstance(listed[0], list) and len(listed) != 4:
        np.save(tmp_path / "poses.npy", np.array(listed))
        with pytest.raises(InputError, match=message):
            read_frame_poses(tmp_path / "poses.npy", 4, mesh_from_model=np.eye(4))
