"""Several frames colour the surface: a point has the colour from the first of them that saw it."""

import io
import json
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from oneframe.blender.dataset import run as dataset_run
from oneframe.blender.dataset.job import Job
from oneframe.blender.dataset.view_renderer import ViewRenderer
from oneframe.blender.render.engines import opened_engine, reference_view_of
from oneframe.blender.sample.sample_case import HELD_OUT, write_sample_case
from oneframe.case.case_file import read_case
from oneframe.case.loaded_case import load_case
from oneframe.colour.reference_view import baked_colour_of
from oneframe.colour.shading import ColouredSurface
from oneframe.dataset.check.check_dataset import check_dataset
from oneframe.dataset.check.findings import Findings
from oneframe.dataset.check.inputs import check_inputs
from oneframe.dataset.dataset_file import read_description
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.run.run_folder import Shard
from oneframe.images.pixel_values import sample_bilinear
from oneframe.projection.edge_pixels import edge_pixels
from oneframe.reader import open_dataset
from oneframe.sample.temporal_bone import MICROSCOPE, sample_surface
from oneframe.transforms import rigid, rotation_from_vector

pytestmark = pytest.mark.render
CAMERA = MICROSCOPE.resized(192, 108)
TURN = rigid(rotation_from_vector(np.array([0.2, -0.1, 0.3])))


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sample")
    for _ in write_sample_case(folder, sample_surface(spacing_mm=0.8), camera=CAMERA):
        pass
    text, listed = (folder / "case.toml").read_text(), json.loads((folder / HELD_OUT).read_text())
    for entry in listed[:2]:
        text += f"[[frames]]\nimage = '{entry['image']}'\ncam_from_mesh = {entry['cam_from_mesh']}\n"
    (folder / "several.toml").write_text(text)
    return load_case(read_case(folder / "several.toml"))


@pytest.mark.parametrize(
    ("engine", "mode", "samples"),
    [("raster", "vertex", 4), ("raster", "projective", 1), ("cycles", "projective", 4)],
)
def test_a_pixel_has_the_colour_from_the_first_frame_that_saw_its_point(loaded, engine, mode, samples):
    source = reference_view_of(loaded, engine)
    pose = loaded.frame.cam_from_model @ TURN
    options = DatasetOptions(engine=engine, colour=mode, samples=samples)

    def rendered(views):
        with ViewRenderer(loaded, replace(source, views=views), options, None) as renderer:
            return renderer.render(pose)

    together, *alone = (rendered(views) for views in (source.views, *((view,) for view in source.views)))
    seen = np.stack([view.observed for view in alone])
    assert np.array_equal(together.observed, seen.any(axis=0))
    assert (together.mask & ~together.observed).sum() < 0.7 * (together.mask & ~seen[0]).sum()
    assert np.array_equal(together.depth_mm, alone[0].depth_mm)
    chosen = seen.argmax(axis=0)
    expected = np.take_along_axis(np.stack([view.rgb for view in alone]), chosen[None, ..., None], axis=0)[0]
    # with several samples, pixels at an edge are means over rays, each of the first frame that saw its point
    edges = np.any([view.near_unseen | edge_pixels(view.depth_mm, view.observed, CAMERA) for view in alone], axis=0)
    inside = together.observed & ~(edges & (samples > 1))
    assert np.array_equal(together.source, np.where(together.observed, chosen + 1, 0))
    assert np.bincount(chosen[together.observed], minlength=3).min() > 20
    # Cycles mixes colours with a rounding
    off = np.abs(together.rgb - np.stack([view.rgb for view in alone])).max(axis=-1).min(axis=0)
    assert off[~(edges & (samples > 1))].max() < 1e-6
    assert np.abs(together.rgb - expected)[inside].max() < 1e-6


def test_a_dataset_says_which_frame_colours_a_pixel(loaded, tmp_path):
    options = DatasetOptions(count=2, engine="raster")
    job = Job(loaded.case, tmp_path / "out", options, Shard(0, 1))
    dataset_run.run(job, workers=1, worker_command=(), stream=io.StringIO())
    source = reference_view_of(loaded, "raster")
    with ExitStack() as opened:
        alone = [
            opened.enter_context(opened_engine("raster", ColouredSurface(source.mesh, (view,)), CAMERA))
            for view in source.views
        ]
        for view in open_dataset(tmp_path / "out"):
            by_frame = np.stack([np.zeros(view.rgb.shape), *(render(view.cam_from_model).rgb for render in alone)])
            assert np.unique(view.source_frame[view.observed]).tolist() == [1, 2, 3]
            named = np.take_along_axis(by_frame, view.source_frame[None, ..., None], axis=0)[0]
            assert np.abs(view.rgb - 255 * named)[view.observed].max() < 0.51
    assert not check_dataset(tmp_path / "out", case=loaded.case).findings
    first, *others = loaded.case.frames
    moved = replace(loaded.case, frames=(replace(first, camera=replace(first.camera, fx=1.0)), *others))
    check_inputs(read_description(tmp_path / "out" / "dataset.json"), moved, None, findings := Findings())
    assert ["frames: 0.fx is " in message for message in findings.shown()] == [True]


def test_a_texture_has_the_colour_of_the_first_frame_that_saw_a_face(loaded):
    source = reference_view_of(loaded)
    mesh, (atlas, _) = source.mesh, baked_colour_of(source, "texture")
    height, width = atlas.observed.shape
    found = sample_bilinear(atlas.image, atlas.uv.mean(axis=1) * [width, -height] + [-0.5, height - 0.5])
    seen = np.stack([view.observed(mesh.face_centres, mesh.face_normals) for view in source.views])
    assert not (atlas.seen & ~seen.any(axis=0)).any()
    # all but those at a border
    assert atlas.seen.sum() > 0.8 * seen.any(axis=0).sum()
    colours = np.stack([view.colours(view.project(mesh.face_centres)[0]) for view in source.views])
    off = np.abs(colours - found).max(axis=2).min(axis=0)
    assert off[atlas.seen].max() < 1e-2
    assert np.bincount(np.abs(colours - found).max(axis=2).argmin(axis=0)[atlas.seen], minlength=3).min() > 20
