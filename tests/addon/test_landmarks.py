"""Landmarks in the add-on: pose, residuals and messages agree with those of the solver."""

import bpy
import numpy as np
import pytest

from blender_addon.landmarks import solve
from blender_addon.setup.alignment_record import pose_record
from blender_addon.state import from_scene
from blender_addon.state.landmarks import landmarks_mesh, landmarks_model, points_model
from blender_addon.ui import frame_view
from oneframe.alignment.landmarks.solver import solve_pose
from oneframe.alignment.reprojection import apply_twist
from oneframe.blender.alignment.surface_object import set_pose
from oneframe.case.case_file import MM_PER_UNIT
from oneframe.transforms import rotation_from_vector, transform_points
from tests.addon.conftest import refused
from tests.landmark_writer import write_landmarks

POINTS_PX = np.array(
    [[8.2, 7.4], [55.1, 9.3], [50.6, 40.2], [11.7, 38.9], [31.4, 24.8], [42.3, 15.6], [22.8, 12.1], [36.5, 33.3]]
)
SIGMA_PX = 0.2
TWIST = np.array([2.0, -1.5, 6.0, 0.05, -0.04, 0.06])


@pytest.fixture
def scene(opened):
    opened.oneframe.click_sigma_px = SIGMA_PX
    bpy.context.view_layer.update()
    return opened


@pytest.fixture
def pairs(scene):
    """``(8, 3)`` surface points and ``(8, 2)`` pixels of the true pose."""
    return np.array([frame_view.surface_point_at(scene, pixel) for pixel in POINTS_PX]), POINTS_PX.copy()


def pose_of(scene):
    bpy.context.view_layer.update()
    return from_scene.cam_from_model(scene)


def displace(scene, twist=TWIST):
    """Move the surface by a twist; returns its new pose."""
    set_pose(
        from_scene.camera_object_of(scene),
        from_scene.surface_of(scene),
        apply_twist(twist, pose_of(scene), np.zeros(3)),
    )
    return pose_of(scene)


def add(points, pixels):
    """Add landmarks as a user picks them, alternating which point comes first."""
    for number, (point, pixel) in enumerate(zip(points, pixels, strict=True)):
        first, second = ({"point": point}, {"pixel": pixel})[:: -1 if number % 2 else 1]
        assert bpy.ops.oneframe.landmark_set(**first) == {"FINISHED"}
        assert bpy.ops.oneframe.landmark_set(**second) == {"FINISHED"}


def solved_directly(scene, *, without=()):
    """The solver's result for the scene's landmarks."""
    used = [
        landmark
        for number, landmark in enumerate(landmarks_model(scene))
        if landmark.point is not None and landmark.pixel is not None and number not in without
    ]
    return solve_pose(
        np.array([landmark.point for landmark in used]),
        np.array([landmark.pixel for landmark in used]),
        from_scene.camera(scene),
        click_sigma_px=SIGMA_PX,
        names=[landmark.name for landmark in used],
    )


def test_points_in_either_order_pair_and_the_surface_moves_to_the_solution(scene, pairs, rng):
    true = pose_of(scene)
    displace(scene)
    points, pixels = pairs
    add(points, pixels + rng.normal(0, SIGMA_PX, pixels.shape))
    entries = scene.oneframe.landmarks
    assert len(entries) == len(points)
    assert np.allclose(points_model(scene), points, atol=1e-5)
    expected = solved_directly(scene)
    assert np.abs(pose_of(scene) - expected.cam_from_model).max() <= 1e-9
    assert expected.uncertainty.contains(true, pose_of(scene), 0.9999)
    assert np.allclose(solve.solution(scene).estimate.residuals_px, expected.residuals_px, rtol=0, atol=1e-9)
    # a disabled one has no effect
    bpy.ops.oneframe.landmark_toggle(index=2)
    assert np.abs(pose_of(scene) - solved_directly(scene, without=[2]).cam_from_model).max() <= 1e-9


def test_residuals_and_departure_are_those_of_the_current_pose(scene, pairs):
    add(*pairs)
    assert solve.departure_px(scene, solve.solution(scene)) is None
    moved = displace(scene)
    seen = from_scene.camera(scene).project(transform_points(moved, pairs[0]))
    found = solve.residuals_px(scene)
    assert np.allclose([found[index] for index in range(len(seen))], pairs[1] - seen, rtol=0, atol=1e-4)
    away = solve.departure_px(scene, solve.solution(scene))
    assert away == pytest.approx(np.linalg.norm(pairs[1] - seen, axis=1).max(), abs=0.02)
    bpy.ops.oneframe.solve_landmarks()
    assert np.abs(pose_of(scene) - solved_directly(scene).cam_from_model).max() <= 1e-9


