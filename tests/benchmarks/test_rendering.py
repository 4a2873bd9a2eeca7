"""Speed and accuracy of rendering: the statistics, and the case that is measured."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.case.case_file import read_case
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.surface.mesh_reader import read_mesh
from scripts.benchmarks.rendering.benchmark_case import VIEW_CAMERA, ridged_bowl, write_benchmark_case
from scripts.benchmarks.rendering.speed_accuracy import pareto_front

# few different values, so that ties are frequent
values = st.one_of(st.sampled_from([1.0, 2.0, 3.0, np.nan]), st.floats(1e-3, 1e3))


@given(points=st.lists(st.tuples(values, values), max_size=30))
def test_no_kept_point_is_beaten_and_every_dropped_one_is(points):
    kept = pareto_front([cost for cost, _ in points], [error for _, error in points])

    def beats(one, other):
        return one[0] <= other[0] and one[1] <= other[1] and one != other

    for point, keep in zip(points, kept, strict=True):
        measured = np.isfinite(point).all()
        assert keep == (measured and not any(beats(other, point) for other in points if np.isfinite(other).all()))
    assert kept.any() == any(np.isfinite(point).all() for point in points)


@pytest.mark.parametrize("triangles", [20_000, 200_000])
def test_the_surface_has_about_as_many_triangles_as_asked(triangles):
    assert len(ridged_bowl(triangles).faces) == pytest.approx(triangles, rel=0.01)


def test_the_surface_fills_the_view(tmp_path):
    case = read_case(write_benchmark_case(tmp_path, 2000))
    mesh, _ = read_mesh(case.mesh)
    assert (rasterise_depth(mesh, VIEW_CAMERA, case.cam_from_mesh).face >= 0).mean() > 0.95
