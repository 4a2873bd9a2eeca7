"""Qualities other than exact: within tolerance in all views, the same however made, nothing else about the dataset."""

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.blender.colour.reference_view import reference_view_of
from pipeline.blender.dataset import run as dataset_run
from pipeline.blender.dataset.job import Job, open_job
from pipeline.blender.dataset.quality import choose_setting
from pipeline.blender.dataset.reduced_surface import KeptSurface, keep_surface, rendered_mesh, rendered_view_of
from pipeline.blender.dataset.rerender import CaseRenderer
from pipeline.blender.dataset.view_renderer import ViewRenderer
from pipeline.blender.render.z_buffer_view import ZBufferRenderer
from pipeline.camera.pinhole import PinholeCamera
from pipeline.case.case_file import read_case
from pipeline.dataset.check.check_dataset import check_dataset
from pipeline.dataset.check.rerendered import Rerendering
from pipeline.dataset.folder import Shard
from pipeline.dataset.identity import geometry_hash
from pipeline.dataset.layout import ViewPaths
from pipeline.dataset.options import DatasetOptions
from pipeline.dataset.quality import renderings, stored_setting, tolerance_of
from pipeline.dataset.view_error import view_error
from pipeline.errors import RunError
from pipeline.images.png import encode_png
from pipeline.surface.mesh import TriangleMesh
from pipeline.surface.mesh_writer import write_ply

pytestmark = pytest.mark.render

CAMERA = PinholeCamera(192, 144, 900.0, 905.0, 96.5, 70.25)
VIEWS = 12
OPTIONS = DatasetOptions(count=VIEWS, quality="auto", seed=5, min_observed=0.2)
CASE = f"""
units = "mm"
[frame]
image = "frame.png"
[camera]
size = [{CAMERA.width}, {CAMERA.height}]
K = {CAMERA.k.tolist()}
[surface]
mesh = "surface.ply"
[pose]
cam_from_mesh = [[1, 0, 0, -12], [0, -1, 0, -7], [0, 0, -1, 340], [0, 0, 0, 1]]
"""


