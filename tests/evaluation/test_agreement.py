"""Two poses of a frame are as far apart as they were moved, and as their stated errors let expect."""

from dataclasses import replace

import numpy as np
import pytest

from oneframe.case.case_file import read_case
from oneframe.case.case_queue import NewFrame, add_frames, queued_cases
from oneframe.case.case_update import update_case
from oneframe.case.loaded_case import frame_overlay, load_case
from oneframe.errors import InputError
from oneframe.evaluation.agreement import agreement, agreements, pair_picture, paired_cases
from oneframe.images.contact_sheet import GAP_PX
from oneframe.images.image_reader import read_image
from oneframe.images.pixel_values import to_uint8
from oneframe.images.png import encode_png
from oneframe.surface.mesh_reader import read_mesh
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import rigid, rotation_from_vector, transform_points

DEVIATIONS = {"standard_deviation_deg": [0.2, 0.3, 0.1], "standard_deviation_mm": [0.1, 0.2, 1.0]}


@pytest.fixture
def case(write_tiny_case, tmp_path):
    return read_case(write_tiny_case(tmp_path / "like"))


def middle_of(loaded):
    return transform_points(loaded.frame.cam_from_model, loaded.surface.mesh.vertices.mean(axis=0))


def moved(loaded, vector, shift_mm):
    """The case, turned about the middle of its surface and shifted, in camera axes."""
    middle, turn = middle_of(loaded), rotation_from_vector(vector)
    twist = rigid(turn, middle + shift_mm - turn @ middle)
    return loaded.posed(twist @ loaded.case.cam_from_mesh, loaded.case.alignment)


def test_apart_as_it_was_moved(case):
    loaded = load_case(case)
    found = agreement("a", loaded, moved(loaded, np.zeros(3), np.array([1.0, 0.0, 0.0])))
    assert found.angle_deg == pytest.approx(0, abs=1e-6)
    assert found.shift_mm == pytest.approx(1, abs=1e-6)
    assert found.px == pytest.approx(case.camera.fx / middle_of(loaded)[2], rel=0.2)
    assert np.isnan(found.expected_px)
    turned = moved(loaded, np.radians([0.0, 0.0, 3.0]), np.zeros(3))
    assert agreement("a", loaded, turned).angle_deg == pytest.approx(3)


def test_errors_as_stated_are_what_is_expected(case):
    """Two annotators whose errors follow their stated deviations are apart by the expected distance."""
    rng = np.random.default_rng(4)
    stated = load_case(replace(case, alignment=DEVIATIONS))
    squares = []
    for _ in range(60):
        drawn = []
        for _ in range(2):
            angles = rng.normal(0, np.radians(DEVIATIONS["standard_deviation_deg"]))
            drawn.append(moved(stated, angles, rng.normal(0, DEVIATIONS["standard_deviation_mm"])))
        found = agreement("a", *drawn)
        squares.append((found.px / found.expected_px) ** 2)
    assert np.mean(squares) == pytest.approx(1, abs=0.35)


def test_queues_are_paired_by_name_where_both_have_a_pose(case, tmp_path, run_oneframe):
    images = []
    for name in ("a.png", "b.png", "c.png"):
        images.append(NewFrame(case.image.with_name(name)))
        images[-1].image.write_bytes(case.image.read_bytes())
    queues = tmp_path / "anna", tmp_path / "ben"
    for queue, shift in zip(queues, (0.0, 0.5), strict=True):
        posed = moved(load_case(case), np.zeros(3), np.array([shift, 0.0, 0.0])).case
        for path in add_frames(queue, case, images)[: 3 - (queue == queues[1])]:
            update_case(path, replace(read_case(path, posed=False), cam_from_mesh=posed.cam_from_mesh, posed=True))
    assert [name for name, _, _ in paired_cases(*queues)] == ["a", "b"]
    assert len(queued_cases(queues[1])) == 3
    ended = run_oneframe("agree", *queues, "--out", tmp_path / "out", "--pictures", 1)
    assert ended.returncode == 0, ended.stderr
    assert "2 pairs of poses: median 0.00 degrees, 0.50 mm" in ended.stdout
    assert sorted(path.suffix for path in (tmp_path / "out").iterdir()) == [".csv", ".png"]


def test_the_picture_shows_both_overlays(case):
    loaded = load_case(case)
    shown, picture = to_uint8(frame_overlay(loaded)), pair_picture(loaded, loaded)
    height, width = shown.shape[:2]
    for left in (GAP_PX, width + 2 * GAP_PX):
        assert np.array_equal(picture[GAP_PX : GAP_PX + height, left : left + width], shown)


def test_other_photographs_and_surfaces_are_told_by_what_they_hold(case, tmp_path):
    """Under the same names; a mask, a copy in other bytes and meshes in metres make no difference."""
    (tmp_path / "other").mkdir()
    image, mesh = read_image(case.image)[0], read_mesh(case.mesh)[0]
    codes = to_uint8(image)
    masked = np.dstack([codes, np.full(codes.shape[:2], 255, np.uint8)])
    masked[:8, :, 3] = 0
    masked[:8, :, :3] = 0
    paths = {name: tmp_path / "other" / name for name in ("frame.png", "surface.ply")}

    def found(pixels=codes, surface=mesh, unit=1.0):
        paths["frame.png"].write_bytes(encode_png(pixels))
        write_ply(paths["surface.ply"], surface.scaled(1 / unit))
        other = replace(case, image=paths["frame.png"], mesh=paths["surface.ply"], mm_per_unit=unit)
        return next(agreements([("a", case, other)]))[0]

    for same in ({}, {"pixels": masked}, {"unit": 1000.0}):
        assert found(**same).px == pytest.approx(0, abs=1e-3)
    other_faces = replace(mesh, faces=np.roll(mesh.faces[:-1], 1, axis=0))
    for other, message in (
        ({"pixels": codes[:, ::-1].copy()}, "a: expected the same photograph"),
        ({"surface": other_faces}, "a: expected the same surface"),
        ({"surface": mesh.moved(np.array([0.0, 0.0, 0.1]))}, "a: expected the same surface"),
    ):
        with pytest.raises(InputError, match=message):
            found(**other)
