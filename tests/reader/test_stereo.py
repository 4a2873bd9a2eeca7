"""The right eye of each view: where it stands, what it sees, and that it is a dataset and a pack as the left one is."""

import shutil

import numpy as np
import pytest

from oneframe.colour.lens_shading import LensShading
from oneframe.commands.__main__ import dispatch
from oneframe.dataset.stereo import right_from_left
from oneframe.errors import InputError
from oneframe.light.lens_light import LensLight
from oneframe.reader import open_dataset
from oneframe.transforms import camera_centre, transform_points
from tests.tree import tree

pytestmark = pytest.mark.render

EYES = ("--stereo-mm", 8.0)
RENDERED = ("--count", 3, "--engine", "raster", "--float-depth", "--workers", 1)


def oneframe(*words: object) -> int:
    return dispatch([str(word) for word in words])


@pytest.fixture(scope="module")
def case(tmp_path_factory, write_tiny_case):
    return write_tiny_case(tmp_path_factory.mktemp("stereo") / "case")


@pytest.fixture(scope="module")
def pairs(case):
    out = case.parent / "pairs"
    assert oneframe("render", case, "--out", out, *RENDERED, *EYES) == 0
    return out


def test_disparity_is_focal_length_times_distance_of_the_eyes_over_depth(pairs):
    for view in open_dataset(pairs):
        v, u = np.nonzero(view.mask)
        z = view.depth_mm[v, u]
        there = u - view.k[0, 0] * EYES[1] / z
        # what the right eye shows there, between two pixels of the same row, where inverse depths are linear
        left = np.floor(there).astype(int)
        inside = left >= 0
        left, there, z, v = left[inside], there[inside], z[inside], v[inside]
        near, far = (view.right.depth_mm[v, left + step].astype(float) for step in (0, 1))
        shown = (near > 0) & (far > 0)
        inverse = (left + 1 - there)[shown] / near[shown] + (there - left)[shown] / far[shown]
        off = np.abs(1 / inverse - z[shown])
        # on one face; others have an edge between, or are hidden there
        assert (off < 1e-3).mean() > 0.3
        assert np.median(off) < 0.02
        assert len(off) > 500


@pytest.mark.parametrize("distance_mm", [60.0, 300.0])
def test_axes_that_converge_meet_before_both_eyes(distance_mm):
    pose = right_from_left(24.0, distance_mm)
    assert np.linalg.norm(camera_centre(pose)) == pytest.approx(24.0)
    assert camera_centre(pose)[0] > 0
    meeting = np.array([[0.0, 0.0, distance_mm]])
    np.testing.assert_allclose(transform_points(pose, meeting), meeting, atol=1e-9)


def test_the_left_eye_shows_what_a_dataset_without_a_right_one_does_and_shards_make_both(case, pairs, tmp_path):
    assert oneframe("render", case, "--out", tmp_path / "alone", *RENDERED) == 0
    for one, other in zip(open_dataset(pairs), open_dataset(tmp_path / "alone"), strict=True):
        assert (one.rgb == other.rgb).all()
        assert (one.depth_mm == other.depth_mm).all()
        assert (one.cam_from_model == other.cam_from_model).all()
    # processes of the right eye work within the left eye's dataset
    for words in (("--shard=1/2", "--workers=2"), ("--shard=0/2",), ("--shard=0/1",)):
        assert oneframe("render", case, "--out", tmp_path / "shards", *RENDERED, *EYES, *words) == 0
    assert tree(tmp_path / "shards") == tree(pairs)


def test_both_eyes_are_checked_and_packed(case, pairs, tmp_path, capfd):
    assert oneframe("check", pairs, "--case", case) == 0
    assert capfd.readouterr().out.count("complete and consistent (checked") == 2
    for words in (("pack", pairs), ("pack", "--verify")):
        assert oneframe(*words, "--out", tmp_path / "packed") == 0
    for one, other in zip(open_dataset(tmp_path / "packed"), open_dataset(pairs), strict=True):
        assert (one.right.rgb == other.right.rgb).all()
        assert (one.right.cam_from_model == other.right.cam_from_model).all()


def test_a_right_eye_that_is_missing_or_of_other_views_is_found(case, pairs, tmp_path, capfd):
    """So are a copy of the left eyes, other views, other eyes, fewer of them, and none at all."""
    other = tmp_path / "other"
    assert oneframe("render", case, "--out", other, *RENDERED, "--seed", 5, "--eye=right", *EYES) == 0
    fewer = tmp_path / "fewer"
    assert oneframe("render", case, "--out", fewer, *RENDERED, "--count=2", "--eye=right", *EYES) == 0
    with pytest.raises(InputError, match="expected right eyes in it, found none; render the views with both eyes"):
        _ = open_dataset(other)[0].right
    copy = shutil.copytree(pairs, tmp_path / "pairs")
    for right, message in (
        (pairs, "options.eye was"),
        (other, "options.seed was 5, is 0"),
        (fewer, "2 right eyes of 3 views"),
        (None, "right/dataset.json does not exist"),
    ):
        shutil.rmtree(copy / "right")
        if right is not None:
            shutil.copytree(right, copy / "right", ignore=shutil.ignore_patterns("right"))
        capfd.readouterr()
        assert oneframe("check", copy) == 1
        assert message in capfd.readouterr().out
    with pytest.raises(InputError, match=r"right/dataset\.json does not exist"):
        oneframe("pack", copy, "--out", tmp_path / "packed")
    shutil.copytree(other, copy / "right")
    with pytest.raises(InputError, match=r"right eyes of these views: options\.seed was 5, is 0"):
        _ = open_dataset(copy)[0].right


def test_both_eyes_see_the_surface_by_the_lamp_of_the_left_one(oblique_pose):
    lens, beside = LensShading(LensLight((30.0, -20.0, -5.0), 0.1), 0.1), right_from_left(24.0, 300.0)
    (left, _), (right, _) = lens.at(oblique_pose), lens.moved(beside).at(beside @ oblique_pose)
    np.testing.assert_allclose(right.place_model(beside @ oblique_pose), left.place_model(oblique_pose), atol=1e-9)
