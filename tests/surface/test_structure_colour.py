"""Colours of structures by their names."""

import pytest

from oneframe.surface.structure_colour import OTHER, structure_colour

AQUA, MAGENTA, GREEN = (0, 1, 1), (1, 0, 1), (0, 1, 0)


@pytest.mark.parametrize(
    ("name", "colour"),
    [
        ("facial_nerve", MAGENTA),
        ("FacialNerve", MAGENTA),
        ("Facial Nerve (left)", MAGENTA),
        ("FN_2", MAGENTA),
        ("cn-vii", MAGENTA),
        ("Ossicles", AQUA),
        ("left.Malleus", AQUA),
        ("incus+stapes", AQUA),
        ("chorda_tympani", GREEN),
        ("Chorda tympani nerve", GREEN),
        ("nerve", MAGENTA),
        ("cochlea", OTHER),
        ("cochlear_nerve", OTHER),
        ("Inferior vestibular nerve", OTHER),
        ("fnord", OTHER),
    ],
)
def test_structures_have_the_colours_of_the_paper(name, colour):
    assert structure_colour(name) == colour
