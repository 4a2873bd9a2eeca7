"""Highlights that move with the lens leave the colour of three frames or more; a pattern that is out of place stays."""

from dataclasses import replace

import numpy as np
import pytest

from oneframe.colour import highlights
from oneframe.colour.highlights import without_highlights
from oneframe.colour.source_view import SourceView
from tests.alignment.test_refinement import hills

from .test_exposure import CAMERA, view

STRIPES = np.where(np.arange(CAMERA.width) % 40 < 16, 0.7, 0.2)


@pytest.fixture
def frames() -> list[SourceView]:
    """Three of striped hills, with noise."""
    rng, seen = np.random.default_rng(0), view(hills(1), 20, np.random.default_rng(1))
    images = STRIPES[:, None] + rng.normal(0, 0.01, (3, *CAMERA.shape_hw, 3))
    return [replace(seen, image=image.astype(np.float32)) for image in images]


def test_what_one_frame_alone_shows_bright_is_masked_in_it(frames):
    places = [(np.s_[row : row + 12], np.s_[40:70]) for row in (40, 60, 80)]
    for frame, place in zip(frames, places, strict=True):
        frame.image[place] = 1.0
    assert without_highlights(frames[:2]) == tuple(frames[:2])
    for after, (rows, columns) in zip(without_highlights(frames), places, strict=True):
        assert not after.valid[rows, columns].any()
        assert not after.inverse_depth[rows, columns].any()
        beyond = ~after.valid
        beyond[rows.start - 6 : rows.stop + 6, columns.start - 6 : columns.stop + 6] = False
        assert not beyond.any()


def test_stripes_beside_their_place_are_no_highlight(frames, monkeypatch):
    frames = [replace(frames[0], image=np.roll(frames[0].image, shift, axis=1)) for shift in (0, 0, 6)]
    for out_of_place, stay in ((0.05, True), (0.0, False)):
        monkeypatch.setattr(highlights, "OUT_OF_PLACE", out_of_place)
        assert all(frame.valid.all() for frame in without_highlights(frames)) == stay
