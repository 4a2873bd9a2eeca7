"""The coverage is measured without a render, and is that of one."""

import numpy as np
import pytest

from oneframe.blender.render.cycles import CyclesScene
from oneframe.case.case_file import read_case
from oneframe.case.loaded_case import load_case
from oneframe.colour.coverage import coverage_of
from oneframe.colour.reference_view import baked_colour_of, colouring_view_of
from oneframe.colour.shading import ColouredSurface

pytestmark = pytest.mark.render


@pytest.mark.parametrize("mode", ["vertex", "texture"])
def test_the_figures_are_those_of_a_rendered_view(write_tiny_case, tmp_path, mode):
    source = colouring_view_of(load_case(read_case(write_tiny_case(tmp_path))))
    colour, _ = baked_colour_of(source, mode)
    found = coverage_of(source, colour)
    with CyclesScene(ColouredSurface(source.mesh, (colour,)), source.view.camera) as scene:
        view = scene.render(source.view.cam_from_model)
    differences = 255 * np.abs(view.rgb[view.observed] - source.view.image[view.observed])
    # at the rim of the observed surface a lookup depends on the rounding of single precision, nowhere else
    rim = view.mask & ~view.observed & beside(view.observed)
    assert -3 <= found.pixels - view.observed.sum() <= rim.sum()
    assert found.of_view == pytest.approx(found.pixels / view.mask.sum(), rel=1e-3)
    assert found.mean_error == pytest.approx(differences.mean(), rel=0.02, abs=0.01)


def beside(flags):
    """Pixels with a neighbour that has the flag."""
    around = np.pad(flags, 1)
    return around[2:, 1:-1] | around[:-2, 1:-1] | around[1:-1, 2:] | around[1:-1, :-2]
