"""The film's frames in the add-on: found where they are, looked at without a trace, a correction, colour sources."""

import bpy
import numpy as np
import pytest

from blender_addon.frames import film_poses
from blender_addon.setup import queued
from blender_addon.setup.alignment_record import recorded_case
from blender_addon.state import frame_in_view, from_scene, pose_evidence
from blender_addon.state.scene_files import forget_stamps
from blender_addon.video import session, shown_frame
from oneframe.case import case_queue
from oneframe.case.case_file import read_case
from oneframe.case.pose_record import OTHER_FRAME, REGISTERED, PoseRecord
from oneframe.registration.register import Registrar
from oneframe.registration.verdict import ACCEPTED, DOUBTFUL, REFUSED
from oneframe.transforms import inverse_rigid, rotation_angle_deg
from tests.addon.conftest import refused
from tests.alignment.test_refinement import hills
from tests.registration.test_registration import SOURCE, photograph, seen_from, write_case
from tests.remembered import registration, remembered
from tests.video.surgical_film import write_film

POSES = [seen_from(8, 5), seen_from(-20, 30), seen_from(15, 90)]
MIRRORED = len(POSES)
"""Number of the frame that shows another surface."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made, mesh = tmp_path_factory.mktemp("case"), hills(1)
    write_case(made, mesh, SOURCE)
    images = [*(photograph(mesh, pose) for pose in POSES), photograph(mesh, SOURCE)[:, ::-1]]
    write_film(made / "film.avi", [np.rint(255 * image[..., ::-1]).astype(np.uint8) for image in images], "MJPG")
    return made


@pytest.fixture(scope="module", autouse=True)
def registered_once():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Registrar, "find", remembered(Registrar.find, registration))
        yield


@pytest.fixture
def tmp_path(tmp_path):
    """Without the cases of other tests beside it, which would be a queue."""
    (tmp_path / "alone").mkdir()
    return tmp_path / "alone"


@pytest.fixture
def opened(addon, folder, tmp_path):
    def opened(name, alignment=""):
        case = tmp_path / name
        text = (folder / name).read_text() + alignment
        for file in ("frame.png", "surface.ply"):
            text = text.replace(f'= "{file}"', f'= "{folder}/{file}"')
        case.write_text(text)
        bpy.ops.oneframe.open_case(filepath=str(case))
        bpy.ops.oneframe.open_video(filepath=str(folder / "film.avi"))
        return bpy.context.scene

    return opened


def is_at(pose, true):
    off_deg = rotation_angle_deg(pose[:3, :3] @ true[:3, :3].T)
    return off_deg < 0.5 and np.linalg.norm((pose - true)[:3, 3]) < 1.0


def plain(value):
    """A custom property's value, not its address."""
    for unpack in ("to_dict", "to_list"):
        if hasattr(value, unpack):
            return getattr(value, unpack)()
    return [plain(each) for each in value] if isinstance(value, list) else value


def properties(owner):
    return str({key: plain(value) for key, value in owner.items()})


def state_of(scene, path):
    """All that looking might change: the saved case, the scene's own properties, and the picture behind the camera."""
    bpy.ops.oneframe.save_case(filepath=str(path))
    objects = [(each.name, np.array(each.matrix_world).tobytes(), properties(each)) for each in scene.objects]
    shown = scene.oneframe.camera_object.data.background_images[0].image.name
    return path.read_bytes(), objects, properties(scene.oneframe), shown, scene.oneframe_view.opacity


def test_frames_are_found_looked_at_without_a_trace_and_colour_the_surface(opened, tmp_path):
    scene = opened("case.toml")
    bpy.ops.oneframe.case_frame()
    bpy.ops.oneframe.landmark_set(point=(1, 2, 3), pixel=(100, 100))
    bpy.ops.oneframe.project_colour()
    before = state_of(scene, tmp_path / "case.toml")
    shown_frame.show(scene, 1)
    assert frame_in_view.other(scene) == ("frame 1 of film.avi", "not registered", None)
    bpy.ops.oneframe.register_frames()
    frames, mesh_from_model = film_poses.of(scene).frames, from_scene.mesh_from_model_of(scene.oneframe.surface)
    for at in range(MIRRORED + 1):
        verdict, pose = frames[at].verdict, frames[at].cam_from_model
        shown_frame.show(scene, at)
        assert frame_in_view.other(scene).cam_from_model is pose
        if at == MIRRORED:
            assert (verdict.state, pose, frame_in_view.other(scene).text) == (REFUSED, None, "lost")
            continue
        assert verdict.state == ACCEPTED
        assert is_at(pose @ inverse_rigid(mesh_from_model), POSES[at])
        # what is done in the view would go to the case's own frame
        for operator in (bpy.ops.oneframe.nudge, bpy.ops.oneframe.landmark_set):
            refused(operator, r"found frame \d of film.avi; press Back")
    bpy.ops.oneframe.case_frame()
    assert frame_in_view.other(scene) is None
    assert state_of(scene, tmp_path / "case.toml") == before
    # what was found holds for the pose that it began with
    bpy.ops.oneframe.nudge(step_px=1.0)
    assert film_poses.of(scene) is None