def surface(spacing_mm: float) -> TriangleMesh:
    """A plate with a smooth hill, all of it in the frame, with a vertex every so many mm."""
    side = round(50 / spacing_mm)
    x, y = np.meshgrid(np.linspace(-25, 25, side + 1), np.linspace(-18, 18, side + 1))
    z = 9 * np.exp(-((x / 7) ** 2) - (y / 6) ** 2)
    index = np.arange((side + 1) ** 2).reshape(side + 1, side + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    vertices = np.stack([x + 12, y - 7, z + 40], -1).reshape(-1, 3)
    return TriangleMesh(vertices, faces.astype(np.int32))


def write_case(folder: Path, spacing_mm: float) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    image = np.stack([120 + 90 * np.sin(u / 5), 120 + 90 * np.cos(v / 4), (2 * u + v) / 3], -1)
    (folder / "frame.png").write_bytes(encode_png(image.astype(np.uint8)))
    write_ply(folder / "surface.ply", surface(spacing_mm))
    (folder / "case.toml").write_text(CASE)
    return folder / "case.toml"


@pytest.fixture(scope="module")
def fine_case(tmp_path_factory) -> Path:
    return write_case(tmp_path_factory.mktemp("fine"), 0.25)


@pytest.fixture(scope="module")
def reference(fine_case, tmp_path_factory) -> tuple[Path, str]:
    """The dataset of quality auto, made in one go, and what the run said."""
    out = tmp_path_factory.mktemp("reference") / "out"
    return out, run_here(fine_case, out)


def run_here(case: Path, out: Path, options: DatasetOptions = OPTIONS, shard: Shard | None = None) -> str:
    stream = io.StringIO()
    job = Job(read_case(case), out, options, shard or Shard())
    dataset_run.run(job, workers=1, worker_command=(), stream=stream)
    return stream.getvalue()


def tree(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_the_tolerance_holds_in_views_that_were_no_pilots(fine_case, tmp_path):
    for quality, samples in (("auto", 1), ("draft", 1), ("auto", 4)):
        options = replace(OPTIONS, quality=quality, samples=samples, count=60)
        opened = open_job(Job(read_case(fine_case), tmp_path, options, Shard()))
        choice = choose_setting(opened.loaded, options, None, threads=0, report=lambda _: None)
        assert choice.setting.faces < 0.5 * len(opened.loaded.mesh.faces)
        source = rendered_view_of(opened.loaded, choice.setting.pivot_model, choice.mesh)
        with (
            ViewRenderer(opened.loaded, reference_view_of(opened.loaded), options, None) as exact,
            ViewRenderer(opened.loaded, source, options, None, setting=choice.setting) as cheap,
        ):
            for index in range(1, 60, 4):
                pose = exact.plan(index).cam_from_model
                assert np.array_equal(cheap.plan(index).cam_from_model, pose)
                error = view_error(cheap.render(pose), exact.render(pose), exact.camera)
                assert error.within(tolerance_of(options))


def test_resumed_and_sharded_runs_make_the_same_bytes(fine_case, reference, tmp_path):
    out, said = reference
    assert "quality auto: z-buffer" in said
    assert not (out / ".work").exists()
    # shards in folders of their own choose for themselves
    parts = [tmp_path / "a", tmp_path / "b"]
    for index, part in enumerate(parts):
        run_here(fine_case, part, shard=Shard(index, 2))
    merged = tree(parts[0]) | tree(parts[1])
    for name, data in merged.items():
        (tmp_path / "merged" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "merged" / name).write_bytes(data)
    said = run_here(fine_case, tmp_path / "merged")
    assert "pilot" not in said
    assert tree(tmp_path / "merged") == tree(out)
    # what is lost is made again as it was, without a measurement
    ViewPaths(out, 3).file("frame").unlink()
    before = tree(tmp_path / "merged")
    assert "pilot" not in run_here(fine_case, out)
    assert tree(out) == before


def test_worker_processes_do_without_the_surface_given(fine_case, reference, tmp_path, render_command, run_command):
    ended = run_command(
        render_command(
            fine_case, "--out", tmp_path / "out", "--count", VIEWS, "--seed", 5, "--min-observed", 0.2,
            "--quality", "auto", "--workers", 3,
        )
    )  # fmt: skip
    assert (ended.returncode, ended.stderr) == (0, "")
    assert tree(tmp_path / "out") == tree(reference[0])
    opened = open_job(Job(read_case(fine_case), tmp_path, OPTIONS, Shard()))
    setting = stored_setting(tmp_path / "out")
    assert setting is not None
    kept = KeptSurface(
        rendered_mesh(opened.loaded.mesh, setting, tmp_path),
        opened.loaded.mesh_from_model,
        opened.loaded.mesh.radius,
        geometry_hash(opened.loaded.mesh),
        opened.inputs_sha256["surface"],
    )
    light = open_job(opened.job, kept)
    assert light.loaded.mesh is kept.mesh
    assert replace(light, setting=setting).description == replace(opened, setting=setting).description


def test_the_checker_accepts_the_dataset_and_renders_it_again(fine_case, reference):
    out, _ = reference
    case = read_case(fine_case)
    rerendering = Rerendering(lambda described: CaseRenderer(case, described.content, None), 3)
    report = check_dataset(out, case=case, rerendering=rerendering)
    assert report.summary().startswith(f"dataset of {VIEWS} views: complete and consistent")
    assert report.rerendered == 3


def test_only_images_and_the_choice_differ_from_exact_quality(fine_case, reference, tmp_path):
    out, _ = reference
    run_here(fine_case, tmp_path, replace(OPTIONS, quality="exact"))
    exact, auto = (json.loads((folder / "dataset.json").read_text()) for folder in (tmp_path, out))
    setting = auto.pop("setting")
    assert setting["mesh_tolerance_mm"] > 0
    assert setting["faces"] < 0.5 * len(surface(0.25).faces)
    chosen = {auto["options"].pop(name) for name in ("quality", "tolerance_colour", "tolerance_px")}
    assert chosen == {"auto", 0.5, 0.1}
    assert exact == auto
    for name in ("models/models_info.json", "models_eval/obj_000001.ply", "poses.csv", "dataset_info.md"):
        assert (tmp_path / name).read_bytes() == (out / name).read_bytes()


def test_other_tolerances_and_exact_quality_are_another_dataset(fine_case, reference):
    out, _ = reference
    for options, message in (
        (replace(OPTIONS, tolerance_px=0.2), "options.tolerance_px was 0.1, is 0.2"),
        (replace(OPTIONS, quality="exact"), '\\(options.quality was "auto", is "exact"\\)'),
    ):
        with pytest.raises(RunError, match=message):
            run_here(fine_case, out, options)


def test_a_coarse_surface_is_not_reduced(tmp_path):
    opened = open_job(Job(read_case(write_case(tmp_path, 2.5)), tmp_path, OPTIONS, Shard()))
    choice = choose_setting(opened.loaded, OPTIONS, None, threads=0, report=lambda _: None)
    assert choice.setting.mesh_tolerance_mm == 0
    assert choice.mesh is opened.loaded.mesh


def test_no_tolerance_leaves_exact_views(fine_case, tmp_path):
    options = replace(OPTIONS, tolerance_colour=0.0, tolerance_px=0.0, colour="vertex")
    opened = open_job(Job(read_case(fine_case), tmp_path, options, Shard()))
    choice = choose_setting(opened.loaded, options, None, threads=0, report=lambda _: None)
    assert (choice.setting.renderer, choice.setting.colour, choice.setting.mesh_tolerance_mm) == ("cycles", "vertex", 0)
    assert "nothing cheaper" in choice.message


def test_renderings_that_may_stand_in():
    assert renderings(DatasetOptions()) == [("z-buffer", "projective", 1), ("cycles", "projective", 1)]
    baked = renderings(DatasetOptions(colour="texture", samples=8))
    assert ("z-buffer", "projective", 1) in baked
    assert ("cycles", "texture", 8) in baked
    assert all(each[0] == "cycles" for each in renderings(DatasetOptions(colour="vertex")))


def test_the_reduced_surface_is_kept_and_made_again(fine_case, tmp_path):
    opened = open_job(Job(read_case(fine_case), tmp_path, OPTIONS, Shard()))
    choice = choose_setting(opened.loaded, OPTIONS, None, threads=0, report=lambda _: None)
    (tmp_path / ".work").mkdir()
    made = rendered_mesh(opened.loaded.mesh, choice.setting, tmp_path)
    keep_surface(KeptSurface(choice.mesh, opened.loaded.mesh_from_model, 1.0, "", ""), choice.setting, tmp_path)
    (file,) = (tmp_path / ".work").iterdir()
    kept = rendered_mesh(opened.loaded.mesh, choice.setting, tmp_path)
    file.write_bytes(file.read_bytes()[:-100])
    again = rendered_mesh(opened.loaded.mesh, choice.setting, tmp_path)
    for mesh in (made, kept, again):
        assert np.array_equal(mesh.vertices, choice.mesh.vertices)
        assert np.array_equal(mesh.faces, choice.mesh.faces)
    with pytest.raises(RunError, match="cannot be made again by this version"):
        rendered_mesh(opened.loaded.mesh.scaled(1.01), choice.setting, tmp_path)


def test_a_damaged_choice_is_refused(tmp_path):
    (tmp_path / "dataset.json").write_text('{"setting": {"renderer": "povray"}}')
    with pytest.raises(RunError, match="expected the setting that a run has chosen"):
        stored_setting(tmp_path)


def test_views_that_the_z_buffer_would_clip_are_ray_traced(fine_case, tmp_path):
    opened = open_job(Job(read_case(fine_case), tmp_path, OPTIONS, Shard()))
    loaded, source = opened.loaded, reference_view_of(opened.loaded)
    choice = choose_setting(loaded, OPTIONS, None, threads=0, report=lambda _: None)
    near = np.array(loaded.cam_from_model)
    near[2, 3] = 0.0  # in the middle of the hill
    assert not ZBufferRenderer(source.mesh, CAMERA, source.view).can_render(near)
    reduced = rendered_view_of(loaded, choice.setting.pivot_model, choice.mesh)
    with ViewRenderer(loaded, reduced, OPTIONS, None, setting=choice.setting) as renderer:
        before = renderer.render(loaded.cam_from_model)
        renderer.render(near)
        assert np.array_equal(renderer.render(loaded.cam_from_model).rgb, before.rgb)


@pytest.mark.parametrize("shape", ["bumpy_mesh", "stepped_mesh"])
def test_the_z_buffer_sees_what_the_ray_tracer_sees(
    shape, frontal_pose, oblique_pose, sharp_image, loaded_case, request
):
    camera = PinholeCamera(160, 120, 800.0, 790.0, 75.5, 62.25)
    loaded = loaded_case(request.getfixturevalue(shape), sharp_image(camera), frontal_pose, camera)
    source = reference_view_of(loaded)
    raster = ZBufferRenderer(source.mesh, camera, source.view)
    with ViewRenderer(loaded, source, DatasetOptions(), None) as exact:
        for pose in (frontal_pose, oblique_pose):
            traced, view = exact.render(pose), raster.render(pose)
            assert np.count_nonzero(view.mask != traced.mask) <= 2
            assert np.count_nonzero(view.observed != traced.observed) <= 20
            same = view.mask & traced.mask & (view.observed == traced.observed)
            assert np.abs(view.rgb - traced.rgb)[same].mean() * 255 < 0.02
            assert np.median(np.abs(view.depth_mm - traced.depth_mm)[same]) < 5e-4
