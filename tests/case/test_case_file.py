"""The case file: its content, and one clear message for everything that cannot be used."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.camera.distortion import Distortion
from oneframe.case.alignment_record import KEYS
from oneframe.case.case_file import Structure, read_case
from oneframe.case.landmarks import Landmark
from oneframe.dataset.options import checked_options
from oneframe.errors import InputError
from oneframe.files.keys import nearest_name
from oneframe.files.numbers import MM_PER_UNIT

PARTS = {
    "units": 'units = "mm"',
    "image": 'image = "frame.png"',
    "size": "size = [64, 48]",
    "K": "K = [[320.0, 0, 31.5], [0, 330.0, 23.5], [0, 0, 1]]",
    "mesh": 'mesh = "../surface.ply"',
    "pose": "cam_from_mesh = [[1, 0, 0, 2], [0, -1, 0, 3], [0, 0, -1, 300], [0, 0, 0, 1]]",
}

LANDMARKS = """
[[landmarks]]
name = "tip"
surface = [1.005, 2, -3.5]
pixel = [10.5, 20]
[[landmarks]]
name = "ridge"
pixel = [3, 4]
enabled = false
[[landmarks]]
name = "canal"
surface = [0, 0, 1]
[[landmarks]]
name = "to be placed"
"""


def case_file(folder: Path, more: str = "", **parts: str) -> Path:
    """A case file in a folder, with some lines replaced and more at the end."""
    lines = PARTS | parts
    path = folder / "case.toml"
    path.write_text(
        f"{lines['units']}\n[frame]\n{lines['image']}\n[camera]\n{lines['size']}\n{lines['K']}\n"
        f"[surface]\n{lines['mesh']}\n[pose]\n{lines['pose']}\n{more}\n",
        encoding="utf-8",
    )
    return path


def test_a_case_is_read_as_written(tmp_path):
    structures = '[[structures]]\nname = "nerve"\nmesh = "nerve.ply"\ncolor = "#ff8000"\n'
    case = read_case(case_file(tmp_path, structures + "[dataset]\ncount = 3"))
    assert (case.camera.fx, case.camera.fy, case.camera.cx, case.camera.cy) == (320.0, 330.0, 31.5, 23.5)
    assert case.camera.size_wh == (64, 48)
    assert case.image == tmp_path / "frame.png"
    assert case.mesh == tmp_path / "../surface.ply"
    assert case.cam_from_mesh[:3, 3].tolist() == [2, 3, 300]
    assert case.structures == (Structure("nerve", tmp_path / "nerve.ply", (1.0, 128 / 255, 0.0)),)
    assert case.dataset == {"count": 3}
    assert case.distortion is None
    assert case.messages == ()
    assert list(case.input_files()) == ["case", "frame", "surface", "structure nerve"]


def test_metres_become_millimetres(tmp_path):
    case = read_case(case_file(tmp_path, LANDMARKS, units='units = "m"'))
    assert case.mm_per_unit == 1000
    assert case.cam_from_mesh[:3, 3].tolist() == [2000, 3000, 300_000]
    # as written, although 1000 times the float next to 1.005 is 1004.9999999999999
    assert case.landmarks[0].point == (1005, 2000, -3500)
    assert case.landmarks[0].pixel == (10.5, 20)


def test_corner_origin_is_shifted_by_half_a_pixel(tmp_path):
    case = read_case(case_file(tmp_path, LANDMARKS, K=PARTS["K"] + '\npixel_origin = "corner"'))
    assert (case.camera.cx, case.camera.cy) == (31.0, 23.0)
    assert case.landmarks[0].pixel == (10.0, 19.5)


def test_complete_and_incomplete_landmarks_are_read(tmp_path):
    assert read_case(case_file(tmp_path, LANDMARKS)).landmarks == (
        Landmark("tip", (1.005, 2.0, -3.5), (10.5, 20.0)),
        Landmark("ridge", None, (3.0, 4.0), enabled=False),
        Landmark("canal", (0.0, 0.0, 1.0), None),
        Landmark("to be placed", None, None),
    )


def test_provenance_of_the_pose_is_read(tmp_path):
    table = "[alignment]\ndate = 2026-03-31\nstandard_deviation_deg = [0, 0.1, 1]\nrms_px = 2\nmethod = 'landmarks'"
    assert read_case(case_file(tmp_path, table)).alignment == {
        "method": "landmarks",
        "date": "2026-03-31",
        "rms_px": 2.0,
        "standard_deviation_deg": [0.0, 0.1, 1.0],
    }


def test_distortion_is_read_in_opencvs_order(tmp_path):
    case = read_case(case_file(tmp_path, K=PARTS["K"] + "\ndistortion = [0.1, 0.02, 0.003, 0.004, 0.05]"))
    assert case.distortion == Distortion(k1=0.1, k2=0.02, p1=0.003, p2=0.004, k3=0.05)


def test_a_slightly_rounded_rotation_is_made_orthonormal_and_reported(tmp_path):
    rounded = "cam_from_mesh = [[0.801, -0.6, 0, 0], [-0.6, -0.8, 0, 0], [0, 0, -1, 300], [0, 0, 0, 1]]"
    case = read_case(case_file(tmp_path, pose=rounded))
    rotation = case.cam_from_mesh[:3, :3]
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-14
    assert case.messages == (
        "case.toml: [pose] cam_from_mesh: rotation off by 1.6e-03, corrected to the nearest rotation",
    )


def pose(rows: str) -> dict[str, str]:
    return {"pose": f"cam_from_mesh = {rows}"}


def intrinsics(rows: str) -> dict[str, str]:
    return {"K": f"K = {rows}"}


def landmark(lines: str) -> dict[str, str]:
    return {"more": f"[[landmarks]]\n{lines}"}


BAD = {
    "units unknown": ({"units": 'units = "cm"'}, 'expected units = "mm" or "m", found \'cm\''),
    "units of another kind": ({"units": "units = [1]"}, 'expected units = "mm" or "m", found \\[1\\]'),
    "units missing": ({"units": ""}, "expected a key 'units', it is missing"),
    "unknown key": ({"image": 'imaeg = "frame.png"'}, "\\[frame\\] unknown key 'imaeg'; did you mean 'image'\\?"),
    "unknown key, nothing near": (
        {"size": "size = [64, 48]\nq = 1"},
        "\\[camera\\] unknown key 'q'; expected one of 'size'",
    ),
    "key missing": ({"mesh": ""}, "\\[surface\\] expected a key 'mesh', it is missing"),
    "no file name": ({"image": "image = 3"}, "\\[frame\\] image: expected a file name, found 3"),
    "file name with a zero": ({"image": 'image = "a\\u0000b"'}, "expected a file name"),
    "size of one": ({"size": "size = [64]"}, "expected size = \\[width, height\\] in pixels, found \\[64\\]"),
    "size of zero": ({"size": "size = [0, 48]"}, "whole pixels from 1 to 65536, found \\[0, 48\\]"),
    "size with half a pixel": ({"size": "size = [64.5, 48]"}, "whole pixels"),
    "size as text": ({"size": 'size = "64x48"'}, "expected size = \\[width, height\\]"),
    "negative focal length": (
        intrinsics("[[-320, 0, 31.5], [0, 330, 23.5], [0, 0, 1]]"),
        "K: expected positive focal lengths in pixels, found fx = -320, fy = 330",
    ),
    "skew": (intrinsics("[[320, 0.5, 31.5], [0, 330, 23.5], [0, 0, 1]]"), "K: expected no skew, found 0.5; .*rectify"),
    "K with NaN": (intrinsics("[[320, 0, nan], [0, 330, 23.5], [0, 0, 1]]"), "K: expected finite numbers"),
    "K with infinity": (intrinsics("[[inf, 0, 31.5], [0, 330, 23.5], [0, 0, 1]]"), "K: expected finite numbers"),
    "K of 2 rows": (intrinsics("[[320, 0, 31.5], [0, 330, 23.5]]"), "K: expected a 3x3 matrix, found shape \\(2, 3\\)"),
    "K ragged": (intrinsics("[[320, 0], [0, 330, 23.5], [0, 0, 1]]"), "K: expected 3 rows of 3 numbers"),
    "K as text": (intrinsics('"320 330"'), "K: expected 3 rows of 3 numbers"),
    "K transposed": (intrinsics("[[320, 0, 0], [0, 330, 0], [31.5, 23.5, 1]]"), "K: expected \\[\\[fx, 0, cx\\]"),
    "K far away": (intrinsics("[[320, 0, 3e5], [0, 330, 23.5], [0, 0, 1]]"), "principal point near the 64x48 image"),
    "distortion": ({"K": PARTS["K"] + "\ndistortion = [1, 2]"}, "distortion: expected five finite numbers"),
    "pixel origin": ({"K": PARTS["K"] + '\npixel_origin = "centre"'}, 'expected pixel_origin "center" or "corner"'),
    "3x4 pose": (pose("[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 300]]"), "expected a 4x4 matrix, found shape \\(3, 4\\)"),
    "flat pose": (pose("[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 300, 0, 0, 0, 1]"), "expected a 4x4 matrix, found shape"),
    "reflection": (
        pose("[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 300], [0, 0, 0, 1]]"),
        "expected a rotation, found a reflection \\(determinant -1.000\\)",
    ),
    "scaled rotation": (
        pose("[[1.01, 0, 0, 0], [0, -1.01, 0, 0], [0, 0, -1.01, 300], [0, 0, 0, 1]]"),
        "deviates from orthonormal by 0.02 \\(allowed 0.01\\); remove scale or shear",
    ),
    "transposed pose": (
        pose("[[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [2, 3, 300, 1]]"),
        "expected the last row 0 0 0 1, .*transpose the matrix",
    ),
    "pose with NaN": (
        pose("[[1, 0, 0, nan], [0, -1, 0, 0], [0, 0, -1, 300], [0, 0, 0, 1]]"),
        "expected finite numbers",
    ),
    "pose of texts": (pose('[["a", 0, 0, 0]]'), "expected 4 rows of 4 numbers"),
    "structure without a mesh": ({"more": '[[structures]]\nname = "nerve"'}, "number 1: expected a key 'mesh'"),
    "structure's colour": (
        {"more": '[[structures]]\nname = "nerve"\nmesh = "n.ply"\ncolor = "red"'},
        "number 1: expected color = \"#rrggbb\", found 'red'",
    ),
    "two structures of a name": (
        {"more": '[[structures]]\nname = "n"\nmesh = "n.ply"\n[[structures]]\nname = "n"\nmesh = "m.ply"'},
        "expected a different name for each",
    ),
    "structures as one table": ({"more": '[structures]\nname = "n"'}, "expected a list of tables"),
    "landmark without a name": (landmark("pixel = [1, 2]"), "number 1: expected a key 'name'"),
    "landmark's key": (landmark('name = "a"\npixle = [1, 2]'), "number 1: unknown key 'pixle'; did you mean 'pixel'"),
    "landmark's point": (
        landmark('name = "a"\nsurface = [1, 2]'),
        "expected surface = \\[x, y, z\\], 3 numbers, found",
    ),
    "landmark's text": (landmark('name = "a"\npixel = ["1", 2]'), "number 1: expected pixel = \\[u, v\\], 2 numbers"),
    "landmark's truth": (landmark('name = "a"\npixel = [true, 2]'), "number 1: expected pixel = \\[u, v\\], 2 numbers"),
    "landmark at infinity": (landmark('name = "a"\npixel = [inf, 2]'), "pixel = \\[u, v\\], 2 finite numbers"),
    "landmark perhaps enabled": (landmark('name = "a"\nenabled = 1'), "expected enabled = true or false, found 1"),
    "landmark of no name": (landmark('name = " "'), "number 1: expected a name, found ' '"),
    "landmark's name in two lines": (landmark('name = "a\\nb"'), "number 1: expected a name, found"),
    "two landmarks of a name": (landmark('name = "a"\n[[landmarks]]\nname = "a"'), "found 'a' twice; rename one"),
    "landmarks as one table": ({"more": '[landmarks]\nname = "n"'}, "expected a list of tables"),
    "provenance's key": ({"more": "[alignment]\nrms = 1"}, "\\[alignment\\] unknown key 'rms'; did you mean 'rms_px'"),
    "provenance's text": ({"more": "[alignment]\nmethod = 1"}, "\\[alignment\\] method: expected text, found 1"),
    "provenance's pixels": ({"more": "[alignment]\nrms_px = -1"}, "rms_px: expected a number of pixels, found -1"),
    "provenance's pairs": ({"more": "[alignment]\npairs = 1.5"}, "pairs: expected the number of landmarks, found 1.5"),
    "provenance's axes": (
        {"more": "[alignment]\nstandard_deviation_mm = [1, 2]"},
        "standard_deviation_mm: expected three numbers, .*found \\[1, 2\\]",
    ),
    "provenance's date": ({"more": '[alignment]\ndate = "today"'}, "date: expected a date such as .*found 'today'"),
    "provenance as a list": ({"more": "[[alignment]]\nrms_px = 1"}, "\\[alignment\\]: expected a table, found"),
    "unknown table": ({"more": "[datasets]"}, "unknown key 'datasets'; did you mean 'dataset'\\?"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_values_are_refused_and_named(tmp_path, name):
    parts, message = BAD[name]
    with pytest.raises(InputError, match=f"^case.toml: .*{message}"):
        read_case(case_file(tmp_path, **parts))


numbers = st.one_of(st.integers(-2, 2), st.integers(), st.just(10**400), st.floats(), st.booleans())
texts = st.text(st.characters(codec="utf-8", categories=["L", "N", "P"], exclude_characters='"\\\\'), max_size=5)
values = st.recursive(
    numbers | texts,
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.sampled_from("ab"), inner, max_size=2),
    max_leaves=16,
)


def as_toml(value: object) -> str:
    match value:
        case bool():
            return str(value).lower()
        case str():
            return f'"{value}"'
        case list():
            return f"[{', '.join(map(as_toml, value))}]"
        case dict():
            return "{" + ", ".join(f"{key} = {as_toml(part)}" for key, part in value.items()) + "}"
    return repr(value)


def message_of(path: Path) -> str:
    """The error message for a case file; any other exception is a defect."""
    try:
        checked_options(read_case(path).dataset, "case.toml: [dataset]")
    except InputError as error:
        return str(error)
    return "case.toml: taken"


@given(key=st.sampled_from(sorted(PARTS)), value=values, option=st.sampled_from(["count", "scale", "engine", "video"]))
def test_any_value_is_accepted_or_refused_with_a_message(tmp_path_factory, key, value, option):
    folder = tmp_path_factory.getbasetemp()
    name = PARTS[key].partition(" = ")[0]
    assert message_of(case_file(folder, **{key: f"{name} = {as_toml(value)}"})).startswith("case.toml: ")
    assert message_of(case_file(folder, f"[dataset]\n{option} = {as_toml(value)}")).startswith("case.toml: ")


@given(
    key=st.sampled_from(["name", "surface", "pixel", "enabled", *KEYS]),
    value=values | st.lists(numbers, min_size=2, max_size=3),
    units=st.sampled_from(sorted(MM_PER_UNIT)),
)
def test_any_landmark_and_provenance_is_accepted_or_refused_with_a_message(tmp_path_factory, key, value, units):
    table = "[alignment]\n" if key in KEYS else "[[landmarks]]\n" + 'name = "a"\n' * (key != "name")
    more = f"{table}{key} = {as_toml(value)}"
    path = case_file(tmp_path_factory.getbasetemp(), more, units=f'units = "{units}"')
    assert message_of(path).startswith("case.toml: ")


@given(
    key=st.sampled_from(["K", "pose"]),
    row=st.integers(0, 3),
    column=st.integers(0, 3),
    value=values,
    units=st.sampled_from(sorted(MM_PER_UNIT)),
)
def test_any_entry_of_a_matrix_is_accepted_or_refused_with_a_message(tmp_path_factory, key, row, column, value, units):
    name, _, text = PARTS[key].partition(" = ")
    matrix = json.loads(text)
    matrix[row % len(matrix)][column % len(matrix)] = value
    parts = {key: f"{name} = {as_toml(matrix)}", "units": f'units = "{units}"'}
    path = case_file(tmp_path_factory.getbasetemp(), **parts)
    assert message_of(path).startswith("case.toml: ")


@pytest.mark.parametrize(
    "content",
    [b"units = ", b"\x89PNG\r\n\x1a\n", b"\xff\xfe", b"a = " + b"[" * 100_000, b'units = "mm"\nunits = "m"'],
    ids=["unfinished", "a picture", "not UTF-8", "nested without end", "a key twice"],
)
def test_what_is_not_toml_is_refused(tmp_path, content):
    path = tmp_path / "case.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"^case.toml: expected TOML, found a mistake: ."):
        read_case(path)


def test_a_missing_case_and_a_folder_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"none\.toml: expected a case file, it does not exist; correct the path"):
        read_case(tmp_path / "none.toml")
    with pytest.raises(InputError, match=r"expected a case file, cannot read it \(a folder\); give"):
        read_case(tmp_path)


@pytest.mark.parametrize(
    ("name", "hint"),
    [("Image", "did you mean 'image'?"), ("meshes", "did you mean 'mesh'?"), ("zz", "expected one of")],
)
def test_nearest_name(name, hint):
    assert nearest_name(name, ("image", "mesh")).startswith(hint)
