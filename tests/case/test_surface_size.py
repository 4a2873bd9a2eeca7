"""A plausible size is told from one in the wrong unit, whatever the camera."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.surface_size import size_doubt

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


def test_the_message_says_what_either_unit_would_mean():
    doubt = size_doubt(np.array([0.083, 0.06, 0.041]), "mm", CAMERAS["microscope"], "bone.ply")
    assert doubt is not None
    assert doubt.message == (
        "bone.ply: the surface is 0.083 x 0.06 x 0.041 mm large if its numbers are millimetres, and fills the frame "
        "from 0.553 mm; in metres it would be 83 x 60 x 41 mm: check the units"
    )
    unusual = size_doubt(np.array([1e-5] * 3), "mm", None, "cell.ply")
    assert unusual is not None
    assert unusual.better_units is None
