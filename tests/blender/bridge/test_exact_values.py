"""Arrays on Blender data come back bit by bit."""

import bpy
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from oneframe.blender.bridge.data_blocks import exact, set_exact

FINITE = st.floats(allow_nan=False, allow_infinity=False)
ARRAYS = arrays(np.float64, array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4), elements=FINITE)


def assert_same_bits(found: np.ndarray | None, values: np.ndarray) -> None:
    assert found is not None
    assert (found.dtype, found.shape) == (np.float64, values.shape)
    assert found.tobytes() == values.tobytes()


def holder() -> bpy.types.Scene:
    """Any data-block."""
    return bpy.context.scene


@given(values=ARRAYS)
def test_an_array_comes_back_bit_by_bit(values):
    set_exact(holder(), "values", values)
    assert_same_bits(exact(holder(), "values"), values)
