"""Colours of structures by their names."""

import pytest

from oneframe.surface.structure_colour import OTHER, structure_colour

AQUA, MAGENTA, GREEN = (0, 1, 1), (1, 0, 1), (0, 1, 0)


@pytest.mark.parametrize(
    ("name", "colour"),
    [
        ("facial_nerve", MAGENTA),
        ("Facial Nerve (left)", MAGENTA),
        ("cn-vii", MAGENTA),
        ("Ossicles", AQUA),
        ("incus+stapes", AQUA),
        ("chorda_tympani", GREEN),
        ("nerve", MAGENTA),
        ("cochlear_nerve", OTHER),
        ("fnord", OTHER),
    ],
)
def test_structures_have_the_colours_of_the_paper(name, colour):
    assert structure_colour(name) == colour
