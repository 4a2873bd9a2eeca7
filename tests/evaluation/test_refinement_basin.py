"""Disturbed poses, trials and their counts; the refinement itself is tested with the alignment."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.camera.pinhole import PinholeCamera
from pipeline.case.case_file import read_case
from pipeline.errors import InputError
from pipeline.evaluation.scenes.refinement_scenes import (
    LMO_OBJECTS,
    RefinementScene,
    bloster_scenes,
    case_scene,
    lmo_scenes,
    visible_points,
)
from pipeline.evaluation.trials.refinement_basin import (
    RIGHT_IMAGE,
    WRONG_IMAGES,
    Disturbance,
    RefinementTrial,
    Tally,
    displacement_px,
    disturbances,
    disturbed_pose,
    read_trials,
    run_trials,
    summary,
    trials_to_csv,
)
from pipeline.images.png import encode_png
from pipeline.surface.mesh import TriangleMesh
from pipeline.surface.mesh_writer import write_ply
from pipeline.transforms import inverse_rigid, rigid, rotation_angle_deg, transform_points

CAMERA = PinholeCamera(160, 120, 800.0, 790.0, 82.0, 58.0)


@pytest.fixture
def scene(bumpy_mesh, oblique_pose) -> RefinementScene:
    """Without anything in the image: the refinement refuses at once, and leaves the pose where it is."""
    points = visible_points(bumpy_mesh, CAMERA, oblique_pose)
    image, valid = np.full((*CAMERA.shape_hw, 3), 0.5, np.float32), np.ones(CAMERA.shape_hw, bool)
    return RefinementScene("hills", image, valid, CAMERA, bumpy_mesh, None, oblique_pose, points, 2.0, 1.0)


@pytest.mark.parametrize(("angle_deg", "percent"), [(0, 0), (5, 0), (0, 8), (10, 5)])
def test_a_disturbance_has_the_size_that_it_says(scene, rng, angle_deg, percent):
    """The middle of the visible surface moves by the percentage, and the rotation by the angle."""
    pose = disturbed_pose(scene, angle_deg, percent, rng)
    change = pose @ inverse_rigid(scene.cam_from_model)
    assert rotation_angle_deg(change[:3, :3]) == pytest.approx(angle_deg, abs=1e-9)
    middle = transform_points(scene.cam_from_model, scene.points).mean(axis=0)
    moved = transform_points(change, middle) - middle
    assert np.linalg.norm(moved) == pytest.approx(percent / 100 * np.linalg.norm(middle), abs=1e-9)
    assert (displacement_px(scene, pose) > 0) == (angle_deg + percent > 0) or displacement_px(scene, pose) < 1e-9


def test_visible_points_are_what_the_camera_sees(bumpy_mesh, oblique_pose, ray_cast):
    points_cam = transform_points(oblique_pose, visible_points(bumpy_mesh, CAMERA, oblique_pose))
    depth_mm, _ = ray_cast(bumpy_mesh, CAMERA, oblique_pose, CAMERA.project(points_cam))
    assert np.median(np.abs(depth_mm - points_cam[:, 2])) < 1e-9
    # points on an edge may belong to either side of it
    assert (np.abs(depth_mm - points_cam[:, 2]) < 1e-6).mean() > 0.99


@given(st.lists(st.integers(1, 9), min_size=1, max_size=3, unique=True), st.integers(0, 4), st.integers(0, 4))
def test_the_plan_holds_every_cell_as_often_as_asked(sizes, trials, wrong):
    planned = disturbances(sizes, sizes, trials, wrong)
    for angle in sizes:
        for percent in sizes:
            assert planned.count(Disturbance(RIGHT_IMAGE, angle, percent)) == trials
    assert [sum(each.image == name for each in planned) for name in WRONG_IMAGES] == [wrong] * len(WRONG_IMAGES)
    assert len(planned) == trials * len(sizes) ** 2 + wrong * len(WRONG_IMAGES)


def test_a_trial_depends_on_the_seed_and_its_number_alone(scene):
    planned = (Disturbance(RIGHT_IMAGE, 0, 0), Disturbance("mirrored", 0.05, 0.01))
    both, first, other = (
        list(run_trials([scene], plan, seed)) for plan, seed in ((planned, 7), (planned[:1], 7), (planned[1:], 8))
    )
    timeless = [{**vars(trial), "seconds": 0} for trial in (both[0], first[0])]
    assert timeless[0] == timeless[1]
    assert both[0].start_px == pytest.approx(0, abs=1e-9)
    assert both[0].right
    for trial in both:
        assert not trial.accepted
        assert trial.error_px == pytest.approx(trial.start_px)
        assert trial.error_deg == pytest.approx(trial.angle_deg, abs=1e-9)
    # close to the truth, but of a wrong image
    assert not both[1].right
    assert both[1].start_px != other[0].start_px


finite = st.floats(0, 1e4).map(lambda value: float(f"{value:.4g}"))
trial_rows = st.builds(
    RefinementTrial,
    scene=st.text('abc ,"é', min_size=1),
    image=st.sampled_from([RIGHT_IMAGE, *WRONG_IMAGES]),
    angle_deg=finite,
    percent=finite,
    start_px=finite,
    error_deg=finite,
    error_px=finite,
    right=st.booleans(),
    accepted=st.booleans(),
    score_before=finite,
    score_after=finite,
    estimated_px_before=finite,
    estimated_px_after=finite,
    split_half_px=st.just(np.inf),
    second_peak_ratio=finite,
    seconds=finite,
    message=st.text('xyz ,;"\n', max_size=9),
)


@given(st.lists(trial_rows, min_size=1, max_size=5))
def test_trials_survive_their_file(tmp_path_factory, trials):
    path = tmp_path_factory.mktemp("trials") / "trials.csv"
    path.write_bytes(trials_to_csv(trials))
    assert read_trials(path) == tuple(trials)


@given(st.lists(trial_rows, min_size=1, max_size=30))
def test_counts_add_up(trials):
    tally = Tally.of(trials)
    assert tally.trials + tally.wrong_images == len(trials)
    assert tally.right_and_accepted <= min(tally.right, tally.accepted) <= max(tally.right, tally.accepted)
    # inclusion and exclusion: what is neither right nor accepted is left
    neither = sum(not t.right and not t.accepted for t in trials if t.image == RIGHT_IMAGE)
    assert tally.right + tally.accepted - tally.right_and_accepted + neither == tally.trials
    assert tally.wrong_images_accepted <= tally.wrong_images
    assert any("wrong images accepted" in line for line in summary(trials)) == (tally.wrong_images > 0)


@pytest.mark.parametrize("content", ["a,b\n1,2\n", "scene\n", "\0", "scene,image\nx,y\n"])
def test_another_table_is_refused(tmp_path, content):
    path = tmp_path / "trials.csv"
    path.write_text(content)
    with pytest.raises(InputError, match=r"trials.csv: expected the trials of benchmark_refinement.py"):
        read_trials(path)


# --- scenes ----------------------------------------------------------------------------------------------------------


def test_the_scene_of_a_case_is_its_frame_at_its_pose(write_tiny_case, tmp_path):
    path = write_tiny_case(tmp_path)
    scene, case = case_scene(path), read_case(path)
    assert scene.mesh.vertices.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-9)
    pixels = scene.camera.project(transform_points(scene.cam_from_model, scene.points))
    assert (pixels >= -0.5).all()
    assert (pixels <= np.array(scene.camera.size_wh) - 0.5).all()
    # the demeaned surface at this pose is the given one at the case's
    offset_mm = scene.cam_from_model[:3, 3] - case.cam_from_mesh[:3, 3]
    assert case.cam_from_mesh[:3, :3].T @ offset_mm == pytest.approx([12.0, -7.0, 40.0], abs=0.5)
    (tmp_path / "frame.png").write_text("text")
    with pytest.raises(InputError, match="expected an image"):
        case_scene(path)


def write_bop_scene(folder, poses: dict) -> None:
    """Octahedra of 40 mm, grey frames of 64x48 px."""
    for name in ("models", "rgb"):
        (folder / name).mkdir(parents=True)
    corners = 20.0 * np.concatenate([np.eye(3), -np.eye(3)])
    faces = [(a, b, c) for a in (0, 3) for b in (1, 4) for c in (2, 5)]
    header = "ply\nformat ascii 1.0\nelement vertex 6\n"
    header += "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    header += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue", "alpha"))
    header += "element face 8\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [" ".join(map(str, [*corner, *(corner / 20), 255, 51, 0, 255])) for corner in corners]
    rows += [" ".join(map(str, (3, *face))) for face in faces]
    for number in LMO_OBJECTS:
        (folder / f"models/obj_{number:06d}.ply").write_text(header + "\n".join(rows) + "\n")
    (folder / "camera.json").write_text(json.dumps({"width": 64, "height": 48, "fx": 90, "fy": 91, "cx": 32, "cy": 24}))
    (folder / "scene_gt.json").write_text(json.dumps(poses))
    for frame in poses:
        (folder / f"rgb/{int(frame):06d}.png").write_bytes(encode_png(np.full((48, 64, 3), 90, np.uint8)))


def test_scenes_of_lmo_take_its_objects_in_turn(tmp_path):
    def posed(number: int, x_mm: float = 0.0) -> dict:
        return {"obj_id": number, "cam_R_m2c": np.eye(3).ravel().tolist(), "cam_t_m2c": [x_mm, 0.0, 120.0]}

    poses = {"3": [posed(1)], "8": [posed(1)], "9": [posed(9), posed(6)], "12": [posed(8, 900.0)]}
    write_bop_scene(tmp_path, poses)
    scenes = lmo_scenes(tmp_path)
    # frame 8 lacks object 5, frame 12 has object 8 out of view
    assert [scene.name for scene in scenes] == ["frame 3 object 1", "frame 9 object 6"]
    for scene in scenes:
        assert scene.colours == pytest.approx(np.tile([1, 0.2, 0], (6, 1)))
        assert scene.cam_from_model == pytest.approx(rigid(translation=np.array([0, 0, 120.0])))
        # on the faces of the octahedron
        assert np.abs(scene.points).sum(axis=1) == pytest.approx(np.full(len(scene.points), 20.0))
        assert isinstance(scene.mesh, TriangleMesh)


def test_an_incomplete_lmo_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"camera.json.*does not exist"):
        lmo_scenes(tmp_path)
    write_bop_scene(tmp_path, {"1": []})
    with pytest.raises(InputError, match="expected frames with objects"):
        lmo_scenes(tmp_path)
    (tmp_path / "scene_gt.json").write_text("[1]")
    with pytest.raises(InputError, match="in BOP's format"):
        lmo_scenes(tmp_path)


def test_scenes_of_bloster_are_coloured_by_the_next_photograph(tmp_path, bumpy_mesh):
    """Views of one plain colour each: a vertex that the next one sees has exactly its colour."""
    write_ply(tmp_path / "mesh_70k.ply", bumpy_mesh.scaled(0.001))
    middle_m = bumpy_mesh.vertices.mean(axis=0) / 1000
    frames, colours = [], ((255, 0, 0), (0, 255, 0))
    for number, colour in enumerate(colours):
        pose = rigid(np.diag([1.0, -1, -1]), np.array([0.0, 0, 0.4 + 0.1 * number])) @ rigid(translation=-middle_m)
        frames.append({"color": f"rgb/{number}.png", "cam_from_world_refined": pose.tolist()})
        (tmp_path / "rgb").mkdir(exist_ok=True)
        (tmp_path / f"rgb/{number}.png").write_bytes(encode_png(np.full((120, 160, 3), colour, np.uint8)))
    k = {"width": 160, "height": 120, "fx": 400.0, "fy": 400.0, "cx": 80.0, "cy": 60.0}
    (tmp_path / "cameras.json").write_text(json.dumps({"color": k, "frames": frames}))
    scenes = bloster_scenes(tmp_path, coloured=True)
    assert [scene.name for scene in scenes] == ["view 0", "view 1"]
    for scene, following, distance_mm in zip(scenes, colours[::-1], (400, 500), strict=True):
        assert scene.colours == pytest.approx(np.tile(np.array(following) / 255, (len(scene.mesh.vertices), 1)))
        assert transform_points(scene.cam_from_model, np.zeros(3))[2] == pytest.approx(distance_mm, abs=0.01)
    assert bloster_scenes(tmp_path, coloured=False)[0].colours is None
    (tmp_path / "cameras.json").write_text("{}")
    with pytest.raises(InputError, match=r"cameras.json of bloster"):
        bloster_scenes(tmp_path, coloured=False)


def test_estimates_are_compared_with_the_truth(scene):
    """Of trials that state twice, and half of, the true error."""
    (trial,) = run_trials([scene], [Disturbance(RIGHT_IMAGE, 5, 5)], 1)
    known = replace(trial, accepted=True, start_px=8.0, error_px=2.0, estimated_px_before=16.0, estimated_px_after=1.0)
    lines = summary([known])
    assert any(line.startswith("estimated / true") and "2.00 / 2.00 / 2.00" in line for line in lines)
    assert any(line.startswith("estimated / true") and "0.50 / 0.50 / 0.50" in line for line in lines)
