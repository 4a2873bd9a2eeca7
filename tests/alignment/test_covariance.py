"""The stated uncertainty: it covers the truth as often as it says, and names the weakest direction."""

import numpy as np
import pytest
from scipy.special import fdtri

from oneframe.alignment.landmarks.covariance import REGION_PRIOR_DOF, NoiseEstimate
from oneframe.alignment.landmarks.solver import solve_pose
from oneframe.alignment.pose_uncertainty import PoseUncertainty
from oneframe.alignment.reprojection import apply_twist
from oneframe.camera.pinhole import PinholeCamera
from oneframe.transforms import nearest_rotation, rigid, transform_points
from scripts.benchmarks.alignment.landmark_trials import MICROSCOPE, box_trial

WIDE = PinholeCamera(1000, 800, 700.0, 690.0, 480.0, 410.0)


def uncertainty(covariance, pivot_cam=(0, 0, 300.0), dof=20.0):
    return PoseUncertainty(np.array([3.0, -2, 5]), covariance, dof, 2.0, 10.0, np.array(pivot_cam, float))


# --- covariance ------------------------------------------------------------------------------------------------------


def test_the_covariance_is_the_scatter_of_the_poses():
    """For repeated clicks on the same pairs; the bound is that of a sample covariance at about the 1e-4 level."""
    rng, draws = np.random.default_rng(1), 100
    trial = box_trial(rng, 12, 0.0)
    estimates = [
        solve_pose(trial.points_model, trial.pixels + rng.normal(size=trial.pixels.shape), MICROSCOPE, click_sigma_px=1)
        for _ in range(draws)
    ]
    stated = np.mean([each.uncertainty.covariance for each in estimates], axis=0)
    twists = []
    for each in estimates:
        change = each.cam_from_model @ np.linalg.inv(trial.cam_from_model)
        pivot = transform_points(trial.cam_from_model, each.uncertainty.pivot_model)
        skew = change[:3, :3] - change[:3, :3].T
        rotation = 0.5 * np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
        twists.append([*(transform_points(change, pivot) - pivot), *rotation])
    scatter = np.cov(np.array(twists).T)
    # whitened by the stated covariance, so that all directions count alike
    root = np.linalg.inv(np.linalg.cholesky(stated))
    assert np.linalg.eigvalsh(root @ scatter @ root.T) == pytest.approx(np.ones(6), abs=5 * np.sqrt(2 / draws))
    assert np.mean([each.uncertainty.sigma_px for each in estimates]) == pytest.approx(1, abs=0.05)


def test_the_region_grows_with_its_level_and_ends_where_it_says():
    rng = np.random.default_rng(4)
    root = rng.normal(size=(6, 6)) * [1, 1, 3, 0.01, 0.01, 0.02]
    found = uncertainty(root.T @ root, dof=7.5)
    pose = rigid(nearest_rotation(rng.normal(size=(3, 3))), [0, 0, 300])
    direction = np.linalg.cholesky(found.covariance) @ rng.normal(size=6)
    direction /= np.sqrt(direction @ np.linalg.solve(found.covariance, direction))
    for level in (0.5, 0.95):
        edge = np.sqrt(6 * fdtri(6, 7.5, level))
        assert found.contains(apply_twist(0.999 * edge * direction, pose, found.pivot_model), pose, level)
        assert not found.contains(apply_twist(1.001 * edge * direction, pose, found.pivot_model), pose, level)


# --- the weakest direction -------------------------------------------------------------------------------------------

NAMES = (
    "shift to the left or right ± 2.1 mm",
    "shift up or down ± 2.1 mm",
    "depth along the view ray ± 2.1 mm",
    "pitch about the image's horizontal axis ± 12°",
    "yaw about the image's vertical axis ± 12°",
    "roll about the view ray ± 12°",
)


