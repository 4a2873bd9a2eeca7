"""The mark of this program's own files: found again in every format, and lost with any change."""

import io
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.files.signature import is_signed, signed
from oneframe.images.png import encode_png
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.mesh_reader import read_mesh
from oneframe.surface.mesh_writer import write_ply

PNG = encode_png(np.arange(48, dtype=np.uint8).reshape(4, 4, 3))
FILES = {
    "png": PNG,
    "ply": b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n",
    "mtl": b"newmtl surface\nKd 1 1 1\n",
    "svg": b"<?xml version='1.0'?>\n<svg></svg>\n",
}


@pytest.mark.parametrize("kind", FILES)
@given(data=st.data())
def test_a_signed_file_is_recognised_until_it_changes(kind, data):
    content = signed(FILES[kind])
    assert not is_signed(FILES[kind])
    assert is_signed(content)
    at, bit = data.draw(st.integers(0, len(content) - 1)), data.draw(st.integers(0, 7))
    changed = content[:at] + bytes([content[at] ^ 1 << bit]) + content[at + 1 :]
    assert not is_signed(changed)
    assert not is_signed(content[:at])


@given(st.binary())
def test_other_files_are_not_recognised(content):
    assert not is_signed(content)


def test_other_readers_skip_the_mark(tmp_path):
    image = pytest.importorskip("PIL.Image")
    read = image.open(io.BytesIO(signed(PNG)))
    read.load()
    assert np.array_equal(np.asarray(read), np.arange(48).reshape(4, 4, 3))
    chunk = signed(PNG)[len(PNG) - 12 : -12]
    (size,), (checksum,) = struct.unpack(">I", chunk[:4]), struct.unpack(">I", chunk[-4:])
    assert (size, checksum) == (len(chunk) - 12, zlib.crc32(chunk[4:-4]))
    mesh = TriangleMesh(np.eye(3), np.array([[0, 1, 2]], np.int32))
    write_ply(tmp_path / "a.ply", mesh)
    assert is_signed((tmp_path / "a.ply").read_bytes())
    assert np.array_equal(read_mesh(tmp_path / "a.ply")[0].vertices, mesh.vertices)
