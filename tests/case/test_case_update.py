"""Saving over a case file: what is written is read back, and everything else in the file stays as it was."""

import re
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oneframe.case.case_file import case_from_text, read_case
from oneframe.case.case_update import differing_fields, update_case, updated_text
from oneframe.case.case_writer import case_text
from oneframe.case.landmarks import Landmark
from oneframe.errors import InputError
from oneframe.transforms import rigid
from tests.case.test_case_writer import cases

SECTIONS = (
    "frame",
    "camera",
    "surface",
    "pose",
    "frames",
    "alignment",
    "light",
    "landmarks",
    "structures",
    "dataset",
)


def changed(data, case, other):
    """A case with some fields of another one; its landmarks in part the same."""
    names = [field.name for field in fields(case) if field.name not in ("path", "messages")]
    taken = data.draw(st.sets(st.sampled_from(names)))
    new = replace(case, **{name: getattr(other, name) for name in taken})
    if "landmarks" not in taken and case.landmarks:
        kept = data.draw(st.permutations(case.landmarks))[: data.draw(st.integers(0, len(case.landmarks)))]
        new = replace(new, landmarks=tuple(kept))
    return new


def by_hand(data, text):
    """The text as somebody would write it: other order of sections, comments, spaces, line breaks."""
    (head, *rest), comments = text.rstrip("\n").split("\n\n"), []
    sections = data.draw(st.permutations(SECTIONS))
    lines = []
    for line in "\n".join([head, *sorted(rest, key=lambda block: sections.index(section_in(block)))]).split("\n"):
        begins = " = " in line or line.startswith("[")
        if begins and data.draw(st.booleans()):
            comments.append(f"# {len(comments)} [of] the = author's")
            lines.append(data.draw(st.sampled_from(["", "  "])) + comments[-1])
        if begins and "#" not in line and not line.endswith("[") and data.draw(st.booleans()):
            line += "   # behind"
        lines += [line] + [""] * data.draw(st.integers(0, int(begins and not line.endswith("["))))
    newline = data.draw(st.sampled_from(["\n", "\r\n"]))
    end = data.draw(st.sampled_from(["", newline]))
    return newline.join(lines) + end, comments


def section_in(block):
    return re.search(r"^\[+(\w+)", block, re.MULTILINE)[1]


@settings(max_examples=10)
@given(data=st.data())
def test_only_what_has_changed_is_rewritten(data, tmp_path_factory):
    folder = tmp_path_factory.getbasetemp()
    case, other = data.draw(cases(folder)), data.draw(cases(folder))
    path, new = case.path, changed(data, case, other)
    text, comments = by_hand(data, case_text(path, case))
    newline = "\r\n" if "\r\n" in text else "\n"
    assert updated_text(path, text, case) == text + ("" if text.endswith("\n") else newline)
    result = updated_text(path, text, new)
    assert differing_fields(case_from_text(result, path), new) == ()
    kept = [line.strip() for line in result.split("\n") if line.strip() in comments]
    # one that stands in what is removed goes with it, or before what follows it
    assert sorted(kept) == sorted(comments) if keys(case) <= keys(new) else len(set(kept)) == len(kept)
    # what has not changed is the same text, at its place
    same = set(SECTIONS) - set(map(section_of, differing_fields(case, new)))
    if case.mm_per_unit == new.mm_per_unit:
        assert parts(text, same) == parts(result, same)


def keys(case):
    """What a case file of a case has."""
    tables = {"alignment": case.alignment.table(), "dataset": case.dataset}
    names = {(name, key) for name, table in tables.items() for key in table}
    names |= {name for name in ("distortion", "object_name", "video") if getattr(case, name) is not None}
    names |= {("light", key) for key in ({} if case.light is None else {"lamp_cam_mm": 0, **case.light.origin})}
    names |= {(each.name, key) for each in case.landmarks for key in ("name", "point", "pixel") if getattr(each, key)}
    names |= {str(each) for each in case.frames}
    return names | {each.name for each in case.structures} | {each.name for each in case.landmarks if not each.enabled}