@pytest.mark.parametrize("state", [ACCEPTED, DOUBTFUL, REFUSED])
def test_a_frame_takes_its_pose_along_and_one_undo_brings_all_back(opened, tmp_path, state):
    unsure = "standard_deviation_deg = [0.8, 0.8, 0.8]\nstandard_deviation_mm = [1.0, 1.0, 8.0]\n"
    scene = opened("case.toml", f'[alignment]\nmethod = "landmarks"\n{unsure if state == DOUBTFUL else ""}')
    bpy.ops.oneframe.case_frame()
    bpy.ops.oneframe.landmark_set(point=(1, 2, 3), pixel=(100, 100))
    bpy.ops.oneframe.register_frames()
    at = MIRRORED if state == REFUSED else 1
    before, taken = state_of(scene, tmp_path / "case.toml"), film_poses.frame_at(scene, at)
    bpy.ops.ed.undo_push(message="registered")
    # also while the case's own frame is in view
    session.of(scene).show(at)
    bpy.ops.oneframe.take_frame()
    bpy.ops.ed.undo_push(message="taken")
    scene = bpy.context.scene
    case = recorded_case(scene, tmp_path / "taken.toml")
    record = case.alignment
    assert (taken.verdict.state, case.video, case.landmarks[0].pixel) == (state, ("film.avi", at), None)
    if state == REFUSED:
        assert record.method == OTHER_FRAME
        assert is_at(case.cam_from_mesh, SOURCE)
    else:
        origin = record.method, record.start_method, record.start_frame
        assert origin == (REGISTERED, "landmarks", "frame.png")
        assert is_at(case.cam_from_mesh, POSES[at])
        assert np.allclose(record.standard_deviation_mm, np.sqrt(np.diag(taken.uncertainty.covariance)[:3]))
        assert case_queue.state_of(case) == (case_queue.DOUBTFUL if state == DOUBTFUL else case_queue.ALIGNED)
        assert PoseRecord.of_table(record.table(), "record") == record
    # the film's picture of the case's own frame has the pose of the case
    shown_frame.show(scene, at)
    assert frame_in_view.other(scene) is None
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert state_of(scene, tmp_path / "case.toml") == before
    assert film_poses.frame_at(scene, at) is taken


def forget():
    """As another session of Blender begins."""
    film_poses._known.clear()
    forget_stamps()


def test_found_frames_are_kept_beside_the_case_for_its_pose_and_film(opened, folder, tmp_path):
    opened("case.toml")
    bpy.ops.oneframe.register_frames()
    bpy.ops.oneframe.nudge(step_px=1.0)
    bpy.ops.oneframe.register_frames()
    # a run from another pose leaves those of the saved one, and so does one that was saved elsewhere
    (tmp_path / "other").mkdir()
    bpy.ops.oneframe.save_case(filepath=str(tmp_path / "other" / "case.toml"))
    forget()
    for path in (tmp_path / "case.toml", tmp_path / "other" / "case.toml"):
        bpy.ops.oneframe.open_case(filepath=str(path))
        assert len(film_poses.of(bpy.context.scene).frames) == MIRRORED + 1
    # another film of the same name
    other = tmp_path / "film.avi"
    other.write_bytes((folder / "film.avi").read_bytes() + b"0000")
    bpy.ops.oneframe.open_video(filepath=str(other))
    assert film_poses.of(bpy.context.scene) is None


def test_found_frames_go_into_the_queue_at_their_poses(opened, tmp_path):
    scene = opened("case.toml", '[alignment]\nmethod = "landmarks"\n')
    bpy.ops.oneframe.register_frames()
    frames = film_poses.of(scene).frames
    shown_frame.show(scene, MIRRORED)
    bpy.ops.oneframe.queue_video_frames()
    bpy.ops.oneframe.queue_found(count=1)
    bpy.ops.oneframe.queue_found(count=30)
    refused(bpy.ops.oneframe.queue_found, "no case yet", count=30)
    paths = case_queue.queued_cases(tmp_path / "queue")
    cases = {case.video[1]: case for path in paths if (case := read_case(path, posed=False)).video}
    assert len(paths) == 1 + MIRRORED + 1
    assert not cases.pop(MIRRORED).posed
    mesh_from_model = from_scene.mesh_from_model_of(scene.oneframe.surface)
    for number, case in cases.items():
        np.testing.assert_allclose(case.cam_from_mesh @ mesh_from_model, frames[number].cam_from_model, atol=1e-9)
        assert case.alignment.method == REGISTERED
        assert case.alignment.probability == frames[number].verdict.probability
        assert case.alignment.start_frame == "frame.png"
        assert case_queue.state_of(case) == case_queue.ALIGNED
    # after another start, from any frame of the queue, as long as the first frame has the pose that they go by
    forget()
    bpy.ops.oneframe.open_case(filepath=str(cases[2].path))
    scene = bpy.context.scene
    np.testing.assert_allclose(
        pose_evidence.remembered_uncertainty(scene).covariance, frames[2].uncertainty.covariance, rtol=1e-9
    )
    assert film_poses.of(scene).reference.name == "frame.png"
    bpy.ops.oneframe.queue_check()
    here = queued.position(scene)
    bpy.ops.oneframe.queue_step(step=-here)
    states = [entry.state for entry in queued.queue_of(scene)]
    visited = []
    for _ in states:
        bpy.ops.oneframe.queue_unfinished()
        visited.append(queued.position(scene))
    left = [at for at, state in enumerate(states) if state != case_queue.CHECKED]
    assert set(visited) == set(left)
    assert len(left) == len(states) - 1
