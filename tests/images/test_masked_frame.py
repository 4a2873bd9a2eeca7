"""A frame and its mask as one PNG: the values that were given, to the last bit, at the depth that they need."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.errors import InputError
from oneframe.images.masked_frame import encoded_frame, joined_mask, painted, shown_by_mask


@given(st.integers(0, 2**32 - 1), st.sampled_from([255, 65535]), st.booleans())
def test_the_values_are_those_of_the_frame(seed, largest, masked):
    rng = np.random.default_rng(seed)
    codes = rng.integers(0, largest, (*rng.integers(1, 20, 2), 3), endpoint=True)
    shown = rng.random(codes.shape[:2]) < 0.7 if masked else np.ones(codes.shape[:2], np.bool_)
    # as decoders give them: divided, or multiplied by the reciprocal
    for values in ((codes / largest).astype(np.float32), codes.astype(np.float32) * np.float32(1 / largest)):
        data = encoded_frame(values, shown)
        read = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        read = read if read.ndim == 3 else np.repeat(read[..., None], 3, axis=2)
        assert np.array_equal(read[..., 2::-1] / np.iinfo(read.dtype).max, codes / largest)
        assert read.dtype == np.uint16 or largest == 255
        alpha = read[..., 3] > 0 if read.shape[2] == 4 else np.ones(shown.shape, np.bool_)
        assert np.array_equal(alpha, shown)


def test_a_mask_is_its_alpha_or_else_its_grey_values():
    grey, all_valid = np.zeros((4, 6, 3), np.float32), np.ones((4, 6), np.bool_)
    # labels 0 and 1 in 8 bits
    grey[1:3] = 1 / 255
    expected = grey[..., 0] > 0
    assert np.array_equal(shown_by_mask(grey, all_valid, "m"), expected)
    # black pixels of a masked frame are no mask
    assert np.array_equal(shown_by_mask(np.zeros_like(grey), expected, "m"), expected)
    # colours, a photograph in grey, a smooth edge or the noise of a JPEG, zeros that are not
    for other in ((0.5, 0.4, 0.5), (0, 0, 1 / 255), (1, 1, 1), (2 / 255, 2 / 255, 2 / 255)):
        for hidden in (0, 3 / 255):
            changed = np.where(grey > 0, grey, np.float32(hidden))
            changed[0, 0] = other
            with pytest.raises(InputError, match="colours or shades"):
                shown_by_mask(changed, all_valid, "m")
    assert not shown_by_mask(np.zeros_like(grey), all_valid, "m").any()
    assert np.array_equal(joined_mask(expected, expected.copy(), "f", "m"), expected)
    with pytest.raises(InputError, match="together they hide all"):
        joined_mask(expected, ~expected, "f", "m")
    with pytest.raises(InputError, match="6x4 px, the size of f, found 4x6"):
        joined_mask(expected, expected.T, "f", "m")


@given(st.integers(0, 2**32 - 1))
def test_a_brush_changes_what_lies_within_its_radius_of_its_way(seed):
    rng = np.random.default_rng(seed)
    shown = rng.random(rng.integers(1, 40, 2)) < 0.5
    # it may leave the frame
    way, radius = rng.uniform(-10, 50, (rng.integers(1, 5), 2)), rng.uniform(1, 8)
    points = np.concatenate([np.linspace(a, b, 400) for a, b in zip(way, [*way[1:], way[-1]], strict=True)])
    pixels = np.indices(shown.shape)[::-1].reshape(2, -1).T
    distance = np.linalg.norm(pixels[:, None] - points, axis=-1).min(axis=1).reshape(shown.shape)
    for shows in (True, False):
        result = painted(shown, way, radius, shows=shows)
        assert (result[distance < radius - 0.02] == shows).all()
        assert (result == shown)[distance > radius + 0.02].all()
