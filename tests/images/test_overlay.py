"""Overlays: what is dashed, how fading means depth, where lines lie, and how long the scale bar is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.images.layer_stack import Layer, LayerStack, SurfaceLayer
from oneframe.images.legend import legend_panel, scale_bar
from oneframe.images.overlay import (
    DASH_PX,
    GAP_PX,
    SMOOTHING_PX,
    draw_overlay,
    outline_segments,
    outlines,
)

SHAPE = 240, 320
NO_LINES = np.zeros((0, 2, 2))
MAGENTA = (1.0, 0.0, 1.0)


def disc(centre: tuple[float, float], radius: float) -> np.ndarray:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return np.hypot(x - centre[0], y - centre[1]) <= radius


def plain_layer(mask: np.ndarray, depth_mm: np.ndarray | float, colour=MAGENTA) -> Layer:
    return Layer((0, 0), np.where(mask, depth_mm, 0).astype(np.float32), np.ones(SHAPE, np.float32), colour)


def surface_at(depth_mm: np.ndarray | float) -> SurfaceLayer:
    return SurfaceLayer(np.broadcast_to(np.float32(depth_mm), SHAPE).copy(), NO_LINES, NO_LINES)


@given(x=st.floats(60, 250), y=st.floats(60, 180), radius=st.floats(4, 55), hole=st.floats(0.3, 0.7), at=st.booleans())
def test_outlines_follow_a_disc_and_its_hole(x, y, radius, hole, at):
    mask = disc((x, y), radius)
    circles = [radius]
    if at and hole * radius > 3:
        mask &= ~disc((x, y), hole * radius)
        circles.append(hole * radius)
    curves = outlines(mask, sigma_px=SMOOTHING_PX)
    assert len(curves) == len(circles)
    for (points, inner, outer), expected in zip(curves, circles, strict=True):
        lengths = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
        distance = np.hypot(*(points - [x, y]).T)
        assert np.abs(distance - expected).max() < 1
        assert lengths.sum() == pytest.approx(2 * np.pi * expected, rel=0.08)
        assert mask[inner[:, 1], inner[:, 0]].all()
        assert not mask[outer[:, 1], outer[:, 0]].any()
        # dashes are counted from the highest point, or around a hole from the highest below it
        tops = points[outer[:, 1] < inner[:, 1]]
        assert points[0, 1] <= tops[:, 1].min() + 1
        assert lengths.max() < 2


@given(angle=st.floats(0, 2 * np.pi), offset=st.floats(-30, 30))
def test_dashed_exactly_where_the_surface_is_in_front(angle, offset):
    """The surface lies before the structure on one side of a straight line, behind it on the other."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    side = (x - 160) * np.cos(angle) + (y - 120) * np.sin(angle) + offset
    surface, layer = surface_at(np.where(side > 0, 295.0, 305.0)), plain_layer(disc((160, 120), 70), 300.0)
    stack = LayerStack.of(surface, [layer])
    visible, dashes = outline_segments(stack, 0, on_px=DASH_PX, off_px=GAP_PX, sigma_px=SMOOTHING_PX)

    def side_of(segments: np.ndarray) -> np.ndarray:
        middle = segments.mean(axis=1) - [160, 120]
        return middle @ [np.cos(angle), np.sin(angle)] + offset

    assert (side_of(visible) < 2).all()
    assert (side_of(dashes) > -2).all()
    lengths = [np.hypot(*(part[:, 1] - part[:, 0]).T).sum() for part in (visible, dashes)]
    half_angle = np.arccos(np.clip(offset / 70, -1, 1))
    # no gap in what is visible; of what is hidden, as much as a dash is of its period
    assert lengths[0] == pytest.approx(140 * half_angle, rel=0.08)
    hidden = 140 * (np.pi - half_angle)
    assert lengths[1] == pytest.approx(hidden * DASH_PX / (DASH_PX + GAP_PX), abs=0.05 * hidden + GAP_PX + 2)


@pytest.mark.parametrize("tissue", [0.03, 0.5, 0.97])
def test_the_picture_has_the_dashes(tissue):
    """In the picture, on dark and on bright tissue: a solid line has no gap, a hidden one has."""
    image = np.full((*SHAPE, 3), round(255 * tissue), np.uint8)
    layer = plain_layer(disc((160, 120), 70), 300.0)
    angle = np.linspace(0, 2 * np.pi, 2000)
    rim = np.rint(np.stack([160 + 70 * np.cos(angle), 120 + 70 * np.sin(angle)], axis=1)).astype(int)
    gaps = {}
    for name, depth in (("visible", 310.0), ("hidden", 290.0)):
        picture = draw_overlay(image, surface_at(depth), [layer]) / 255
        line = picture[rim[:, 1], rim[:, 0]]
        gaps[name] = float((line[:, 0] - line[:, 1] < 0.55).mean())
        # the dark rim sets the line off on any ground
        outside = picture[120, 160 + 70 : 160 + 76].sum(axis=1)
        assert outside.min() <= image[0, 0].sum() / 255 + 1e-6
    assert gaps["visible"] < 0.02
    assert 0.15 < gaps["hidden"] < 0.5


def test_what_lies_deeper_is_fainter():
    """A slab that goes down to the right."""
    ramp = np.broadcast_to(300 + np.linspace(0.5, 9.5, SHAPE[1]), SHAPE)
    mask = np.zeros(SHAPE, bool)
    mask[60:180] = True
    picture = draw_overlay(np.full((*SHAPE, 3), 128, np.uint8), surface_at(300.0), [plain_layer(mask, ramp)])
    row = picture[120, ::20].astype(int)
    assert (np.diff(row[:, 0]) < 0).all()
    assert (np.diff(row[:, 1]) > 0).all()


def test_the_border_of_the_image_and_nearer_structures_are_no_outline():
    image = np.full((*SHAPE, 3), 128, np.uint8)
    mask = np.zeros(SHAPE, bool)
    mask[:, :200] = True
    stack = LayerStack.of(surface_at(500.0), [plain_layer(mask, 300.0), plain_layer(disc((100, 100), 30), 290.0)])
    visible, dashes = outline_segments(stack, 0, on_px=9, off_px=6, sigma_px=SMOOTHING_PX)
    assert len(dashes) == 0
    # straight down at the right end of the slab; nothing around the disc in front of it
    assert np.abs(visible[..., 0] - 199.5).max() < 1
    picture = draw_overlay(image, surface_at(500.0), [plain_layer(mask, 300.0)])
    np.testing.assert_allclose(picture[5, 0], picture[120, 100])


def block_letters(text: str, size: float) -> np.ndarray:
    return np.ones((int(np.ceil(1.1 * size)), max(int(0.5 * size * len(text)), 1)), np.float32)


@given(px_per_mm=st.floats(0.2, 300), width=st.integers(300, 4000), height=st.integers(300, 2200))
def test_the_scale_bar_is_as_long_as_it_says(px_per_mm, width, height):
    bar = scale_bar(px_per_mm, (height, width), "at the surface")
    assert bar.length_px == pytest.approx(bar.length_mm * px_per_mm)
    assert 0.05 * min(height, width) < bar.length_px <= 0.2 * min(height, width) + 1e-9
    assert f"{bar.length_mm:g} mm at the surface" == bar.label
    panel = legend_panel([], bar, lambda text, size: block_letters(text, size) * 0, (height, width))
    # the bar is the only bright thing; its ends cover parts of pixels
    row = panel[..., 0] * panel[..., 3]
    drawn = row[row.max(axis=1).argmax()].sum() / row.max()
    assert drawn == pytest.approx(bar.length_px, abs=0.5)
