"""Reading mesh files: any legal layout gives the same triangles, any damage gives a refusal that says where."""

import re
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from oneframe.errors import InputError
from oneframe.surface.mesh import TriangleMesh, checked_mesh
from oneframe.surface.mesh_reader import read_mesh, triangulated
from oneframe.surface.winding import consistent_winding

TYPE_NAMES = {
    "b": ("char", "int8"),
    "B": ("uchar", "uint8"),
    "h": ("short", "int16"),
    "H": ("ushort", "uint16"),
    "i": ("int", "int32"),
    "I": ("uint", "uint32"),
    "f": ("float", "float32"),
    "d": ("double", "float64"),
}
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
quick = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


@st.composite
def polygon_soups(draw) -> tuple[np.ndarray, list[list[int]]]:
    """Vertices (of small integers, which every type can hold) and polygons of three or four corners."""
    vertices = draw(hnp.arrays(np.float64, (8, 3), elements=st.integers(0, 100).map(float)))
    sizes = st.sampled_from([[3], [4], [3, 4]])
    size = st.sampled_from(draw(sizes))
    corner = st.integers(0, 7)
    polygons = draw(st.lists(size.flatmap(lambda n: st.lists(corner, min_size=n, max_size=n)), min_size=1, max_size=8))
    return vertices, polygons


def triangles_of(vertices: np.ndarray, polygons: list[list[int]]) -> np.ndarray:
    return triangulated(vertices, np.array([len(p) for p in polygons]), np.concatenate(polygons), "a.ply")


