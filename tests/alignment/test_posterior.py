"""One posterior from landmarks and image: laws of the fusion, coverage of the truth, and the next click."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from oneframe.alignment.landmarks.align_landmarks import align_landmarks
from oneframe.alignment.landmarks.degeneracy import UndeterminedPose
from oneframe.alignment.pose_uncertainty import PoseEvidence, PoseMode, PoseUncertainty
from oneframe.alignment.posterior.next_click import CORNER_PX, WIDTH_PX, corners_in_view, gains_px2, next_click
from oneframe.alignment.posterior.solve import joint_dof, pose_posterior, pulls_px
from oneframe.alignment.reprojection import apply_twist, jacobian_at, twist_between
from oneframe.case.landmarks import Landmark
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import rigid, rotation_angle_deg, rotation_from_vector, transform_points
from scripts.benchmarks.alignment.landmark_trials import MICROSCOPE, box_trial
from tests.conftest import grid_mesh

DEVIATIONS = np.array([0.05, 0.05, 0.6, 0.004, 0.004, 0.003])
"""Of an image's pose: mm and radians, at a microscope's distance."""


def image_evidence(rng, pose, *, true_dof=np.inf, deviations=DEVIATIONS):
    """A refined pose whose stated covariance has the right mean and an estimated scale."""
    turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    root = np.diag(deviations) @ turn @ np.diag([0.5, 0.7, 1, 1, 1.3, 1.5])
    scale = rng.chisquare(true_dof) / true_dof if np.isfinite(true_dof) else 1.0
    stated = PoseUncertainty(np.zeros(3), scale * root @ root.T, true_dof, np.nan, 10.0, pose[:3, 3])
    return PoseEvidence(apply_twist(root @ rng.normal(size=6), pose, np.zeros(3)), stated)


def as_landmarks(trial, chosen=slice(None)):
    both = zip(trial.points_model[chosen], trial.pixels[chosen], strict=True)
    return [
        Landmark(str(number), tuple(map(float, point)), tuple(map(float, pixel)))
        for number, (point, pixel) in enumerate(both)
    ]


def solved(landmarks, image=None, sigma_px=2.0):
    return pose_posterior(landmarks, MICROSCOPE, image, click_sigma_px=sigma_px).estimate


def test_degrees_of_freedom_add_where_covariances_do():
    assert joint_dof(np.full((2, 6), 0.5), [6.0, 6.0]) == 12.0
    assert joint_dof(np.array([[1.0, 0.0], [0.0, 1.0]]), [3.0, 6.0]) == pytest.approx(4.0)


def test_a_kind_left_out_leaves_the_others():
    rng = np.random.default_rng(2)
    trial = box_trial(rng, 7, 1.0)
    image, landmarks = image_evidence(rng, trial.cam_from_model), as_landmarks(trial)
    alone = align_landmarks(landmarks, MICROSCOPE, click_sigma_px=2.0).estimate
    assert np.array_equal(solved(landmarks).cam_from_model, alone.cam_from_model)
    assert np.array_equal(solved([], image).cam_from_model, image.cam_from_model)
    # deleting landmarks one by one goes to the image's pose, and each step is between the two
    shifts = [
        np.linalg.norm(
            twist_between(image.cam_from_model, solved(landmarks[:count], image).cam_from_model, np.zeros(3))
        )
        for count in range(8)
    ]
    assert shifts[0] == 0
    assert min(shifts[1:]) > 0
    # the landmarks' own noise sets their weight: exact clicks stay where they are
    exact = as_landmarks(
        replace(trial, pixels=MICROSCOPE.project(transform_points(trial.cam_from_model, trial.points_model)))
    )
    assert solved(exact, image, sigma_px=0.001).cam_from_model == pytest.approx(trial.cam_from_model, abs=1e-3)


def test_pulls_are_the_shifts_without_a_kind():
    rng = np.random.default_rng(3)
    trial = box_trial(rng, 6, 2.0)
    image, landmarks = image_evidence(rng, trial.cam_from_model), as_landmarks(trial)
    found = pose_posterior(landmarks, MICROSCOPE, image, click_sigma_px=2.0)
    pulls = pulls_px(found, image, trial.mesh_points)
    shown = [
        MICROSCOPE.project(transform_points(pose, trial.mesh_points))
        for pose in (found.estimate.cam_from_model, image.cam_from_model, solved(landmarks).cam_from_model)
    ]
    assert pulls == {
        "landmarks": pytest.approx(np.median(np.linalg.norm(shown[1] - shown[0], axis=1))),
        "image": pytest.approx(np.median(np.linalg.norm(shown[2] - shown[0], axis=1))),
    }
    few = pose_posterior(landmarks[:2], MICROSCOPE, image, click_sigma_px=2.0)
    assert pulls_px(few, image, trial.mesh_points)["image"] is None


def test_what_contradicts_is_left_out_the_image_or_a_landmark():
    rng = np.random.default_rng(4)
    trial = box_trial(rng, 8, 1.0)
    image, landmarks = image_evidence(rng, trial.cam_from_model), as_landmarks(trial)
    wrong = replace(
        image, cam_from_model=apply_twist(np.array([0, 0, 0, 0.1, 0, 0]), trial.cam_from_model, np.zeros(3))
    )
    found, alone = solved(landmarks, wrong), solved(landmarks)
    assert np.array_equal(found.cam_from_model, alone.cam_from_model)
    assert "image is left out" in found.messages[0]
    u, v = landmarks[1].pixel
    missed = replace(landmarks[1], pixel=(u + 200, v))
    found = solved([landmarks[0], missed], image)
    assert found.inliers.tolist() == [True, False]
    assert found.cam_from_model == pytest.approx(solved(landmarks[:1], image).cam_from_model, abs=1e-6)


def test_the_image_decides_between_poses_that_fit_the_landmarks():
    rng = np.random.default_rng(1)
    trial = box_trial(rng, 6, 0.0)
    flat = trial.points_model * [1, 1, 0]
    pose = rigid(rotation_from_vector(np.array([0.15, 0.1, 0.1])), [0, 0, 300])
    pixels = MICROSCOPE.project(transform_points(pose, flat)) + rng.normal(scale=2.0, size=(6, 2))
    landmarks = as_landmarks(replace(trial, points_model=flat, pixels=pixels))
    with pytest.raises(UndeterminedPose) as refusal:
        solved(landmarks)
    modes = refusal.value.modes
    assert sum(mode.probability for mode in modes) == pytest.approx(1)
    assert any(mode.uncertainty.contains(pose, mode.cam_from_model) for mode in modes)
    found = solved(landmarks, image_evidence(rng, pose))
    assert rotation_angle_deg(found.cam_from_model[:3, :3] @ pose[:3, :3].T) < 1


@pytest.mark.parametrize(("pairs", "worse"), [(2, 1), (6, 2)])
def test_the_region_of_both_holds_the_truth_as_often_as_it_says(pairs, worse):
    rng, inside, draws = np.random.default_rng(pairs), [], 50
    for _ in range(draws):
        trial = box_trial(rng, pairs, 2.0 * worse)
        image = image_evidence(rng, trial.cam_from_model, true_dof=6.0)
        try:
            found = solved(as_landmarks(trial), image)
            modes = [PoseMode(found.cam_from_model, found.uncertainty, 1.0, found.inliers)]
        except UndeterminedPose as refusal:
            modes = refusal.modes
        inside.append(any(mode.uncertainty.contains(trial.cam_from_model, mode.cam_from_model) for mode in modes))
    spread = 3 * np.sqrt(0.05 * 0.95 / draws)
    assert 0.90 - spread <= np.mean(inside) <= 0.98 + spread


def test_the_next_click_lowers_the_variance_of_the_surface_most():
    rng = np.random.default_rng(6)
    trial = box_trial(rng, 5, 1.0)
    found = solved(as_landmarks(trial))
    mode = PoseMode(found.cam_from_model, found.uncertainty, 1.0, found.inliers)
    points = trial.mesh_points[:60]
    jacobians = jacobian_at(points, MICROSCOPE, found.cam_from_model, found.uncertainty.pivot_model)

    def variance(covariance):
        return np.trace(jacobians @ covariance @ np.swapaxes(jacobians, -1, -2), axis1=1, axis2=2).mean()

    precision = np.linalg.inv(found.uncertainty.covariance)
    after = [variance(np.linalg.inv(precision + each.T @ each / 2.0**2)) for each in jacobians]
    np.testing.assert_allclose(
        variance(found.uncertainty.covariance) - after, gains_px2(points, MICROSCOPE, mode, 2.0), rtol=1e-5
    )
    assert next_click(points, MICROSCOPE, [mode], 2.0) == np.argmin(after)
    # of two modes: where a click tells them apart
    turned = apply_twist(np.array([0, 0, 0, 0.2, 0, 0]), found.cam_from_model, found.uncertainty.pivot_model)
    chosen = next_click(points, MICROSCOPE, [mode, replace(mode, cam_from_model=turned)], 2.0)
    seen = [MICROSCOPE.project(transform_points(pose, points)) for pose in (found.cam_from_model, turned)]
    apart_px = np.linalg.norm(seen[0] - seen[1], axis=1)
    assert apart_px[chosen] > np.quantile(apart_px, 0.9)


def test_the_marked_corners_of_a_box_are_its_own():
    """From all around: each place is at another corner, and at least four of the seven in sight are found."""
    corners = np.array(list(product((-15.0, 15.0), (-10.0, 10.0), (-8.0, 8.0))))
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    box = TriangleMesh(corners, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]).astype(np.int32))
    rng = np.random.default_rng(4)
    for _ in range(20):
        pose = rigid(rotation_from_vector(rng.normal(size=3)), np.array([*rng.normal(size=2), 900.0]))
        seen = MICROSCOPE.project(transform_points(pose, corners_in_view(box, MICROSCOPE, pose)))
        wanted = MICROSCOPE.project(transform_points(pose, corners))
        distance_px = np.linalg.norm(seen[:, None] - wanted, axis=2)
        assert distance_px.min(axis=1).max() < CORNER_PX * MICROSCOPE.width / WIDTH_PX
        assert len(set(distance_px.argmin(axis=1))) == len(seen) >= 4


def test_where_a_surface_is_cut_off_no_corner_is_marked():
    y, x = np.mgrid[-20:21, -20:21]
    sheet = grid_mesh(x, y, 6 * np.exp(-np.maximum(x**2, y**2) / 30.0))
    pose = rigid(rotation_from_vector(np.array([0.3, 0.2, 0.1])), np.array([0.0, 0.0, 900.0]))
    found = corners_in_view(sheet, MICROSCOPE, pose)
    assert len(found) > 0
    assert np.abs(found[:, :2]).max() < 18
