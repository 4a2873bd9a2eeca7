"""Masks as run lengths: every reader gives back the very mask."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from oneframe.errors import InputError
from oneframe.packing.masks import mask_columns, mask_json

MASKS = arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12)))


def by_rules_of_coco(counts: list[int], height: int, width: int) -> np.ndarray:
    """Pixel by pixel, down the columns: runs of zeros and ones in turn, zeros first."""
    values = [number % 2 for number, count in enumerate(counts) for _ in range(count)]
    return np.array(values, bool).reshape(width, height).T


@given(mask=MASKS)
def test_run_lengths_are_the_mask(mask):
    data = mask_json(mask)
    entry = json.loads(data)["0"]
    assert entry["size"] == list(mask.shape)
    np.testing.assert_array_equal(by_rules_of_coco(entry["counts"], *mask.shape), mask)
    np.testing.assert_array_equal(mask_columns(data, mask.shape, "m").T, mask)


@given(mask=MASKS)
def test_pycocotools_reads_them(mask):
    coder = pytest.importorskip("pycocotools.mask", reason="pycocotools is not installed")
    entry = json.loads(mask_json(mask))["0"]
    found = coder.decode(coder.frPyObjects(entry, *entry["size"]))
    np.testing.assert_array_equal(found.astype(bool), mask)


@settings(max_examples=60)
@given(mask=MASKS, data=st.data())
def test_damaged_masks_are_a_sentence(mask, data):
    text = mask_json(mask)
    with pytest.raises(InputError, match="m: expected"):
        mask_columns(text[: data.draw(st.integers(0, len(text) - 1))], mask.shape, "m")
