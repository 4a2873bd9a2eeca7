"""Refining in the add-on: the function's result, one undo step, refusals, and which colours count as evidence."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from blender_addon.landmarks import solve
from blender_addon.landmarks.drawing import current_uncertainty
from blender_addon.refine import operator
from blender_addon.refine.status_line import status
from blender_addon.setup.alignment_record import pose_record
from blender_addon.state import from_scene, pose_evidence
from blender_addon.state.pose import set_cam_from_model
from blender_addon.ui import frame_view
from oneframe.alignment import align_case as align
from oneframe.alignment.align_case import align_case
from oneframe.alignment.refinement.refine import refine_pose
from oneframe.case.case_file import Case, read_case
from oneframe.case.case_writer import write_case
from oneframe.case.pose_record import PoseRecord
from oneframe.images.png import encode_png
from oneframe.surface.mesh_reader import read_mesh
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import rigid, rotation_angle_deg, rotation_from_vector, transform_points
from tests.addon.conftest import refused
from tests.addon.test_setup import exchange_edited
from tests.alignment.test_refinement import CAMERA, TRUE_POSE, hills, photograph
from tests.remembered import refinement, remembered

START = TRUE_POSE @ rigid(rotation_from_vector(np.radians([1.5, -1.0, 1.0])), np.array([1.0, -1.0, 2.0]))


@pytest.fixture(scope="module")
def case_folder(tmp_path_factory):
    folder, mesh = tmp_path_factory.mktemp("hills"), hills(1, height=2.2 * 1.5**1.5)
    write_ply(folder / "surface.ply", mesh)
    stored, _ = read_mesh(folder / "surface.ply")
    image = np.rint(255 * photograph(stored)).astype(np.uint8)
    (folder / "frame.png").write_bytes(encode_png(image))
    mirrored = np.ascontiguousarray(image[:, ::-1])
    (folder / "mirrored.png").write_bytes(encode_png(mirrored))
    (folder / "flat.png").write_bytes(encode_png(np.full((135, 180, 3), 128, np.uint8)))
    for name, pose in (("start", START), ("true", TRUE_POSE)):
        path = folder / f"{name}.toml"
        write_case(path, Case(path, 1.0, folder / "frame.png", CAMERA, None, folder / "surface.ply", pose))
    return folder


@pytest.fixture(scope="module", autouse=True)
def refined_once():
    once = remembered(refine_pose, refinement())
    with pytest.MonkeyPatch.context() as patch:
        for module in (align, operator):
            patch.setattr(module, "refine_pose", once)
        yield


@pytest.fixture
def opened(addon, case_folder):
    bpy.ops.oneframe.open_case(filepath=str(case_folder / "start.toml"))
    return bpy.context.scene


def rotation_error_deg(scene) -> float:
    mesh_from_model = from_scene.mesh_from_model_of(from_scene.surface_of(scene))
    true = TRUE_POSE @ mesh_from_model
    return rotation_angle_deg(from_scene.cam_from_model(scene)[:3, :3] @ true[:3, :3].T)


def saved(scene, path):
    bpy.ops.oneframe.save_case(filepath=str(path))
    return read_case(path)


def test_the_operator_gives_the_scripts_pose_and_record_in_one_undo_step(opened, tmp_path):
    rough = saved(opened, tmp_path / "rough.toml")
    script = align_case(rough, click_sigma_px=2.0, refine=True, tool="t", date="2030-01-01").loaded.case
    start, before = from_scene.cam_from_model(opened), rotation_error_deg(opened)
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.oneframe.refine() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="refined")
    refined, message = from_scene.cam_from_model(opened), operator.outcome(opened).message
    assert rotation_error_deg(opened) < min(0.5, before / 3)
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert np.array_equal(from_scene.cam_from_model(scene), start)
    # the outcome belongs to the refined pose only
    assert operator.outcome(scene) is None
    bpy.ops.ed.redo()
    assert np.array_equal(from_scene.cam_from_model(bpy.context.scene), refined)
    assert operator.outcome(bpy.context.scene).message == message
    case = saved(bpy.context.scene, tmp_path / "refined.toml")
    assert np.array_equal(case.cam_from_mesh, script.cam_from_mesh)
    assert replace(case.alignment, tool="t", date="2030-01-01") == script.alignment
    assert (case.alignment.method, case.alignment.start_method) == ("refined", "manual")
    assert case.alignment.error_px > 0
    assert not case.alignment.refused


def test_a_refused_pose_is_taken_by_choice_marked_as_such_and_undone(opened, case_folder, tmp_path):
    opened.oneframe.frame_path = str(case_folder / "mirrored.png")
    start = from_scene.cam_from_model(opened)
    refused(bpy.ops.oneframe.refine, "Refused, the pose is unchanged")
    assert np.array_equal(from_scene.cam_from_model(opened), start)
    found = operator.outcome(opened).found
    # shown, it is named as what it is; the pose before it is unchanged
    assert "Refused: " in status(opened)[0]
    set_cam_from_model(opened, found)
    bpy.context.view_layer.update()
    assert "Preview of a refused pose, off by ≥ " in status(opened)[0]
    set_cam_from_model(opened, start)
    bpy.ops.ed.undo_push(message="refused")
    assert bpy.ops.oneframe.refine(take_refused=True) == {"FINISHED"}
    bpy.ops.ed.undo_push(message="taken")
    assert np.array_equal(from_scene.cam_from_model(opened), found)
    assert operator.is_taken(opened)
    assert "Taken although refused, off by at least" in status(opened)[0]
    message = operator.outcome(opened).message
    # so Save Case asks
    assert any(operator.outcome(opened).objection in doubt for doubt in status(opened)[1])
    assert current_uncertainty(opened, solve.solution(opened)) is None
    bpy.ops.ed.undo()
    assert np.array_equal(from_scene.cam_from_model(bpy.context.scene), start)
    bpy.ops.ed.redo()
    case = saved(bpy.context.scene, tmp_path / "taken.toml")
    assert case.alignment.method == "refined"
    assert case.alignment.refused in message
    # also once it is opened again
    bpy.ops.oneframe.open_case(filepath=str(case.path))
    assert operator.is_taken(bpy.context.scene)
    assert saved(bpy.context.scene, tmp_path / "again.toml").alignment == case.alignment
    # refined again from there, and not taken: the new refusal is no pose that somebody took
    bpy.context.scene.oneframe.frame_path = str(case_folder / "flat.png")
    refused(bpy.ops.oneframe.refine, "Refused")
    assert not operator.is_taken(bpy.context.scene)
    assert pose_record(bpy.context.scene).refused == case.alignment.refused
    # a plain picture finds none that could be taken
    refused(bpy.ops.oneframe.refine, "Refused", take_refused=True)


def test_a_refined_pose_stays_when_landmarks_change(opened, case_folder):
    """Landmarks, then refinement from there: only Solve leads back, and figures shown are those of the current pose."""

    def uncertainty_px(scene):
        found = current_uncertainty(scene, solve.solution(scene))
        return None if found is None else found[0].translation_mm.tolist()

    opened.oneframe.click_sigma_px = 1.5
    true = TRUE_POSE @ from_scene.mesh_from_model_of(from_scene.surface_of(opened))
    clicks_px = np.array([[23.0, 17], [157, 23], [151, 112], [29, 118], [90, 67], [56, 39]])
    rng = np.random.default_rng(3)
    points = [frame_view.surface_point_at(opened, pixel) for pixel in clicks_px]
    pixels = CAMERA.project(transform_points(true, np.array(points))) + rng.normal(0, 1.5, clicks_px.shape)
    for point, pixel in zip(points, pixels, strict=True):
        bpy.ops.oneframe.landmark_set(name="", point=point, pixel=np.clip(pixel, 0, [179, 134]))
    by_landmarks, of_landmarks = from_scene.cam_from_model(opened), uncertainty_px(opened)
    assert solve.is_current(opened, solve.solution(opened))

    bpy.ops.oneframe.refine()
    refined = operator.outcome(opened).found
    assert np.array_equal(from_scene.cam_from_model(opened), refined)
    assert np.less(uncertainty_px(opened), of_landmarks).all()
    record = pose_record(opened)
    assert (record.method, record.start_method) == ("refined", "landmarks")
    assert status(opened)[0].endswith("Next: Save Case")
    bpy.ops.oneframe.landmark_remove(index=0)
    assert np.array_equal(from_scene.cam_from_model(opened), refined)
    bpy.ops.oneframe.landmark_set(name="", point=points[0], pixel=np.clip(pixels[0], 0, [179, 134]))
    bpy.ops.oneframe.solve_landmarks()
    assert np.allclose(from_scene.cam_from_model(opened), by_landmarks, rtol=0, atol=1e-6)
    assert pose_record(opened).method == "landmarks"
    # moved by hand: no figure holds any more
    bpy.ops.oneframe.nudge(axis="x")
    assert uncertainty_px(opened) is None
    # another frame's image says nothing of it
    bpy.ops.oneframe.load_frame(filepath=str(case_folder / "mirrored.png"))
    assert operator.outcome(opened) is None
    assert set(pose_record(opened).table()) == {"method", "doubt", "tool", "date"}


def test_what_a_refined_pose_rests_on_follows_units_and_frame(opened, case_folder, tmp_path):
    """The picture stays, so its evidence does: figures in mm scale with the surface, pixels and degrees stay."""

    def known() -> tuple[PoseRecord, np.ndarray, np.ndarray]:
        uncertainty = pose_evidence.remembered_uncertainty(opened)
        pose, mesh_from_model = (
            from_scene.cam_from_model(opened),
            from_scene.mesh_from_model_of(from_scene.surface_of(opened)),
        )
        corners = np.array([[0.0, 0, 0], [30, -20, 5], [-10, 25, -5]])
        points = from_scene.MM_PER_UNIT[opened.oneframe.units] * corners - mesh_from_model[:3, 3]
        return (
            pose_evidence.remembered(opened),
            uncertainty.pixel_covariances(points, from_scene.camera(opened), pose),
            from_scene.camera(opened).project(transform_points(pose, uncertainty.pivot_model[None])),
        )

    bpy.ops.oneframe.refine()
    record, covariances, pivot_px = known()
    bpy.ops.oneframe.change_units(units="m")
    scaled, scaled_covariances, scaled_pivot_px = known()
    assert pose_evidence.is_refined(opened)
    assert np.allclose(scaled.standard_deviation_mm, 1000 * np.array(record.standard_deviation_mm), rtol=1e-12)
    assert replace(scaled, standard_deviation_mm=record.standard_deviation_mm) == record
    assert np.allclose(scaled_covariances, covariances, rtol=1e-5)
    assert np.allclose(scaled_pivot_px, pivot_px, atol=1e-6)
    (tmp_path / "case").mkdir()
    bpy.ops.oneframe.save_case(filepath=str(tmp_path / "case" / "case.toml"))
    case = read_case(tmp_path / "case" / "case.toml")
    assert case.alignment == scaled

    bpy.ops.oneframe.change_units(units="mm")
    back = pose_evidence.remembered(opened)
    assert np.allclose(back.standard_deviation_mm, record.standard_deviation_mm, rtol=1e-12)
    # an edit moves the mean of the vertices, which is the origin of the frame `model`
    data = from_scene.surface_of(opened).data
    data.vertices[0].co.z += 50
    exchange_edited(tmp_path / "edited.ply")
    edited, edited_covariances, edited_pivot_px = known()
    assert edited == back
    assert np.allclose(edited_covariances, covariances, rtol=1e-4)
    assert np.allclose(edited_pivot_px, pivot_px, atol=1e-6)
