"""Which landmark a pick belongs to; ellipses of covariances."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from oneframe.alignment.manual.picking import is_unfinished, landmark_for, new_name
from oneframe.alignment.pose_uncertainty import ellipse_outlines
from oneframe.case.landmarks import Landmark

VALUES = {"point": (1.0, 2.0, 3.0), "pixel": (4.0, 5.0)}


def pick(landmarks, active, half):
    """What the add-on does with a pick."""
    index = landmark_for(half, landmarks, active)
    if index is None:
        landmarks.append(Landmark(new_name(landmarks), None, None))
        index = len(landmarks) - 1
    old = landmarks[index]
    assert getattr(old, half) is None
    values = {"point": old.point, "pixel": old.pixel, half: VALUES[half]}
    landmarks[index] = Landmark(old.name, values["point"], values["pixel"], old.enabled)
    return index


@given(st.lists(st.sampled_from(["point", "pixel"]), max_size=20), st.data())
def test_equal_numbers_of_both_kinds_of_picks_in_any_order_make_pairs(halves, data):
    surplus = halves.count("point") - halves.count("pixel")
    halves = halves + ["pixel" if surplus > 0 else "point"] * abs(surplus)
    landmarks, active = [], 0
    for half in halves:
        active = pick(landmarks, active, half)
        if data.draw(st.booleans()):
            # the user selects another row of the list in between
            active = data.draw(st.integers(0, len(landmarks) - 1))
    assert len(landmarks) == len(halves) // 2
    assert all(landmark.point and landmark.pixel for landmark in landmarks)
    assert len({landmark.name for landmark in landmarks}) == len(landmarks)
    assert is_unfinished(landmarks) == (len(landmarks) < 4)


@given(st.lists(st.floats(-3, 3), min_size=4, max_size=4), st.floats(0.1, 10))
def test_an_ellipse_is_where_the_distance_by_the_covariance_is_the_scale(values, scale):
    root = np.array(values).reshape(2, 2) + 4 * np.eye(2)
    # the inverse below needs a regular covariance
    assume(abs(np.linalg.det(root)) > 0.01)
    covariance = root @ root.T
    outline = ellipse_outlines(covariance[None], scale)[0]
    distance = np.sqrt(np.einsum("ni,ij,nj->n", outline, np.linalg.inv(covariance), outline))
    assert np.allclose(distance, scale, rtol=1e-8)
    # of too few pairs: nothing to draw, and no warning of NumPy
    with np.errstate(invalid="raise"):
        assert not np.isfinite(ellipse_outlines(covariance[None], np.inf)).any()