def read_or_refusal(path: Path) -> tuple[np.ndarray, list[str]] | str:
    """``(F, 3, 3)`` triangles and the messages, or the error; any other exception or a warning fails the test."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            mesh, messages = read_mesh(path)
        except InputError as error:
            return str(error)
    return mesh.vertices[mesh.faces], messages


def checked_triangles(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray | str:
    try:
        mesh, _ = consistent_winding(checked_mesh(vertices, faces, "expected")[0], "expected")
    except InputError as error:
        return str(error)
    return mesh.vertices[mesh.faces]


def assert_reads_as(path: Path, vertices: np.ndarray, polygons: list[list[int]]) -> None:
    found, expected = read_or_refusal(path), checked_triangles(vertices, triangles_of(vertices, polygons))
    if isinstance(expected, str):
        assert isinstance(found, str)
        assert "all with zero area" in found
    else:
        assert not isinstance(found, str), found
        assert np.array_equal(found[0], expected)


def stl_binary(triangles: np.ndarray, header: bytes = b"solid that is binary") -> bytes:
    records = [struct.pack("<12fH", 0, 0, 1, *triangle.ravel(), 7) for triangle in triangles]
    return header.ljust(80, b"\0") + struct.pack("<I", len(records)) + b"".join(records)


def ply_encoded(order: str, elements: list[tuple[str, int, list[tuple]]], comment: str = "") -> bytes:
    """PLY from elements (name, rows, columns); a column is (name, item type, length type or None, values)."""
    header, body = ["ply", f"format {order} 1.0", f"comment {comment}end_header"], []
    for element, rows, columns in elements:
        header.append(f"element {element} {rows}")
        for name, item, length, _ in columns:
            types = f"{length[1]} {item[1]}" if length else item[1]
            header.append(f"property {'list ' if length else ''}{types} {name}")
        for row in range(rows):
            for _, item, length, values in columns:
                numbers = [int(n) if item[0] not in "fd" else n for n in np.atleast_1d(values[row]).tolist()]
                counted = [len(numbers), *numbers] if length else numbers
                if order == "ascii":
                    body.append((" ".join(f"{n!r}" for n in counted) + " ").encode())
                    continue
                codes = (length[0] if length else "") + item[0] * len(numbers)
                body.append(struct.pack(ORDERS[order] + codes, *counted))
            if order == "ascii":
                body.append(b"\n")
    return "\n".join([*header, "obj_info none", "end_header", ""]).encode() + b"".join(body)


def sample_files() -> dict[str, bytes]:
    """One small valid file per format and variant."""
    vertices = np.array([[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0], [2, 2, 13.5], [2, -3, 0.25]])
    polygons = [[0, 3, 2, 1], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [0, 5, 1]]
    triangles = vertices[triangles_of(vertices, polygons)]
    files = {}
    for order in ("ascii", *ORDERS):
        for shape, corners in (("mixed", polygons), ("triangles", triangles_of(vertices, polygons).tolist())):
            xyz = [(axis, ("f", "float"), None, vertices[:, k]) for k, axis in enumerate("xyz")]
            face = [("vertex_indices", ("i", "int"), ("B", "uchar"), corners)]
            elements = [("vertex", len(vertices), xyz), ("face", len(corners), face)]
            files[f"{order} {shape}.ply"] = ply_encoded(order, elements)
    files["binary.stl"] = stl_binary(triangles)
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices]
    lines += ["f " + " ".join(f"{index + 1}/{index + 1}" for index in polygon) for polygon in polygons]
    files["mesh.obj"] = "\n".join([*lines, ""]).encode()
    return files


SAMPLES = sample_files()


@quick
@given(st.data(), polygon_soups(), st.sampled_from(["ascii", *ORDERS]))
def test_any_ply_layout_gives_the_same_triangles(tmp_path, data, soup, order):
    vertices, polygons = soup

    def type_of(codes: str) -> tuple[str, str]:
        code = data.draw(st.sampled_from(codes))
        return code, data.draw(st.sampled_from(TYPE_NAMES[code]))

    def extra_columns(rows: int, prefix: str) -> list[tuple]:
        columns = []
        for number in range(data.draw(st.integers(0, 2))):
            if data.draw(st.booleans()):
                lists = [list(range(data.draw(st.integers(0, 3)))) for _ in range(rows)]
                columns.append((f"{prefix}{number}", type_of("bBhHiIfd"), type_of("BHiI"), lists))
            else:
                columns.append((f"{prefix}{number}", type_of("bBhHiIfd"), None, [7] * rows))
        return columns

    xyz = [(axis, type_of("bBhHiIfd"), None, vertices[:, k]) for k, axis in enumerate("xyz")]
    name = data.draw(st.sampled_from(["vertex_indices", "vertex_index"]))
    face = [(name, type_of("bBhHiIfd"), type_of("bBhHiIf"), polygons)]
    elements = [
        ("vertex", len(vertices), data.draw(st.permutations(xyz + extra_columns(len(vertices), "v")))),
        ("face", len(polygons), data.draw(st.permutations(face + extra_columns(len(polygons), "f")))),
        ("camera", 2, extra_columns(2, "c")),
        ("nothing", 0, [("q", ("i", "int"), ("B", "uchar"), [])]),
    ]
    content = ply_encoded(order, data.draw(st.permutations(elements)))
    (tmp_path / "a.ply").write_bytes(content)
    assert_reads_as(tmp_path / "a.ply", vertices, polygons)


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r", b" # a comment\n"])
def test_corners_of_obj_are_written_in_many_ways(tmp_path, end):
    lines = [b"v 0 0 0", b"v\t1 0 0 1", b" v 1e0 1 0", b"vt 0 0", b"f 1/1/1 2//1 -1", b"v 0 1 0", b"f -4 \\\n -2/1 4/ "]
    (tmp_path / "a.obj").write_bytes(end.join([*lines, b""]))
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    assert np.array_equal(read_or_refusal(tmp_path / "a.obj")[0], corners[[[0, 1, 2], [0, 2, 3]]])
    for wrong in (b"f 1 2 x", b"f 1 2 9", b"f 0 1 2", b"f -9 1 2", b"v 1 2", b"v 1 2 x", b"f /1 1 2"):
        (tmp_path / "a.obj").write_bytes(b"\n".join([*lines, wrong, b""]))
        with pytest.raises(InputError, match=r"a\.obj: line 8: expected"):
            read_mesh(tmp_path / "a.obj")


@quick
@given(polygon_soups(), st.sampled_from([b"solid", b"", b"\xff" * 80, b"solid facet normal 0 0 1\n"]))
def test_stl_keeps_triangles_and_merges_corners(tmp_path, soup, header):
    vertices, polygons = soup
    triangles = vertices[triangles_of(vertices, polygons)]
    (tmp_path / "a.stl").write_bytes(stl_binary(triangles, header))
    assert_reads_as(tmp_path / "a.stl", vertices, polygons)
    if isinstance(checked_triangles(vertices, triangles_of(vertices, polygons)), np.ndarray):
        mesh, _ = read_mesh(tmp_path / "a.stl")
        assert len(mesh.vertices) == len(np.unique(mesh.vertices, axis=0))


def test_several_objects_are_refused_and_one_of_several_names_is_read(tmp_path):
    """As 3D Slicer writes segments into one file, in which a nerve would become bone."""
    triangles = np.arange(36.0).reshape(4, 3, 3) ** 2
    points = b"".join(b"v %g %g %g\n" % tuple(point) for point in triangles.reshape(-1, 3).tolist())
    faces = b"f 1 2 3\nusemtl red\nf 4 5 6\n", b"usemtl blue\nf 7 8 9\nf 10 11 12\n"
    for name, content, found in (
        ("a.obj", points + b"g bone\n%sg nerve\n%s" % faces, "2 objects or groups"),
        ("b.obj", points + b"%so nerve\n%s" % faces, "2 objects or groups"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=f"expected one surface, found {found}.*--structure"):
            read_mesh(tmp_path / name)
    (tmp_path / "a.obj").write_bytes(b"o empty\n" + points + b"o bone\ng bone\n%s%s" % faces)
    assert len(read_mesh(tmp_path / "a.obj")[0].faces) == 4


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.ply", SAMPLES["binary_big_endian triangles.ply"] + b"xyz", "ignored 3 bytes"),
        ("a.stl", SAMPLES["binary.stl"] + b"xyz", "ignored 3 bytes"),
        ("a.ply", SAMPLES["ascii mixed.ply"].rstrip(), "no line break"),
        ("a.obj", SAMPLES["mesh.obj"].rstrip(), "no line break"),
        ("a.obj", SAMPLES["mesh.obj"] + b"f 1 2\n", "dropped 1 of 7 faces with less than 3 corners"),
    ],
)
def test_what_was_ignored_is_reported(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    mesh, found = read_mesh(tmp_path / name)
    assert len(mesh.faces) == 7
    assert len(found) == 1
    assert message in found[0]


@pytest.mark.parametrize("name", SAMPLES)
def test_a_file_cut_at_any_byte_is_refused(tmp_path, name):
    content, path = SAMPLES[name], tmp_path / name
    path.write_bytes(content)
    whole = read_or_refusal(path)[0]
    lengths = {*range(0, len(content), 5), *range(max(0, len(content) - 200), len(content))}
    for length in sorted(lengths):
        part = content[:length]
        path.write_bytes(part)
        found = read_or_refusal(path)
        if isinstance(found, str):
            assert name in found
            continue
        triangles, messages = found
        at_end = part.endswith(b"\n") or content[length:].startswith(b"\n")
        assert at_end or "no line break" in messages[0]
        # nothing says how many lines an OBJ should have; of other text only digits at the very end may lack
        assert name == "mesh.obj" or (name.startswith("ascii") and b" " not in content[length:].strip())
        assert name == "mesh.obj" or len(triangles) == len(whole)
        certain = len(triangles) if at_end else max(len(triangles) - 2, 0)
        assert np.array_equal(triangles[:certain], whole[:certain])


HEADER = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
FACES = HEADER + b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.ply", b"", "empty file"),
        ("a.ply", SAMPLES["binary.stl"], "another format"),
        ("a.ply", b"ply\nformat ascii 2.0\nend_header\n", r"line 2: expected a line of a PLY 1.0 header"),
        ("a.ply", HEADER + b"end_header\n1 2 3\n", r"expected elements vertex .* found vertex \(x, y, z\)"),
        ("a.ply", FACES + b"1 2 3\n3 0 0.5 1\n", "whole numbers"),
        ("a.ply", FACES + b"1 2 3\n-3 0\n", "row 0 of element 'face', found -3"),
        ("a.ply", FACES + b"1 2o 3\n3 0 0 0\n", "line 10: expected only numbers"),
        ("a.ply", SAMPLES["binary_little_endian triangles.ply"][:-30], "expected 7 rows .* ends after 4; .*truncated"),
        (
            "a.ply",
            SAMPLES["binary_little_endian mixed.ply"].replace(b"vertex 6", b"vertex 99999999999"),
            "expected 99999999999 rows .*truncated",
        ),
        ("a.ply", SAMPLES["ascii mixed.ply"] + b"4\n", "expected 43 numbers .*found 44"),
        ("a.obj", b"v 1 2 3\nv 3 4 5\n", "2 vertices and 0 faces"),
        ("a.obj", SAMPLES["mesh.obj"].replace(b"v 4.000000", b"v nan", 1), r"NaN, .* 1 of 6 .*\(first: vertex 1\)"),
        ("a.stl", b"anything else", "expected 0 triangles in 84 bytes, the file has 13"),
        (
            "a.stl",
            b"solid bone\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n" * 3,
            "found a text .*export it as binary",
        ),
        ("a.gltf", b"{}", r"found extension '\.gltf'"),
    ],
)
def test_bad_file_is_refused(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=rf"{name}: .*{message}"):
        read_mesh(tmp_path / name)


# --- what other programs write


@quick
@given(st.integers(4, 14), st.integers(0, 1000), st.booleans())
def test_a_simple_polygon_is_covered_once(corners, seed, turned):
    """With one corner that may turn inwards: no triangle leaves it, and its area is that of the outline."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False) * (-1 if turned else 1)
    flat = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    flat[rng.integers(corners)] *= rng.uniform(0.2, 1)
    placed = flat @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    a, b, c = (flat[side] for side in triangulated(placed, np.array([corners]), np.arange(corners), "a.ply").T)
    areas = np.cross(b - a, c - a)[:, 2]
    outline = (flat[:, 0] * np.roll(flat[:, 1], -1) - flat[:, 1] * np.roll(flat[:, 0], -1)).sum()
    assert (areas * outline > -1e-12).all()
    np.testing.assert_allclose(areas.sum(), outline, rtol=1e-9)
    star = placed * np.where(np.arange(corners) % 2, 0.3, 1)[:, None]
    if corners > 7 and not corners % 2:
        with pytest.raises(InputError, match="up to one corner that turns inwards"):
            triangulated(star, np.array([corners]), np.arange(corners), "a.ply")


