"""The case file: its content, and one clear message for everything that cannot be used."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oneframe.camera.distortion import Distortion
from oneframe.case.case_file import Structure, read_case
from oneframe.case.pose_record import PoseRecord
from oneframe.dataset.options import checked_options
from oneframe.errors import InputError
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
    tables = '[[structures]]\nname = "nerve"\nmesh = "nerve.ply"\ncolor = "#ff8000"\n[dataset]\ncount = 3\n'
    tables += "[alignment]\ndate = 2026-03-31\nstandard_deviation_deg = [0, 0.1, 1]\nrms_px = 2\nmethod = 'landmarks'"
    lens = "\ndistortion = [0.1, 0.02, 0.003, 0.004, 0.05]"
    case = read_case(case_file(tmp_path, tables, K=PARTS["K"] + lens))
    assert (case.camera.fx, case.camera.fy, case.camera.cx, case.camera.cy) == (320.0, 330.0, 31.5, 23.5)
    assert case.camera.size_wh == (64, 48)
    assert case.image == tmp_path / "frame.png"
    assert case.mesh == tmp_path / "../surface.ply"
    assert case.cam_from_mesh[:3, 3].tolist() == [2, 3, 300]
    assert case.structures == (Structure("nerve", tmp_path / "nerve.ply", (1.0, 128 / 255, 0.0)),)
    assert case.dataset == {"count": 3}
    assert case.alignment == PoseRecord(
        "landmarks", date="2026-03-31", rms_px=2.0, standard_deviation_deg=(0.0, 0.1, 1.0)
    )
    # in OpenCV's order
    assert case.distortion == Distortion(k1=0.1, k2=0.02, p1=0.003, p2=0.004, k3=0.05)
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


def intrinsics(rows: str) -> dict[str, str]:
    return {"K": f"K = {rows}"}


def landmark(lines: str) -> dict[str, str]:
    return {"more": f"[[landmarks]]\n{lines}"}


BAD = {
    "units missing": ({"units": ""}, "expected a key 'units', it is missing"),
    "unknown key": ({"image": 'imaeg = "frame.png"'}, "\\[frame\\] unknown key 'imaeg'; did you mean 'image'\\?"),
    "film without a number": (
        {"image": PARTS["image"] + '\nvideo = "a.mkv"'},
        "\\[frame\\]: expected video, .* together, found a text and None",
    ),
    "skew": (intrinsics("[[320, 0.5, 31.5], [0, 330, 23.5], [0, 0, 1]]"), "K: expected no skew, found 0.5; .*rectify"),
    "K transposed": (intrinsics("[[320, 0, 0], [0, 330, 0], [31.5, 23.5, 1]]"), "K: expected \\[\\[fx, 0, cx\\]"),
    "distortion": ({"K": PARTS["K"] + "\ndistortion = [1, 2]"}, "distortion: expected five finite numbers"),
    "pixel origin": ({"K": PARTS["K"] + '\npixel_origin = "centre"'}, 'expected pixel_origin "center" or "corner"'),
    "a line break in a structure's name": (
        {"more": '[[structures]]\nname = "a\\nb"\nmesh = "n.ply"'},
        "number 1: expected a name, found",
    ),
    "reflection": ({"pose": PARTS["pose"].replace("-1, 0, 3", "1, 0, 3")}, "expected a rotation, found a reflection"),
    "structure's colour": (
        {"more": '[[structures]]\nname = "nerve"\nmesh = "n.ply"\ncolor = "red"'},
        "number 1: expected color = \"#rrggbb\", found 'red'",
    ),
    "two structures of a name": (
        {"more": '[[structures]]\nname = "n"\nmesh = "n.ply"\n[[structures]]\nname = "n"\nmesh = "m.ply"'},
        "expected a different name for each",
    ),
    "landmark's key": (landmark('name = "a"\npixle = [1, 2]'), "number 1: unknown key 'pixle'; did you mean 'pixel'"),
    "two landmarks of a name": (landmark('name = "a"\n[[landmarks]]\nname = "a"'), "found 'a' twice; rename one"),
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


TABLES = {
    "[dataset]": ("count", "scale", "engine", "video"),
    '[[landmarks]]\nname = "a"': ("surface", "pixel", "enabled"),
    "[[landmarks]]": ("name",),
    "[alignment]": tuple(PoseRecord.__dataclass_fields__),
}
"""Tables and their keys."""


@settings(max_examples=75)
@given(
    part=st.sampled_from(sorted(PARTS)),
    place=st.sampled_from([(table, key) for table, keys in TABLES.items() for key in keys]),
    value=values | st.lists(numbers, min_size=2, max_size=3),
    units=st.sampled_from(sorted(MM_PER_UNIT)),
)
def test_any_value_is_accepted_or_refused_with_a_message(tmp_path_factory, part, place, value, units):
    folder, (table, key) = tmp_path_factory.getbasetemp(), place
    name = PARTS[part].partition(" = ")[0]
    assert message_of(case_file(folder, **{part: f"{name} = {as_toml(value)}"})).startswith("case.toml: ")
    path = case_file(folder, f"{table}\n{key} = {as_toml(value)}", units=f'units = "{units}"')
    assert message_of(path).startswith("case.toml: ")


NO_TOML = {
    "of another encoding": (b"units = 'Gr\xf6\xdfe'", "save it as UTF-8"),
    "a path of Windows": (b'units = "C:\\Users"', r"write / in paths, not \\"),
    "unfinished": (b"units = ", "."),
    "a picture": (b"\x89PNG\r\n\x1a\n", "."),
    "nested without end": (b"a = " + b"[" * 100_000, "."),
    "a key of many parts": (b"a." * 40_000, "."),
    "a key twice": (b'units = "mm"\nunits = "m"', "."),
}


@pytest.mark.parametrize("name", NO_TOML)
def test_what_is_not_toml_is_refused(tmp_path, name):
    content, advice = NO_TOML[name]
    (tmp_path / "case.toml").write_bytes(content)
    with pytest.raises(InputError, match=rf"^case.toml: expected TOML, found a mistake: .*{advice}"):
        read_case(tmp_path / "case.toml")
