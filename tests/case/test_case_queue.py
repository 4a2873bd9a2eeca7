"""A queue keeps every frame as a case of its own, and its state is what the case says."""

from dataclasses import replace

import numpy as np
import pytest

from oneframe.case.case_file import read_case
from oneframe.case.case_queue import (
    ALIGNED,
    CHECKED,
    DOUBTFUL,
    NEW,
    ROUGH,
    NewFrame,
    add_frames,
    queued_cases,
    state_of,
)
from oneframe.case.case_writer import write_case
from oneframe.case.pose_record import PoseRecord
from oneframe.errors import InputError
from oneframe.images.png import encode_png


@pytest.fixture
def like(write_tiny_case, tmp_path):
    return read_case(write_tiny_case(tmp_path / "like"))


def frames(like, *names):
    """Frames of these images; those with a name alone are made."""
    paths = [like.image.parent / name for name in names]
    for path in paths:
        if not path.exists():
            path.write_bytes(like.image.read_bytes())
    return [NewFrame(path) for path in paths]


def test_a_frame_is_added_once_and_never_over_anothers_work(like, tmp_path):
    queue, given = tmp_path / "queue", frames(like, "b.png", "a.png")
    first, second = add_frames(queue, like, given)
    assert queued_cases(queue) == (second, first)
    case = read_case(first, posed=False)
    assert case.image.samefile(like.image.with_name("b.png"))
    assert case.mesh.samefile(like.mesh)
    assert not case.posed
    write_case(first, replace(case, cam_from_mesh=like.cam_from_mesh, posed=True))
    worked = first.read_bytes()
    add_frames(queue, like, given)
    assert first.read_bytes() == worked
    other = image_of(tmp_path / "b.png", like.camera.size_wh)
    for wrong in ("c.png", "C.bmp"), (other,), (image_of(tmp_path / "small.png", (5, 4)),):
        with pytest.raises(InputError):
            add_frames(queue, like, frames(like, "d.png", *wrong))
    assert len(queued_cases(queue)) == 2


def test_images_of_the_same_proportions_scale_k(like, tmp_path):
    width, height = like.camera.size_wh
    (path,) = add_frames(
        tmp_path / "queue", like, [NewFrame(image_of(tmp_path / "half.png", (width // 2, height // 2)))]
    )
    scaled = read_case(path, posed=False).camera
    points = np.array([[0.0, 0.0, 100.0], [7.0, -5.0, 120.0]])
    corners = [camera.project(points) + 0.5 for camera in (like.camera, scaled)]
    np.testing.assert_allclose(corners[1], corners[0] / 2)


def image_of(path, size_wh):
    path.write_bytes(encode_png(np.zeros((*size_wh[::-1], 3), np.uint8)))
    return path


@pytest.mark.parametrize(
    ("record", "state"),
    [
        (PoseRecord(method="another frame", doubt="found in another frame"), ROUGH),
        (PoseRecord(method="pins"), ROUGH),
        (PoseRecord(method="landmarks"), ALIGNED),
        (PoseRecord(method="landmarks", doubt="two poses fit"), DOUBTFUL),
        (PoseRecord(method="refined", refused="14 % explained"), DOUBTFUL),
        (PoseRecord(method="landmarks", doubt="two poses fit", checked="2024-05-06"), CHECKED),
    ],
)
def test_the_state_is_what_the_case_says(like, tmp_path, record, state):
    (path,) = add_frames(tmp_path / "queue", like, frames(like, "a.png"))
    case = read_case(path, posed=False)
    assert state_of(case) == NEW
    write_case(path, replace(case, cam_from_mesh=like.cam_from_mesh, posed=True, alignment=record))
    assert state_of(read_case(path)) == state


def test_names_that_would_leave_the_queue_or_hide_in_it_are_refused(like, tmp_path):
    for name in ("...png", ".a.png", "..png"):
        image = tmp_path / name
        image.write_bytes(like.image.read_bytes())
        with pytest.raises(InputError, match="does not begin with a dot"):
            add_frames(tmp_path / "queue", like, [NewFrame(image)])
    assert not (tmp_path / "queue").exists()
