"""Arrays on Blender data come back bit by bit."""

import bpy
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from oneframe.blender.bridge.data_blocks import exact, set_exact

FINITE = st.floats(allow_nan=False, allow_infinity=False)


@given(values=arrays(np.float64, array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4), elements=FINITE))
def test_an_array_comes_back_bit_by_bit(values):
    set_exact(bpy.context.scene, "values", values)
    found = exact(bpy.context.scene, "values")
    assert (found.dtype, found.shape, found.tobytes()) == (np.float64, values.shape, values.tobytes())
