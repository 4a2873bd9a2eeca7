"""The circle of an endoscope is found where it was drawn, and nowhere else."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oneframe.video.view_circle import Circle, lit_part, view_circle

WIDTH, HEIGHT = 960, 540
SMALL_WH = (480, 270)


def scene(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    texture = cv2.GaussianBlur(rng.normal(0, 1, (HEIGHT, WIDTH)).astype(np.float32), (0, 0), 12.5)
    return 120 + 600 * texture


@settings(max_examples=8)
@given(
    u=st.floats(420, 540), v=st.floats(240, 300), radius=st.floats(210, 400), softness=st.floats(0.4, 2.5),
    black=st.floats(0, 8), seed=st.integers(0, 5),
)  # fmt: skip
def test_drawn_circles_are_found_within_a_pixel(u, v, radius, softness, black, seed):
    inside = cv2.GaussianBlur(Circle(u, v, radius).mask((WIDTH, HEIGHT)).astype(np.float32), (0, 0), softness)
    picture = np.clip(scene(seed), 40, 250) * inside + black
    # the date, as recorders write it
    cv2.putText(picture, "2025-01-31", (10, 30), cv2.FONT_HERSHEY_SIMPLEX, 0.75, 230, 2)
    small = cv2.resize(picture, SMALL_WH, interpolation=cv2.INTER_AREA)
    found = view_circle(small)
    assert found is not None
    found = found.scaled(WIDTH / SMALL_WH[0], HEIGHT / SMALL_WH[1])
    assert np.abs(np.array([found.u - u, found.v - v, found.radius - radius])).max() < 1


@pytest.mark.parametrize("dim", [0.0, 0.85])
def test_a_picture_without_a_circle_has_none(dim):
    v, u = np.mgrid[:270, :480]
    vignette = 1 - dim * ((u / 480 - 0.5) ** 2 + (v / 270 - 0.5) ** 2) * 2
    assert view_circle(np.clip(scene(1)[::2, ::2], 40, 250) * vignette) is None


def test_black_bars_are_no_circle_but_no_tissue_either():
    picture = np.clip(scene(1)[::2, ::2], 40, 250)
    picture[:30] = picture[-30:] = 3
    assert view_circle(picture) is None
    assert lit_part(picture)[35:-35].all()
    assert not lit_part(picture)[:28].any()
    assert lit_part(np.zeros((270, 480))) is None
