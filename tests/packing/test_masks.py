"""Masks as run lengths: every reader gives back the very mask."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from oneframe.dataset.tables.coco import run_lengths
from oneframe.errors import InputError
from oneframe.packing.layout import mask_columns, mask_json

MASKS = arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12)))


@given(mask=MASKS, data=st.data())
def test_masks_come_back_and_damaged_ones_are_a_sentence(mask, data):
    text = mask_json(mask)
    entry = json.loads(text)["0"]
    assert (tuple(entry["counts"]), tuple(entry["size"])) == (run_lengths(mask), mask.shape)
    np.testing.assert_array_equal(mask_columns(text, mask.shape, "m").T, mask)
    with pytest.raises(InputError, match="m: expected"):
        mask_columns(text[: data.draw(st.integers(0, len(text) - 1))], mask.shape, "m")
