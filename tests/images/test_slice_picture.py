"""Pictures of slices: contours to a fraction of a pixel, the marked part, letters and the scale bar."""

import numpy as np
import pytest

from oneframe.images.slice_picture import GAP_PX, INK, Contour, Slice, slice_picture

GREEN = (0.0, 1.0, 0.0)


def ring(scale: float) -> np.ndarray:
    rows, columns = np.mgrid[:120, :160]
    return scale * (np.hypot(columns - 80.3, rows - 60.7) - 35.4)


@pytest.mark.parametrize("scale", [0.01, 1, 1000])
def test_contour_is_drawn_where_the_field_is_zero_whatever_its_unit(scale):
    part = Slice("", np.zeros((120, 160)), 1.0, "    ", (Contour(ring(scale), GREEN),))
    panel = slice_picture([part])[GAP_PX:-GAP_PX, GAP_PX:-GAP_PX]
    weight = panel[:, :, 1] * (panel[:, :, 0] == 0)
    assert weight.sum() == pytest.approx(2 * np.pi * 35.4 * 1.6, rel=0.02)
    radius = ring(1) + 35.4
    assert (weight * radius).sum() / weight.sum() == pytest.approx(35.4, abs=0.05)
    assert not weight[np.abs(ring(1)) > 2].any()


def test_part_of_a_contour_and_the_tint_are_drawn_where_they_are_asked_for():
    left = np.arange(160)[None] < np.full((120, 1), 80)
    part = Slice("", np.ones((120, 160)), 1.0, "    ", (Contour(ring(1), GREEN, left),), ~left)
    panel = slice_picture([part])[GAP_PX:-GAP_PX, GAP_PX:-GAP_PX]
    lined = (panel[:, :, 0] < 0.5) & (panel[:, :, 1] > 0.5)
    assert lined[:, :80].any()
    assert not lined[:, 80:].any()
    assert (panel[20:100, 90:150] == panel[50, 120]).all()
    assert panel[50, 120, 0] > panel[50, 120, 1] + 0.2


def test_bar_has_a_round_length_and_letters_stand_at_their_sides():
    mm_per_px = 0.37
    panel = slice_picture([Slice("AXIAL Z -1.5", np.zeros((200, 400)), mm_per_px, "RLAP")])
    panel = panel[GAP_PX:-GAP_PX, GAP_PX:-GAP_PX]
    ink = np.isclose(panel, INK).all(axis=2)
    longest = max(len(run) for row in ink for run in "".join(".#"[int(dot)] for dot in row).split("."))
    assert longest == round(20 / mm_per_px)
    light = (panel > 0.5).all(axis=2)
    for box in (np.s_[80:120, :20], np.s_[80:120, -20:], np.s_[:20, 190:210], np.s_[-20:, 190:210], np.s_[:20, :150]):
        # letters, and not a block
        assert 10 < light[box].sum() < 0.5 * light[box].size