def section_of(field):
    return {"image": "frame", "video": "frame", "mesh": "surface", "distortion": "camera", "cam_from_mesh": "pose"}.get(
        field, field
    )


def parts(text, sections):
    """The lines of sections, without their comments: those before a header belong to no section."""
    found, section = [], None
    for line in text.replace("\r", "").split("\n"):
        if line.startswith("["):
            section = section_in(line)
        if section in sections and line.strip() and not line.strip().startswith("#"):
            found.append(line)
    return sorted(found)


BY_HAND = """# Left ear, second visit
units = "mm"          # as exported
pose = {cam_from_mesh = [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 300], [0, 0, 0, 1]]}

[frame]
image = './frame.png' # cropped

[dataset]             # for the first paper
cone_deg = 25.00      # as they did
"my key" = [1, 2]
count = 100

[camera]
K = [ # calibrated twice
    [1_081.370, 0.0, 31.5],   # fx
    [0.0, 330, 23.5],
    [0.0, 0.0, 1],
]
size = [64, 48]

[[landmarks]]
name = "A"
pixel = [20.25, 30.50] # blurred
[[landmarks]]
name = "B"
surface = [1, 2, 3]

[surface]
mesh = "surface.ply"
"""


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(BY_HAND)
    return path


def saved(path, **changes):
    """The lines that a save has removed and added."""
    case = replace(read_case(path), **changes)
    update_case(path, case)
    assert differing_fields(read_case(path), case) == ()
    old, new = BY_HAND.splitlines(), path.read_text().splitlines()
    return [line for line in old if line not in new], [line for line in new if line not in old]


def test_one_number_of_a_matrix_changes_alone(path):
    camera = replace(read_case(path).camera, fx=1090.5)
    assert saved(path, camera=camera) == (
        ["    [1_081.370, 0.0, 31.5],   # fx"],
        ["    [1090.5, 0.0, 31.5],   # fx"],
    )


def test_an_inline_table_becomes_a_section_when_it_changes(path):
    pose = rigid(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.25, 300.0]))
    removed, added = saved(path, cam_from_mesh=pose)
    assert removed == ["pose = {cam_from_mesh = [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 300], [0, 0, 0, 1]]}"]
    assert added[0] == "[pose]"


def test_landmarks_are_changed_one_by_one(path):
    a, b = read_case(path).landmarks
    assert saved(path, landmarks=(b, replace(a, pixel=(20.25, 31.0)), Landmark("C", None, (1.5, 2.5), False))) == (
        ["pixel = [20.25, 30.50] # blurred"],
        ["pixel = [20.25, 31.0] # blurred", 'name = "C"', "pixel = [1.5, 2.5]", "enabled = false"],
    )
    renamed = replace(read_case(path).landmarks[0], name="short process")
    update_case(path, replace(read_case(path), landmarks=(renamed,)))
    assert path.read_text().count("[[landmarks]]") == 1


def test_pixels_from_the_corner_stay_so_unless_one_changes(path):
    path.write_text(BY_HAND.replace("size = [64, 48]", 'size = [64, 48]\npixel_origin = "corner" # COLMAP'))
    before, case = path.read_text(), read_case(path)
    update_case(path, replace(case, dataset={"count": 7}))
    assert 'pixel_origin = "corner"' in path.read_text()
    path.write_text(before)
    new = replace(case, camera=replace(case.camera, cy=20.0))
    update_case(path, new)
    assert 'pixel_origin = "center" # COLMAP' in path.read_text()
    assert differing_fields(read_case(path), new) == ()


@pytest.mark.parametrize("text", ['[project]\nname = "mine"\n', "units = mm\n", BY_HAND.replace("units", "unit")])
def test_a_file_that_is_no_case_is_never_replaced(path, text):
    case = read_case(path)
    path.write_text(text)
    with pytest.raises(InputError, match="Save the case under another name"):
        update_case(path, case)
    assert path.read_text() == text
