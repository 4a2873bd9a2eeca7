"""A structure of another frame or unit is doubted, with the change that puts it right; one in place never is."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from oneframe.case.structure_place import place_doubt

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
