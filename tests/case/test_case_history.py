"""What is saved over a pose never ends it: the last five come back to the last bit, and name no file."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oneframe.case.case_file import read_case
from oneframe.case.case_history import MOST, earlier_poses, history_path
from oneframe.case.case_update import update_case
from oneframe.case.case_writer import write_case
from oneframe.case.pose_record import INITIAL_GUESS, OTHER_FRAME, PoseRecord
from oneframe.errors import InputError
from oneframe.transforms import rigid

REFINED = PoseRecord("refined", checked="2030-01-01", start_frame="patient.png", error_px=0.4)
RECORDS = (REFINED, PoseRecord("manual"), PoseRecord("landmarks", pairs=6), PoseRecord(), PoseRecord(INITIAL_GUESS))


def posed(case, number, record):
    return replace(case, cam_from_mesh=rigid(np.eye(3), [number, 0.1, 300 + number / 7]), alignment=record)


@pytest.mark.parametrize("save", [update_case, write_case])
@settings(max_examples=5)
@given(st.lists(st.tuples(st.integers(0, 9), st.sampled_from(RECORDS)), min_size=1, max_size=12))
def test_poses_that_are_replaced_are_kept_the_latest_first(write_tiny_case, tmp_path_factory, save, poses):
    path = write_tiny_case(tmp_path_factory.mktemp("case"))
    model = []
    for number, record in poses:
        before = read_case(path)
        case = posed(before, number, record)
        save(path, case)
        assert np.array_equal(read_case(path).cam_from_mesh, case.cam_from_mesh)
        known = replace(before.alignment, start_frame="")
        if not np.array_equal(before.cam_from_mesh, case.cam_from_mesh) and known.method != INITIAL_GUESS:
            entry = before.cam_from_mesh.tolist(), known
            model = [entry, *(each for each in model if each != entry)]
    found = [(each.cam_from_mesh.tolist(), each.alignment) for each in earlier_poses(path)]
    assert found[: MOST - 1] == model[: MOST - 1]
    assert len(found) == min(len(model), MOST)
    assert all(each in model for each in found)
    if history_path(path).exists():
        assert "patient" not in history_path(path).read_text()


def test_a_pose_that_was_found_outlives_five_that_were_not(write_tiny_case, tmp_path):
    path = write_tiny_case(tmp_path)
    for number in range(9):
        update_case(path, posed(read_case(path), number, REFINED if number == 1 else PoseRecord("manual")))
    assert [each.cam_from_mesh[0, 3] for each in earlier_poses(path)] == [7, 6, 5, 4, 1]


def test_the_command_lists_the_earlier_poses_and_takes_one_back(write_tiny_case, tmp_path, run_oneframe):
    path = write_tiny_case(tmp_path)
    path.write_text(path.read_text() + "# mine\n")
    first = read_case(path)
    refined = posed(first, 3, REFINED)
    refined = replace(refined, camera=replace(first.camera, fx=first.camera.fx * 1.1))
    update_case(path, refined)
    update_case(path, posed(first, 5, PoseRecord("manual")))
    before = path.read_bytes()
    said = run_oneframe("align", path, "--restore").stdout
    assert "1: refined, checked 2030-01-01, off by about 0.4 px; replaced 20" in said
    assert path.read_bytes() == before
    assert "the pose and its K as before: refined" in run_oneframe("align", path, "--restore", "1").stdout
    restored = read_case(path)
    assert (restored.camera, restored.alignment.checked) == (refined.camera, "2030-01-01")
    assert np.array_equal(restored.cam_from_mesh, refined.cam_from_mesh)
    assert "# mine" in path.read_text()
    # what stood there is kept in its turn
    assert [each.cam_from_mesh[0, 3] for each in earlier_poses(path)] == [5, 3, first.cam_from_mesh[0, 3]]
    for wrong, message in ((["4"], "expected an earlier pose from 1 to 3, found 4"), (["1", "--refine"], "alone")):
        ended = run_oneframe("align", path, "--restore", *wrong)
        assert ended.returncode
        assert message in ended.stderr


def test_another_case_in_the_file_has_no_history_of_the_one_before(write_tiny_case, tmp_path):
    path = write_tiny_case(tmp_path)
    update_case(path, posed(read_case(path), 3, REFINED))
    (tmp_path / "other.png").write_bytes((tmp_path / "frame.png").read_bytes())
    write_case(path, posed(replace(read_case(path), image=tmp_path / "other.png"), 4, PoseRecord()))
    assert earlier_poses(path) == ()


def test_a_pose_of_another_frame_and_a_damaged_history_are_no_poses(write_tiny_case, tmp_path):
    path = write_tiny_case(tmp_path)
    update_case(path, posed(read_case(path), 3, PoseRecord(OTHER_FRAME)))
    update_case(path, posed(read_case(path), 4, PoseRecord()))
    assert len(earlier_poses(path)) == 1
    history_path(path).write_text('[{"cam_from_mesh": 1}]')
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"case.history.json: number 1: expected an earlier pose"):
        update_case(path, posed(read_case(path), 5, PoseRecord()))
    assert path.read_bytes() == before
