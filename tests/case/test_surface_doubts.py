"""A plausible size is told from one in the wrong unit, and a structure in place from one of another frame."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.surface_doubts import place_doubt, size_doubt

CAMERAS = {
    "none": None,
    "microscope": PinholeCamera(1920, 1080, 12800.0, 12800.0, 959.5, 539.5),
    "webcam": PinholeCamera(640, 480, 572.4, 573.6, 325.3, 242.0),
}
sides = st.tuples(*[st.floats(0.05, 1)] * 3).map(lambda ratios: np.array(ratios) / max(ratios))


@pytest.mark.parametrize("camera", CAMERAS)
@given(longest_mm=st.floats(3, 900), ratios=sides)
def test_metres_and_millimetres_are_not_confused(camera, longest_mm, ratios):
    """Surfaces of 3 mm to 0.9 m: no doubt in their unit, and the right one is proposed in the other."""
    extents = longest_mm * ratios
    assert size_doubt(extents, "mm", CAMERAS[camera], "bone.ply") is None
    as_small = size_doubt(extents / 1000, "mm", CAMERAS[camera], "bone.ply")
    as_large = size_doubt(extents * 1000, "m", CAMERAS[camera], "bone.ply")
    assert [doubt and doubt.better_units for doubt in (as_small, as_large)] == ["m", "mm"]


SURFACE = np.array([[20.0, -60.0, 900.0], [70.0, -10.0, 950.0]])
inside = st.tuples(*(st.floats(low, high - 8) for low, high in SURFACE.T))


@given(inside, st.floats(0.5, 8))
def test_the_change_that_puts_it_right_is_named(corner, size):
    box = np.array([corner, np.add(corner, size)])
    assert place_doubt(box, SURFACE, "nerve", "bone") is None
    flipped = np.sort(box * [-1, -1, 1], axis=0)
    assert "from RAS to LPS" in place_doubt(flipped, SURFACE, "nerve", "bone.ply")
    assert "in metres it would be in place" in place_doubt(box / 1000, SURFACE, "nerve", "bone.ply")
    assert "in millimetres it would be in place" in place_doubt(box * 1000, SURFACE, "nerve", "bone.ply")
    doubt = place_doubt(box + np.array([0, 0, 500]), SURFACE, "nerve", "bone.ply")
    assert doubt.startswith("nerve: its middle lies ")
    assert "would be" not in doubt