@settings(quick, max_examples=8)
@given(st.integers(0, 1000), st.booleans())
def test_turned_faces_are_turned_back(bumpy_mesh, seed, apart):
    """Also of a mesh whose faces share no vertices."""
    rng = np.random.default_rng(seed)
    vertices, faces = bumpy_mesh.vertices, bumpy_mesh.faces[rng.permutation(len(bumpy_mesh.faces))]
    if apart:
        vertices, faces = vertices[faces.ravel()], np.arange(faces.size, dtype=np.int32).reshape(-1, 3)
    turned = rng.random(len(faces)) < rng.uniform(0, 0.4)
    mixed = np.where(turned[:, None], faces[:, ::-1], faces)
    mesh, messages = consistent_winding(TriangleMesh(vertices, mixed), "a.ply")
    assert np.array_equal(
        mesh.vertices[mesh.faces], np.where(turned[:, None, None], vertices[mixed][:, ::-1], vertices[faces])
    )
    turns = f"a.ply: turned {turned.sum()} of {len(faces)} faces, which were wound against their neighbours"
    assert messages == ([turns] if turned.any() else [])


@pytest.mark.parametrize("name", ["mesh.obj", "ascii triangles.ply"])
def test_marks_and_numbers_of_other_programs(tmp_path, name):
    """A byte order mark; no number in a normal and in a vertex of no face."""
    (tmp_path / name).write_bytes(SAMPLES[name])
    wanted, _ = read_or_refusal(tmp_path / name)
    odd = SAMPLES[name].replace(b"element vertex 6\n", b"element vertex 7\n")
    odd = re.sub(rb"(2\.0 -3\.0 0\.25 *\n)", rb"\1nan nan nan\n", odd)
    odd = re.sub(rb"(v 2\.000000 -3\.000000 0\.250000\n)", rb"\1v nan nan nan\n", odd)
    assert odd != SAMPLES[name]
    (tmp_path / name).write_bytes(b"\xef\xbb\xbf" + odd)
    found, messages = read_or_refusal(tmp_path / name)
    assert np.array_equal(found, wanted)
    assert ["1 of 7 vertices that no face uses" in message for message in messages] == [True]


@pytest.mark.parametrize("name", ["mesh.obj", "binary.stl", "ascii mixed.ply"])
def test_meshes_meet_in_the_coordinates_that_both_state(tmp_path, name):
    def file_of(space: str) -> Path:
        words = f"3D Slicer output. SPACE={space}".encode()
        content = SAMPLES[name].replace(b"comment ", b"comment " + words + b"\ncomment ", 1)
        content = content.replace(b"solid that is binary" + bytes(7), words)
        path = tmp_path / f"{space} {name}"
        path.write_bytes(b"# " + words + b"\n" + content if name.endswith("obj") else content)
        return path

    given, _ = read_mesh(file_of("RAS"))
    turned, (message,) = read_mesh(file_of("RAS"), like=file_of("LPS"))
    assert message == f"RAS {name}: its coordinates are RAS; turned into those of LPS {name}"
    assert np.array_equal(turned.vertices, given.vertices * (-1, -1, 1))
    assert np.array_equal(turned.faces, given.faces)
    for like in ("RAS", ""):
        assert np.array_equal(read_mesh(file_of("RAS"), like=file_of(like))[0].vertices, given.vertices)
