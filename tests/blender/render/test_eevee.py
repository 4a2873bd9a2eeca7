"""Views by Eevee: in one file, and so one process, as compiling its shaders without a graphics card takes long."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.blender.render.engines import engine_named, opened_engine, reference_view_of
from oneframe.colour.shading import ColouredSurface
from oneframe.colour.vertex_colours import NEUTRAL
from oneframe.dataset.options import COLOURS, DatasetOptions
from oneframe.errors import InputError
from oneframe.reader import open_dataset
from tests.blender.bridge.test_camera import CAMERAS, check_edges_of_a_triangle
from tests.blender.dataset.job_runs import run_here
from tests.blender.render.test_anti_aliasing import FARTHER, FRAME, VIEW
from tests.blender.render.test_lens_light import LIGHT, check_light_on_a_ball

pytestmark = [pytest.mark.render, pytest.mark.gl]


@pytest.fixture(scope="module", autouse=True)
def available() -> None:
    try:
        engine_named("eevee").check()
    except InputError as error:
        pytest.skip(str(error))


def test_edges_of_a_rendered_triangle_are_where_k_says():
    check_edges_of_a_triangle("eevee", CAMERAS["portrait"])


def test_a_grey_ball_is_lit_as_the_law_says():
    check_light_on_a_ball("eevee", replace(LIGHT, vignetting=90.0))


def some_view(case: Path, out: Path, **settings: object) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Colours, depth and observed mask of one view with some options."""
    run_here(case, out, DatasetOptions(count=1, seed=3, float_depth=True, **settings))
    view = open_dataset(out)[0]
    return view.rgb.astype(float), view.depth_mm, view.observed


def test_eevee_agrees_with_cycles(write_tiny_case, tmp_path):
    """What raster shows is compared with Cycles in test_ray_tracer.py."""
    case = write_tiny_case(tmp_path / "case")
    for colour in COLOURS:
        exact, view = (
            some_view(case, tmp_path / colour / engine, engine=engine, colour=colour) for engine in ("cycles", "eevee")
        )
        assert np.count_nonzero((view[1] > 0) != (exact[1] > 0)) <= 3
        # nothing more is painted, and nothing less but at the rim, where the lookup's weights are rounded to 1/256
        assert np.count_nonzero(view[2] & ~exact[2]) <= 3
        inner = cv2.erode(exact[2].astype(np.uint8), np.ones((3, 3)), borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
        assert view[2][inner].all()
        assert np.abs(view[1] - exact[1])[inner].max() < 0.05
        difference = np.abs(view[0] - exact[0])[inner]
        assert difference.max() <= 8
        assert difference.mean() < 0.5


def test_a_rasteriser_s_samples_do_not_mix_with_the_background(stepped_mesh, frontal_pose, oblique_pose, loaded_case):
    plain = np.full((*FRAME.shape_hw, 3), 0.75, np.float32)
    source = reference_view_of(loaded_case(stepped_mesh, plain, frontal_pose, FRAME))
    with opened_engine("eevee", ColouredSurface(source.mesh, source.views), VIEW, samples=8) as render:
        view = render(FARTHER @ oblique_pose)
    assert not view.rgb[~view.mask].any()
    # where the frame saw the surface, some samples may be grey, but none black
    assert view.rgb[view.mask].min() > NEUTRAL - 0.01
