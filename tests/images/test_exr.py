"""Uncompressed EXR: every layout that Blender's engines write, and clear errors for the rest."""

import struct

import numpy as np
import pytest

from oneframe.images.exr import ExrError, read_exr

HALF, FLOAT = 1, 2


def attribute(name: str, kind: str, data: bytes) -> bytes:
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data


def exr(channels: dict[str, np.ndarray], *, compression: int = 0, version: int = 2) -> bytes:
    """An EXR file written from the specification."""
    height, width = next(iter(channels.values())).shape
    kinds = {np.dtype("f2"): HALF, np.dtype("f4"): FLOAT}
    listed = b"".join(
        channel.encode() + b"\0" + struct.pack("<iIii", kinds[plane.dtype], 0, 1, 1)
        for channel, plane in sorted(channels.items())
    )
    window = struct.pack("<4i", 0, 5, width - 1, height + 4)
    header = attribute("channels", "chlist", listed + b"\0")
    header += attribute("compression", "compression", bytes([compression]))
    header += attribute("dataWindow", "box2i", window) + attribute("displayWindow", "box2i", window) + b"\0"
    rows = b""
    for y in range(height):
        row = b"".join(plane[y].tobytes() for _, plane in sorted(channels.items()))
        rows += struct.pack("<ii", y + 5, len(row)) + row
    return struct.pack("<ii", 20000630, version) + header + bytes(8 * height) + rows


@pytest.fixture
def planes(rng):
    return {
        "ViewLayer.Combined.R": rng.random((4, 6)).astype(np.float32),
        "ViewLayer.Combined.G": rng.random((4, 6)).astype(np.float32),
        "ViewLayer.Depth.Z": rng.random((4, 6)).astype(np.float16),
    }


def test_one_part(tmp_path, planes):
    path = tmp_path / "view.exr"
    path.write_bytes(exr(planes))
    found = read_exr(path)
    assert found.keys() == planes.keys()
    assert all(np.array_equal(found[name], planes[name]) for name in planes)


DAMAGED = r"view\.exr: not an uncompressed scan-line EXR file, or damaged"


@pytest.mark.parametrize(
    ("settings", "kept", "message"),
    [
        *(({}, kept, DAMAGED) for kept in (0, 4, 30, 200, -1)),
        ({"compression": 3}, None, "compressed or tiled"),
        ({"version": 2 | 0x800}, None, "unexpected magic number or flags"),
        ({"version": 2 | 0x1000}, None, "unexpected magic number or flags"),
    ],
)
def test_what_is_cut_off_or_of_another_kind_is_refused(tmp_path, planes, settings, kept, message):
    (tmp_path / "view.exr").write_bytes(exr(planes, **settings)[:kept])
    with pytest.raises(ExrError, match=message):
        read_exr(tmp_path / "view.exr")
