"""Highlights are told from the texture of tissue, whatever the frame's range."""

import numpy as np
import pytest

from oneframe.images.highlights import highlights
from oneframe.images.pixel_values import grown


@pytest.mark.parametrize("end", [0.6, 0.95, 1.2])
@pytest.mark.parametrize("contrast", [0.03, 0.12])
def test_reflections_are_found_and_texture_is_not(rng, end, contrast):
    """Pale tissue with a texture as strong upwards as downwards, spots of white light, and black around the view."""
    v, u = np.mgrid[:180, :240]
    shape = np.exp(-(((u - 150) / 160) ** 2) - ((v - 60) / 120) ** 2)
    waves = np.sin(u / 2.3) * np.sin(v / 1.9) + rng.normal(0, 0.3, shape.shape)
    tissue = (shape * (1 + contrast * waves))[..., None] * [0.8, 0.55, 0.5]
    light = np.zeros(shape.shape)
    for x, y in rng.uniform([40, 30], [200, 150], (8, 2)):
        light = np.maximum(light, np.clip(3 - np.hypot(u - x, v - y), 0, 1))
    inside = np.hypot(u - 120, v - 90) < 85
    frame = np.minimum((tissue + 0.7 * light[..., None]) * inside[..., None] * end, 1).astype(np.float32)
    found = highlights(frame)
    bright, dark = inside & (light > 0.6), inside & ~grown(light > 0, 1)
    assert found[bright].mean() > 0.8
    assert found[dark].mean() < 0.01
    assert not found[~inside].any()
    # what is not asked about is not found
    assert not highlights(frame, u < 120)[:, 120:].any()
    assert not highlights(np.zeros((9, 9, 3))).any()
