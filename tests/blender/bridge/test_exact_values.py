"""Arrays on Blender data come back bit by bit: from memory, from an undo step and from a .blend file."""

import bpy
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from oneframe.blender.bridge.data_blocks import exact, set_exact

FINITE = st.floats(allow_nan=False, allow_infinity=False)
ARRAYS = arrays(np.float64, array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4), elements=FINITE)
MATRIX = np.linspace(-1.0, 1.0, 16).reshape(4, 4) / 3


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


@settings(max_examples=5)
@given(several=st.lists(ARRAYS, min_size=1, max_size=20), compressed=st.booleans())
def test_a_saved_file_gives_the_same_bits(tmp_path_factory, several, compressed):
    path = str(tmp_path_factory.getbasetemp() / "exact.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    for number, values in enumerate(several):
        set_exact(holder(), str(number), values)
    bpy.ops.wm.save_as_mainfile(filepath=path, compress=compressed)
    bpy.ops.wm.open_mainfile(filepath=path)
    for number, values in enumerate(several):
        assert_same_bits(exact(holder(), str(number)), values)


def test_an_undo_step_gives_the_same_bits():
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    for number in (1, 2):
        set_exact(holder(), "pose", MATRIX * number)
        bpy.ops.ed.undo_push(message=str(number))
    for step, number in ((bpy.ops.ed.undo, 1), (bpy.ops.ed.redo, 2)):
        assert step() == {"FINISHED"}
        assert_same_bits(exact(holder(), "pose"), MATRIX * number)
