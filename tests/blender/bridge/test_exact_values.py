"""Arrays on Blender data come back bit by bit: from memory, from an undo step and from a .blend file."""

import json

import bpy
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from oneframe.blender.bridge.exact_values import exact, set_exact

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


def test_a_file_from_before_holds_text():
    holder()["pose"] = json.dumps(MATRIX.tolist())
    assert_same_bits(exact(holder(), "pose"), MATRIX)


@pytest.mark.parametrize(
    "other",
    [
        "text", "[[1, 2], [3]]", 1.0, [1.0, 2.0], {}, {"shape": [2], "values": "12"}, {"shape": [2], "values": [1, 2]},
        {"shape": [3], "values": [1.0, 2.0]}, {"shape": "2", "values": [1.0, 2.0]}, {"values": [1.0, 2.0]},
        {"shape": [-1, -1], "values": [1.0, 2.0]},
    ],
    ids=str,
)  # fmt: skip
def test_what_someone_else_has_written_is_no_array(other):
    holder()["pose"] = other
    assert exact(holder(), "pose") is None


def test_what_is_not_there_is_none():
    assert exact(holder(), "nothing") is None
