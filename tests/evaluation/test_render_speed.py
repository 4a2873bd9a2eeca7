"""The case that speed is measured on, the ratios of times, and PyVista as a fair peer: it renders the same views."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.case.case_file import read_case
from pipeline.errors import InputError
from pipeline.evaluation.baseline.pyvista_baseline import pyvista_renderer
from pipeline.evaluation.scenes.benchmark_case import (
    CAM_FROM_MESH,
    FRAME_CAMERA,
    VIEW_CAMERA,
    detailed_frame,
    ridged_bowl,
    write_benchmark_case,
)
from pipeline.evaluation.trials.render_times import LIT_PEER, PEERS, RenderTimes, read_render_times
from pipeline.projection.z_buffer import rasterise_depth
from pipeline.surface.mesh_reader import read_mesh
from pipeline.transforms import rigid, rotation_from_vector

rounds = st.integers(1, 6).flatmap(
    lambda count: st.lists(st.lists(st.floats(1e-4, 10), min_size=count, max_size=count), min_size=4, max_size=4)
)


@given(rounds)
def test_the_ratio_of_medians_lies_within_the_range_of_the_rounds(seconds):
    times = RenderTimes({name: tuple(each) for name, each in zip((*PEERS, "ours"), seconds, strict=True)})
    ratio = times.ratio("ours", LIT_PEER)
    assert ratio.least * (1 - 1e-12) <= ratio.median <= ratio.most * (1 + 1e-12)
    assert times.ratio(LIT_PEER, LIT_PEER).median == 1
    assert times.ours == ("ours",)
    assert len(times.table()) == 2 + 4


@given(rounds)
def test_times_survive_their_file(tmp_path_factory, seconds):
    path = tmp_path_factory.mktemp("times") / "speed.json"
    times = RenderTimes({name: tuple(each) for name, each in zip((*PEERS, "ours"), seconds, strict=True)})
    path.write_text(json.dumps({"speed rounds": times.rounds_ms()}))
    read = read_render_times(path)
    assert list(read.seconds) == list(times.seconds)
    for name in times.seconds:
        assert read.seconds[name] == pytest.approx(times.seconds[name], rel=1e-12)


@pytest.mark.parametrize(
    "content",
    [
        "[]",
        "{",
        '{"speed": {"a": 1}}',
        '{"speed rounds": {"ours": [1, 2]}}',
        json.dumps({"speed rounds": {name: [1.0] for name in PEERS}}),
        json.dumps({"speed rounds": {name: [1.0] for name in PEERS} | {"ours": [1.0, 2.0]}}),
        json.dumps({"speed rounds": {name: [0.0] for name in (*PEERS, "ours")}}),
        json.dumps({"speed rounds": {name: [] for name in (*PEERS, "ours")}}),
    ],
)
def test_another_file_is_refused(tmp_path, content):
    path = tmp_path / "speed.json"
    path.write_text(content)
    with pytest.raises(InputError, match=r'speed.json: expected (JSON,|"speed rounds" with)'):
        read_render_times(path)


@pytest.mark.parametrize("triangles", [20_000, 200_000])
def test_the_surface_has_about_as_many_triangles_as_asked(triangles):
    assert len(ridged_bowl(triangles).faces) == pytest.approx(triangles, rel=0.01)


def test_the_case_is_what_is_measured(tmp_path):
    case = read_case(write_benchmark_case(tmp_path, 2000))
    assert case.camera == FRAME_CAMERA
    assert case.cam_from_mesh == pytest.approx(CAM_FROM_MESH)
    mesh, _ = read_mesh(case.mesh)
    # the surface fills the view
    assert (rasterise_depth(mesh, VIEW_CAMERA, case.cam_from_mesh).face >= 0).mean() > 0.95
    first, again = (detailed_frame(np.random.default_rng(4)) for _ in range(2))
    assert first.shape == (*FRAME_CAMERA.shape_hw, 3)
    np.testing.assert_array_equal(first, again)


@pytest.mark.gl
def test_pyvista_renders_the_same_view():
    """Of a surface that ends within the image: with the same K, but square pixels, it covers the same pixels."""
    pytest.importorskip("pyvista")
    mesh, camera = ridged_bowl(20_000), replace(VIEW_CAMERA, fx=VIEW_CAMERA.fy)
    turned = CAM_FROM_MESH @ rigid(rotation_from_vector(np.array([0.2, -0.3, 0.4])))
    pose = rigid(translation=np.array([3.0, -2.0, 250.0])) @ turned
    white = np.full((len(mesh.vertices), 3), 255, np.uint8)
    render = pyvista_renderer(mesh, white, camera, samples=1, lit=False, depth_range_mm=(300.0, 800.0))
    covered = render(pose)[..., 0] > 127
    expected = rasterise_depth(mesh, camera, pose).face >= 0
    assert 0.1 < expected.mean() < 0.9
    outline = np.count_nonzero(expected[:, 1:] != expected[:, :-1]) + np.count_nonzero(expected[1:] != expected[:-1])
    # a tenth of a pixel along the outline
    assert np.count_nonzero(covered != expected) < 0.1 * outline