@pytest.mark.parametrize(("number", "name"), enumerate(NAMES))
def test_the_weakest_direction_is_named_with_its_size(number, name):
    deviation, deviations = (2.1, np.radians(12.0))[number // 3], np.array([1.0, 1, 1, 0.1, 0.1, 0.1])
    deviations[number] = deviation
    found = uncertainty(np.diag(deviations**2))
    assert found.weakest == name
    weakest = np.zeros(6)
    weakest[number] = deviation
    assert found.weakest_twist == pytest.approx(weakest)
    assert found.translation_mm == pytest.approx(deviations[:3])
    assert found.rotation_deg == pytest.approx(np.degrees(deviations[3:]))


def test_depth_is_along_the_ray_also_off_the_axis():
    ray = np.array([0.6, -0.3, 0.74])
    ray /= np.linalg.norm(ray)
    covariance = 1e-6 * np.eye(6)
    covariance[:3, :3] += 3.0**2 * np.outer(ray, ray)
    found = uncertainty(covariance, pivot_cam=40 * ray)
    assert found.weakest == "depth along the view ray ± 3 mm"
    assert found.weakest_twist[:3] == pytest.approx(3 * ray, abs=1e-3)
    assert found.relative_depth == pytest.approx(3 / 40, rel=1e-3)


# --- in the image ----------------------------------------------------------------------------------------------------


def test_pixel_covariances_are_the_scatter_of_the_pixels():
    rng, draws = np.random.default_rng(6), 4000
    points = (rng.random((5, 3)) - 0.5) * 20
    pose = rigid(nearest_rotation(rng.normal(size=(3, 3))), [3, -2, 60])
    root = rng.normal(size=(6, 6)) * [0.02, 0.02, 0.02, 1e-3, 1e-3, 1e-3]
    found = uncertainty(root.T @ root)
    twists = rng.normal(size=(draws, 6)) @ root
    shown = np.array(
        [WIDE.project(transform_points(apply_twist(twist, pose, found.pivot_model), points)) for twist in twists]
    )
    stated = found.pixel_covariances(points, WIDE, pose)
    assert stated.shape == (5, 2, 2)
    for number in range(5):
        scatter = np.cov(shown[:, number].T)
        ratio = np.linalg.eigvals(np.linalg.solve(stated[number], scatter)).real
        assert ratio == pytest.approx([1, 1], abs=5 * np.sqrt(2 / draws))
    assert uncertainty(np.eye(6), dof=1e6).ellipse_scale() == pytest.approx(np.sqrt(5.991), rel=1e-3)


# --- a wrong stated noise --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pairs", "worse", "least", "most"),
    [
        (4, 1, 0.947, 0.953),
        (10, 1, 0.947, 0.953),
        # clicks twice as bad: as near to 95 % as 2, 6 and 14 degrees of freedom allow
        (4, 2, 0.83, 0.953),
        (6, 2, 0.92, 0.953),
        (10, 2, 0.935, 0.953),
    ],
)
def test_the_region_holds_the_truth_also_with_worse_clicks_than_stated(pairs, worse, least, most):
    """In theory: a deviation of 6 parameters and residuals of 2 N - 6 degrees of freedom, independent of each other."""
    rng, dof, draws = np.random.default_rng(pairs), 2 * pairs - 6, 200_000
    deviation, squared = ((2.0 * worse) ** 2 * rng.chisquare(n, draws) for n in (6, dof))
    region_dof = NoiseEstimate.of(1.0, dof, 2.0, REGION_PRIOR_DOF).region_dof
    variance = np.array([NoiseEstimate.of(each, dof, 2.0, REGION_PRIOR_DOF).variance for each in squared[:3]])
    total = REGION_PRIOR_DOF + dof
    np.testing.assert_allclose(variance, (REGION_PRIOR_DOF * 2.0**2 + squared[:3]) / total)
    inside = deviation / 6 <= fdtri(6, region_dof, 0.95) * (REGION_PRIOR_DOF * 2.0**2 + squared) / total
    assert least <= inside.mean() <= most
