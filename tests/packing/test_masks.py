"""Masks as run lengths: every reader gives back the very mask."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pycocotools import mask as coder

from oneframe.errors import InputError
from oneframe.packing.layout import mask_columns, mask_json

MASKS = arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12)))


@given(mask=MASKS)
def test_run_lengths_are_the_mask(mask):
    data = mask_json(mask)
    entry = json.loads(data)["0"]
    found = coder.decode(coder.frPyObjects(entry, *entry["size"]))
    np.testing.assert_array_equal(found.astype(bool), mask)
    np.testing.assert_array_equal(mask_columns(data, mask.shape, "m").T, mask)


@settings(max_examples=60)
@given(mask=MASKS, data=st.data())
def test_damaged_masks_are_a_sentence(mask, data):
    text = mask_json(mask)
    with pytest.raises(InputError, match="m: expected"):
        mask_columns(text[: data.draw(st.integers(0, len(text) - 1))], mask.shape, "m")
