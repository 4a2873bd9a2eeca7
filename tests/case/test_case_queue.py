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
    add_frames,
    queued_cases,
    state_of,
)
from oneframe.case.case_update import update_case
from oneframe.errors import InputError
from oneframe.images.png import encode_png


@pytest.fixture
def like(write_tiny_case, tmp_path):
    return read_case(write_tiny_case(tmp_path / "like"))


def frames(like, *names):
    paths = [like.image.with_name(name) for name in names]
    for path in paths:
        path.write_bytes(like.image.read_bytes())
    return [(path, None) for path in paths]


def test_a_frame_is_added_once_and_never_over_anothers_work(like, tmp_path):
    queue, given = tmp_path / "queue", frames(like, "b.png", "a.png")
    first, second = add_frames(queue, like, given)
    assert queued_cases(queue) == (second, first)
    case = read_case(first, posed=False)
    assert case.image.samefile(like.image.with_name("b.png"))
    assert case.mesh.samefile(like.mesh)
    assert not case.posed
    update_case(first, replace(case, cam_from_mesh=like.cam_from_mesh, posed=True))
    worked = first.read_bytes()
    add_frames(queue, like, given)
    assert first.read_bytes() == worked
    (tmp_path / "small.png").write_bytes(encode_png(np.zeros((4, 5, 3), np.uint8)))
    small = [(tmp_path / "small.png", None)]
    for wrong in (frames(like, "c.png", "C.bmp"), [(like.image, None), (tmp_path / "b.png", None)], small):
        with pytest.raises(InputError):
            add_frames(queue, like, wrong)
    assert len(queued_cases(queue)) == 2


@pytest.mark.parametrize(
    ("record", "state"),
    [
        ({"method": "another frame", "doubt": "found in another frame"}, ROUGH),
        ({"method": "pins"}, ROUGH),
        ({"method": "landmarks"}, ALIGNED),
        ({"method": "landmarks", "doubt": "two poses fit"}, DOUBTFUL),
        ({"method": "refined", "refused": "14 % explained"}, DOUBTFUL),
        ({"method": "landmarks", "doubt": "two poses fit", "checked": "2024-05-06"}, CHECKED),
    ],
)
def test_the_state_is_what_the_case_says(like, tmp_path, record, state):
    (path,) = add_frames(tmp_path / "queue", like, frames(like, "a.png"))
    case = read_case(path, posed=False)
    assert state_of(case) == NEW
    update_case(path, replace(case, cam_from_mesh=like.cam_from_mesh, posed=True, alignment=record))
    assert state_of(read_case(path)) == state