def test_flat_points_show_both_poses_and_a_key_goes_from_one_to_the_other(scene):
    true, camera = pose_of(scene), from_scene.camera(scene)
    extent = from_scene.surface_extents(scene).max() / 4
    flat = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (0.3, 0.1, 0)]) * extent
    tilted = rotation_from_vector(np.radians([12.0, -7.0, 0.0]))
    points = transform_points(np.linalg.inv(true), flat @ tilted.T + transform_points(true, np.zeros(3)))
    scene.oneframe.click_sigma_px = 0.5
    add(points, camera.project(transform_points(true, points)))
    solved = solve.solution(scene)
    assert solved.estimate is None
    assert len(solved.doubtful) == 2
    assert sum(solved.probabilities) == pytest.approx(1)
    assert solve.shown_pose(scene, solved) == 0
    for expected in (1, 0):
        bpy.ops.oneframe.other_pose()
        assert np.array_equal(pose_of(scene), solved.doubtful[expected])
        record = pose_record(scene)
        assert record.method == "landmarks"
        assert "2 poses fit" in record.doubt
        # a doubtful pose has no uncertainty of its own
        assert record.standard_deviation_deg is None


def test_pairs_that_no_pose_fits_still_bring_the_surface_near(scene, pairs):
    scene.oneframe.click_sigma_px = 0.05
    far = displace(scene, np.array([20.0, 10, 60, 0.2, -0.2, 1.2]))
    add(pairs[0][:4], pairs[1][:4] + np.array([[3, -2], [-3, 1], [2, 3], [-1, -3]]))
    assert "no pose fits" in solve.solution(scene).refusal
    assert not np.array_equal(pose_of(scene), far)
    assert "no pose fits" in pose_record(scene).doubt
    rough = pose_of(scene)
    bpy.ops.oneframe.landmark_toggle(index=0)
    bpy.ops.oneframe.landmark_toggle(index=0)
    assert np.array_equal(pose_of(scene), rough)


def test_names_of_landmarks_are_unique(scene, pairs):
    add(*pairs)
    entries = scene.oneframe.landmarks
    entries[0].name = "umbo"
    entries[1].name = "umbo"
    entries[2].name = " "
    assert entries[1].name == "umbo.001"
    assert len({entry.name for entry in entries}) == len(entries)
    assert all(entry.name.strip() for entry in entries)


def test_a_landmark_is_deleted_and_a_missing_one_is_refused(scene, pairs):
    add(*pairs)
    names = [entry.name for entry in scene.oneframe.landmarks]
    bpy.ops.oneframe.landmark_remove(index=2)
    assert [entry.name for entry in scene.oneframe.landmarks] == names[:2] + names[3:]
    # without an index the active one is deleted, not that of the last call
    scene.oneframe.landmark_index = 0
    bpy.ops.oneframe.landmark_remove()
    assert [entry.name for entry in scene.oneframe.landmarks] == names[1:2] + names[3:]
    for call in (
        lambda: bpy.ops.oneframe.landmark_remove(index=50),
        lambda: bpy.ops.oneframe.landmark_set(index=50, pixel=(1, 1)),
        lambda: bpy.ops.oneframe.landmark_set(pixel=(640, 10)),
    ):
        refused(call, "expected")
    assert len(scene.oneframe.landmarks) == len(names) - 2
    bpy.ops.oneframe.landmarks_clear()
    assert len(scene.oneframe.landmarks) == 0
    # too few determine no pose, and leave it as it was
    moved = displace(scene)
    add(pairs[0][:3], pairs[1][:3])
    refused(bpy.ops.oneframe.solve_landmarks, "at least 4")
    assert "at least 4" in solve.solution(scene).refusal
    assert np.array_equal(pose_of(scene), moved)


def test_landmarks_of_a_file_are_imported_unchanged(scene, pairs, tmp_path):
    scene.oneframe.units = "m"
    add(*pairs)
    bpy.ops.oneframe.landmark_set(name="half", pixel=(5, 6))
    before = landmarks_mesh(scene)
    path = tmp_path / "pairs.csv"
    write_landmarks(path, before, mm_per_unit=MM_PER_UNIT[scene.oneframe.units])
    bpy.ops.oneframe.landmarks_clear()
    moved = displace(scene)
    bpy.ops.oneframe.import_landmarks(filepath=str(path))
    for one, other in zip(before, landmarks_mesh(scene), strict=True):
        assert (one.name, one.enabled, one.point is None) == (other.name, other.enabled, other.point is None)
        assert np.allclose(one.pixel, other.pixel, atol=1e-5)
        assert one.point is None or np.allclose(one.point, other.point, atol=1e-5)
    assert not np.allclose(pose_of(scene), moved, atol=1e-3)
