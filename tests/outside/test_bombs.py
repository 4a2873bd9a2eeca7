"""Files that claim any size, are nested deep, would run code or are no files end in a sentence, in little memory."""

import io
import os
import pickle
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.outside.victims import Victims, faults_of

HUGE = 60_000
PLY = (
    "ply\nformat {}\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n"
    "property list uchar int vertex_indices\nend_header\n"
)
NRRD = (
    "NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 60000 60000 60000\nencoding: raw\n"
    "space directions: (1,0,0) (0,1,0) (0,0,1)\nendian: little\n\n"
)
DEEP = "[" * 40_000


class Call:
    """Unpickled, it would make a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self) -> tuple:
        return os.mkdir, (str(self.folder),)


def png(width: int, height: int) -> bytes:
    """A PNG with correct checksums around few pixels."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(9999))) + chunk(b"IEND", b"")


def tiff(width: int, height: int) -> bytes:
    tags = {256: width, 257: height, 258: 8, 259: 1, 262: 2, 273: 8, 277: 3, 278: height, 279: 400}
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags.items())
    return b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + bytes(404)


def npy(shape: str, kind: str = "<f8") -> bytes:
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header + bytes(4096)


def npz(data: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("K.npy", data)
    return stream.getvalue()


def sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(5 << 30)


FRAMES = {
    "frame.png": png(HUGE, HUGE),
    "frame.jpg": b"\xff\xd8\xff\xc2" + struct.pack(">HBHHB", 17, 8, HUGE, HUGE, 3) + bytes(9) + b"\xff\xda\xff\xd9",
    "frame.tif": tiff(HUGE, HUGE),
    "frame.bmp": b"BM" + struct.pack("<IHHIIiiHHII", 454, 0, 0, 54, 40, HUGE, HUGE, 1, 24, 0, 0) + bytes(416),
    "frame.exr": b"\x76\x2f\x31\x01\2\0\0\0dataWindow\0box2i\0\x10\0\0\0" + struct.pack("<4i", 0, 0, HUGE, HUGE),
}
CLAIMS: dict[str, list[tuple[str, bytes | str]]] = {
    "image header": list(FRAMES.items()),
    "camera": [
        ("camera.npy", npy("(1000000000000, 3)")), ("camera.npz", npz(npy("(3, 1000000000000)"))),
        ("camera.npy", npy("(3, 3)", "|O")), ("camera.json", '{"K": ' + DEEP), ("camera.yaml", "K: " + DEEP),
        ("camera.toml", "K = " + DEEP), ("camera.json", '{"K": [[1' + "0" * 400 + ", 0, 1], [0, 1, 1], [0, 0, 1]]}"),
    ],
    "poses": [("poses.npy", npy("(1000000000000, 4, 4)")), ("poses.json", DEEP)],
    "landmarks": [("landmarks.json", DEEP)],
    "case": [("case.toml", "a = " + DEEP)],
    "mesh": [
        ("a.ply", PLY.format("binary_little_endian 1.0", 2**31, 1)),
        ("b.ply", PLY.format("ascii 1.0", 3, 10**30)),
        ("c.stl", bytes(80) + struct.pack("<I", 2**32 - 1) + bytes(150)),
        ("d.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999\n"),
    ],
    "volume": [("ct.nrrd", NRRD)],
    "drill plan": [("plan.toml", "strokes = " + DEEP)],
}  # fmt: skip
NO_FILES: dict[str, Callable[[Path], object]] = {
    "pipe": os.mkfifo,
    "folder": Path.mkdir,
    "zeros without end": lambda path: path.symlink_to("/dev/zero"),
    "gone": lambda path: path.symlink_to("nowhere"),
    "5 GB": sparse,
}
READERS = {
    "camera.json": "camera", "poses.npy": "poses", "landmarks.csv": "landmarks", "case.toml": "case",
    "photographs.json": "photographs", "mesh.ply": "mesh", "frame.png": "image header", "film.mp4": "video",
    "plan.toml": "drill plan", "ct.nii": "volume",
}  # fmt: skip


def test_claims_and_what_is_no_file_end_in_a_sentence(tmp_path):
    ran = tmp_path / "it-ran"
    made = [(reader, file, data) for reader, files in CLAIMS.items() for file, data in files]
    made.append(("camera", "camera.pkl", pickle.dumps({"camera_intrinsics": Call(ran)})))
    answers = []
    with Victims() as victims:

        def opened(name: str, reader: str, path: Path) -> None:
            answers.append((name, path.name, victims.opened(reader, path)))

        for number, (reader, file, data) in enumerate(made):
            path = tmp_path / str(number) / file
            path.parent.mkdir()
            path.write_bytes(data if isinstance(data, bytes) else data.encode())
            opened(f"{file}: {data[:60]!r}", reader, path)
        for kind, make in NO_FILES.items():
            (tmp_path / kind).mkdir()
            for file, reader in READERS.items():
                make(tmp_path / kind / file)
                opened(f"{kind}: {file}", reader, tmp_path / kind / file)
    assert faults_of(answers) == []
    assert [name for name, _, answer in answers if answer[0] != "sentence"] == []
    assert not ran.exists()


@pytest.mark.render
@pytest.mark.parametrize("reader", ["image", "button"])
def test_huge_images_end_in_a_sentence_in_blender(tmp_path, reader):
    with Victims() as victims:
        for file, data in FRAMES.items():
            (tmp_path / file).write_bytes(data)
            answer = victims.opened(reader, tmp_path / file)
            assert answer[0] == "sentence", answer
            assert faults_of([(file, file, answer)]) == []


@pytest.mark.render
@pytest.mark.parametrize(("file", "data"), [("frame.png", FRAMES["frame.png"]), ("case.toml", f"a = {DEEP}".encode())])
def test_commands_end_with_one_line(tmp_path, write_tiny_case, run_command, file, data):
    case = write_tiny_case(tmp_path / "case")
    (case.parent / file).write_bytes(data)
    script = Path(__file__).parents[2] / "scripts" / "render_dataset.py"
    ended = run_command([sys.executable, str(script), str(case), "--out", str(tmp_path / "out")])
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1), ended.stderr
    assert ended.stderr.startswith("error: ")
    assert not (tmp_path / "out").exists()
