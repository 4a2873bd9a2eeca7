"""Writing meshes: exact round trips, agreement with an independent reader and writer, atomic replacement."""

import re
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from oneframe.errors import InputError
from oneframe.surface.mesh import TriangleMesh, checked_mesh
from oneframe.surface.mesh_reader import read_mesh
from oneframe.surface.mesh_writer import material_path, texture_path, write_obj, write_ply
from oneframe.surface.winding import consistent_winding

quick = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


@st.composite
def meshes(draw) -> TriangleMesh:
    """A mesh that every format gives back: short numbers, all faces with area and wound alike, all vertices used."""
    count = draw(st.integers(3, 12))
    grid = draw(hnp.arrays(np.int32, (count, 3), elements=st.integers(-99, 99), unique=True))
    faces = draw(hnp.arrays(np.int32, (draw(st.integers(1, 15)), 3), elements=st.integers(0, count - 1)))
    vertices = (grid * draw(st.sampled_from([1.0, 0.125, 64.0]))).astype(np.float32)
    try:
        mesh, _ = consistent_winding(checked_mesh(vertices, faces, "drawn")[0], "drawn")
    except InputError:
        mesh = None
    if mesh is None or consistent_winding(mesh, "drawn")[1]:
        return TriangleMesh(np.eye(3), np.array([[0, 1, 2]], np.int32))
    return mesh


@quick
@given(meshes(), st.booleans(), st.booleans(), st.booleans())
def test_round_trips_are_exact(tmp_path, mesh, with_colours, with_normals, with_uv):
    colours = np.full(mesh.vertices.shape, 200, np.uint8) if with_colours else None
    uv = np.random.default_rng(1).random((*mesh.faces.shape, 2)) if with_uv else None
    normals = mesh.vertex_normals if with_normals else None
    write_ply(tmp_path / "a.PLY", mesh, colours=colours, normals=normals, uv=uv)
    write_obj(tmp_path / "a.Obj", mesh, uv=uv)
    for name in ("a.PLY", "a.Obj"):
        found, messages = read_mesh(tmp_path / name)
        assert messages == []
        assert np.array_equal(found.vertices, mesh.vertices)
        assert np.array_equal(found.faces, mesh.faces)


def test_obj_keeps_single_precision(tmp_path):
    rng = np.random.default_rng(3)
    vertices = (rng.normal(size=(3000, 3)) * 10 ** rng.uniform(-4, 4, (3000, 1))).astype(np.float32)
    uv = rng.random((1000, 3, 2)).astype(np.float32)
    write_obj(tmp_path / "a.obj", TriangleMesh(vertices, np.arange(3000).reshape(-1, 3)), uv=uv)
    words = [line.split() for line in (tmp_path / "a.obj").read_text().splitlines()]
    numbers = {tag: np.array([w[1:] for w in words if w[0] == tag], dtype=np.float32) for tag in ("v", "vt")}
    corners = [[int(corner.split("/")[1]) - 1 for corner in w[1:]] for w in words if w[0] == "f"]
    assert np.array_equal(numbers["v"], vertices)
    assert np.array_equal(numbers["vt"][corners], uv)


@given(st.text(st.characters(exclude_characters="/\0", exclude_categories=("Cs",)), min_size=1, max_size=60))
def test_companions_have_names_that_every_reader_finds(stem):
    """Pure ASCII without spaces, the same for the same name, and the file's own name where that is safe."""
    path = Path("folder") / f"{stem}.obj"
    for companion, suffix in ((texture_path(path), ".png"), (material_path(path), ".mtl")):
        assert companion.parent == path.parent
        assert companion.suffix == suffix
        assert re.fullmatch(r"\w[\w.-]*", companion.name, re.ASCII)
        assert companion.stem == stem or not re.fullmatch(r"\w[\w.-]*", stem, re.ASCII)


def test_companions_of_different_files_differ():
    names = ["bone 1", "bone_1", "bone  1", "Schädel", "Schadel", "頭骨", "骨", "bone#1", "bone[1]", "-bone", "bone"]
    assert len({texture_path(Path(f"{name}.ply")).name.lower() for name in names}) == len(names)
    assert texture_path(Path("Schädel.ply")).name.startswith("Schadel_")
    # one name in two forms of Unicode is one file on macOS
    assert texture_path(Path("Scha\u0308del.ply")) == texture_path(Path("Sch\u00e4del.ply"))
