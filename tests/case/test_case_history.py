"""What is saved over a pose never ends it: the history has every case as it was, whoever adds to it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oneframe.case.case_changes import differing_fields
from oneframe.case.case_file import read_case
from oneframe.case.case_history import add_to_history, earlier_cases, history_path
from oneframe.case.case_writer import case_text, write_case
from oneframe.case.pose_record import INITIAL_GUESS, OTHER_FRAME, PoseRecord
from oneframe.errors import InputError
from oneframe.transforms import rigid

REFINED = PoseRecord("refined", checked="2030-01-01", error_px=0.4)
RECORDS = (
    REFINED,
    PoseRecord("manual"),
    PoseRecord("landmarks", pairs=6),
    PoseRecord(),
    PoseRecord(INITIAL_GUESS),
    PoseRecord(OTHER_FRAME),
)


def posed(case, number, record):
    return replace(case, cam_from_mesh=rigid(np.eye(3), [number, 0.1, 300 + number / 7]), alignment=record)


@settings(max_examples=10)
@given(st.lists(st.tuples(st.integers(0, 9), st.sampled_from(RECORDS)), min_size=1, max_size=12))
def test_cases_that_are_replaced_are_kept_to_the_last_bit(write_tiny_case, tmp_path_factory, poses):
    path = write_tiny_case(tmp_path_factory.mktemp("case"))
    replaced = []
    for number, record in poses:
        before = read_case(path)
        case = posed(before, number, record)
        write_case(path, case)
        assert np.array_equal(read_case(path).cam_from_mesh, case.cam_from_mesh)
        is_other = not np.array_equal(before.cam_from_mesh, case.cam_from_mesh) or before.alignment != record
        if is_other and not before.alignment.is_start:
            entry = before.cam_from_mesh.tolist(), before.alignment
            replaced += [entry] * (entry not in replaced)
    found = [(each.case.cam_from_mesh.tolist(), each.case.alignment) for each in reversed(earlier_cases(path))]
    assert found == replaced


def test_what_is_restored_is_what_it_was(write_tiny_case, tmp_path):
    path = write_tiny_case(tmp_path)
    first = read_case(path)
    refined = replace(posed(first, 3, REFINED), camera=replace(first.camera, fx=first.camera.fx * 1.1))
    write_case(path, refined)
    write_case(path, posed(first, 5, PoseRecord("manual")))
    latest = earlier_cases(path)[0]
    assert latest.text.endswith("refined, checked 2030-01-01, off by about 0.4 px")
    write_case(path, latest.case)
    assert differing_fields(read_case(path), refined) == ()
    # what stood there is kept in its turn
    assert [each.case.cam_from_mesh[0, 3] for each in earlier_cases(path)] == [5, 3, first.cam_from_mesh[0, 3]]


@pytest.mark.parametrize("damage", ['{"time": 1, "case": 2}', "[]", "{", '{"time": "a", "case": "units = 3"}', "\0"])
def test_a_damaged_history_is_one_sentence_and_goes_on(write_tiny_case, tmp_path, damage):
    """Half a line is what a kill leaves; what comes later is added, and the sentence names the line to delete."""
    path = write_tiny_case(tmp_path)
    write_case(path, posed(read_case(path), 3, REFINED))
    with history_path(path).open("a") as file:
        file.write(damage)
    with pytest.raises(InputError, match=r"^case\.history\.jsonl: line 2: expected an earlier .*; delete the line$"):
        earlier_cases(path)
    case = posed(read_case(path), 4, PoseRecord("manual"))
    add_to_history(path, case, case_text(path, case))
    assert np.array_equal(earlier_cases(path, most=1)[0].case.cam_from_mesh, case.cam_from_mesh)
