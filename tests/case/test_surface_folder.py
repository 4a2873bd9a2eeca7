"""The record of a surface's folder: what is in it is read, and any change of it is a value or a sentence."""

import copy
import json
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from oneframe.case.surface_folder import focus_table, read_surface_folder, structure_file
from oneframe.errors import InputError
from oneframe.surface.mesh import Ball, TriangleMesh
from oneframe.surface.mesh_writer import SAFE_NAME, write_ply

MESH = TriangleMesh(np.eye(3) * 10, np.array([[0, 1, 2]], np.int32))
FOCUS = Ball(np.array([1.23456, -2.0, 3.0]), 4.56789)
RECORD = {
    "frame": "LPS, mm",
    "volume": {},
    "threshold_hu": 300.0,
    "surface": {"file": "surface.ply", "vertices": 3, "faces": 1},
    "structures": {"Nervus facialis (re)": {"file": "structures/n.ply", "faces": 1, "colour": [1.0, 0.0, 1.0]}},
    "focus": focus_table(FOCUS),
}


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "structures").mkdir()
    for name in ("surface.ply", "structures/n.ply"):
        write_ply(tmp_path / name, MESH)
    (tmp_path / "surface.json").write_text(json.dumps(RECORD))
    return tmp_path


def test_what_the_record_says_is_read(folder):
    found = read_surface_folder(folder)
    assert found.mesh == folder / "surface.ply"
    assert [(each.name, each.mesh, each.colour) for each in found.structures] == [
        ("Nervus facialis (re)", folder / "structures" / "n.ply", (1.0, 0.0, 1.0))
    ]
    assert found.focus.centre.tolist() == [1.235, -2.0, 3.0]
    assert found.focus.radius_mm == 4.568
    for key in ("focus", "structures"):
        (folder / "surface.json").write_text(json.dumps({name: part for name, part in RECORD.items() if name != key}))
        found = read_surface_folder(folder)
        assert (found.focus is None, found.structures == ()) == (key == "focus", key == "structures")


def places(value, path=()):
    yield path
    if isinstance(value, dict | list):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield from places(value[key], (*path, key))


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from([place for place in places(RECORD) if place]), json_values)
def test_any_change_is_a_value_or_a_sentence(folder, place, value):
    record = copy.deepcopy(RECORD)
    inside = record
    for key in place[:-1]:
        inside = inside[key]
    inside[place[-1]] = value
    (folder / "surface.json").write_text(json.dumps(record))
    # no other exception
    with suppress(InputError):
        assert all(len(each.colour) == 3 for each in read_surface_folder(folder).structures)


@given(st.text(min_size=1, max_size=20))
def test_the_files_of_structures_have_safe_names(name):
    folder, _, file = structure_file(name).partition("/")
    assert folder == "structures"
    assert SAFE_NAME.fullmatch(file)
    assert file.endswith(".ply")
