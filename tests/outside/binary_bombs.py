"""Images, arrays, pickles, meshes and things that are no files at all, made to harm who opens them."""

import io
import itertools
import os
import pickle
import socket
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from tests.outside.bombs import MB, Bomb, content

SIDES = (0, 1, 64, 5_000, 20_000, 65_535, 2**31 - 1, 2**32 - 1)


# --- images: headers that announce any size, with few pixels behind them


def png(width: int, height: int, depth: int = 8, colours: int = 2, data: bytes = b"", more: bytes = b"") -> bytes:
    """A PNG with correct checksums around anything."""
    header = struct.pack(">IIBBBBB", width, height, depth, colours, 0, 0, 0)
    body = chunk(b"IHDR", header) + more + chunk(b"IDAT", data or zlib.compress(bytes(9999)))
    return b"\x89PNG\r\n\x1a\n" + body + chunk(b"IEND", b"")


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def jpeg(width: int, height: int, scans: int = 1, more: bytes = b"") -> bytes:
    """Header and scans of a JPEG, whose tables are missing."""
    frame = b"\xff\xc2" + struct.pack(">HBHHB", 17, 8, height & 0xFFFF, width & 0xFFFF, 3) + bytes(9)
    scan = b"\xff\xda" + struct.pack(">HB", 12, 3) + bytes(9) + b"\x12\x34\xff\x00\x56"
    return b"\xff\xd8" + more + frame + scan * scans + b"\xff\xd9"


def tiff(order: str, tags: list[tuple[int, int, int, int]], offset: int = 8) -> bytes:
    """A TIFF of (tag, type, number, value)."""
    begin = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "I", offset)
    entries = b"".join(struct.pack(order + "HHII", *tag) for tag in tags)
    return begin + struct.pack(order + "H", len(tags)) + entries + bytes(4) + bytes(400)


def tiff_of(width: int, height: int, channels: int = 3, bits: int = 8, order: str = "<") -> bytes:
    fields = {256: width, 257: height, 258: bits, 259: 1, 262: 2, 273: 8, 277: channels, 278: height, 279: 400}
    return tiff(order, [(tag, 4, 1, value & 0xFFFFFFFF) for tag, value in fields.items()])


def bmp(width: int, height: int, bits: int = 24) -> bytes:
    info = struct.pack("<IiiHHIIiiII", 40, signed(width), signed(height), 1, bits, 0, 0, 0, 0, 0, 0)
    return b"BM" + struct.pack("<IHHI", 54 + 400, 0, 0, 54) + info + bytes(400)


def signed(value: int) -> int:
    return value - 2**32 if value >= 2**31 else value


def exr(width: int, height: int, channels: int = 3, flags: int = 2, compression: int = 0) -> bytes:
    def attribute(name: str, kind: str, value: bytes) -> bytes:
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<I", len(value)) + value

    names = b"".join(b"%06d\0" % number + struct.pack("<iIii", 2, 0, 1, 1) for number in range(channels))
    window = struct.pack("<iiii", 0, 0, signed((width - 1) % 2**32), signed((height - 1) % 2**32))
    return (
        b"\x76\x2f\x31\x01" + struct.pack("<I", flags) + attribute("channels", "chlist", names + b"\0")
        + attribute("compression", "compression", bytes([compression])) + attribute("dataWindow", "box2i", window)
        + attribute("displayWindow", "box2i", window) + attribute("lineOrder", "lineOrder", b"\0")
        + attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
        + attribute("screenWindowCenter", "v2f", bytes(8)) + attribute("screenWindowWidth", "float", bytes(4))
        + b"\0" + bytes(400)
    )  # fmt: skip


def images() -> dict[str, bytes]:
    """Name -> bytes."""
    found: dict[str, bytes] = {}
    for width, height in itertools.product(SIDES, SIDES):
        for name, make in {"png": png, "jpg": jpeg, "tif": tiff_of, "bmp": bmp, "exr": exr}.items():
            found[f"{width} x {height}.{name}"] = make(width, height)
    zeros = zlib.compress(bytes(3 * 5000 * 5000 + 5000), 9)
    return found | {
        "whole, 25 million pixels.png": png(5000, 5000, data=zeros),
        "400 million pixels in a few bytes.png": png(20_000, 20_000, 1, 0, zlib.compress(bytes(2501 * 20_000), 9)),
        "more pixels than announced.png": png(64, 48, data=zlib.compress(bytes(100 * MB), 9)),
        "a profile.png": png(64, 48, more=chunk(b"iCCP", b"a\0\0" + zlib.compress(bytes(100 * MB), 9))),
        "a text.png": png(64, 48, more=chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(100 * MB), 9))),
        "chunks.png": png(64, 48, more=chunk(b"abCd", b"") * 700_000),
        "a chunk without end.png": png(64, 48)[:33] + b"\xff\xff\xff\xffIDAT" + bytes(99),
        "no header.png": png(64, 48)[:8] + chunk(b"IDAT", b"") + chunk(b"IEND", b""),
        "headers.png": png(64, 48, more=chunk(b"IHDR", struct.pack(">IIBBBBB", 9, 60_000, 8, 2, 0, 0, 0)) * 9),
        "a palette.png": png(64, 48, 8, 3, more=chunk(b"PLTE", bytes(768))),
        "odd colours.png": png(64, 48, 7, 5),
        "scans.jpg": jpeg(5000, 5000, 5000),
        "a scan too many.jpg": jpeg(5000, 5000, 65),
        "segments.jpg": jpeg(64, 48, more=b"\xff\xfe\x00\x02" * 500_000),
        "padding.jpg": b"\xff\xd8" + b"\xff" * (4 * MB) + b"\xff\xd9",
        "restarts.jpg": b"\xff\xd8" + b"\xff\xd0" * (2 * MB) + b"\xff\xd9",
        "a lying segment.jpg": b"\xff\xd8\xff\xe1\xff\xffExif\0\0II*\0\xff\xff\xff\xff" + b"\xff\xd9",
        "two frames.jpg": jpeg(64, 48, more=jpeg(5000, 5000)[2:21]),
        "channels.tif": tiff_of(64, 48, 65_535),
        "bits.tif": tiff_of(64, 48, 3, 65_535),
        "big end.tif": tiff_of(20_000, 20_000, order=">"),
        "tags.tif": tiff("<", [(number, 4, 2**32 - 1, 2**32 - 1) for number in range(256, 5000)]),
        "an offset.tif": tiff("<", [], offset=2**32 - 1),
        "itself.tif": tiff("<", [], offset=0),
        "a mirrored one.tif": tiff("<", [(256, 4, 1, 64), (257, 4, 1, 48), (0x0112, 3, 1, 2)]),
        "channels.exr": exr(64, 48, 100_000),
        "deep.exr": exr(64, 48, flags=0x0802),
        "tiles.exr": exr(64, 48, flags=0x0202),
        "parts.exr": exr(64, 48, flags=0x1002)[:-401] * 3000,
        "compression.exr": exr(64, 48, compression=255),
        "a name without end.exr": b"\x76\x2f\x31\x01\2\0\0\0" + b"a" * MB,
        "an attribute without end.exr": b"\x76\x2f\x31\x01\2\0\0\0a\0b\0\xff\xff\xff\xff",
        "bits.bmp": bmp(64, 48, 65_535),
        "a short header.bmp": b"BM" + bytes(16),
        "a film.png": b"\0\0\0\x18ftypmp42" + bytes(99),
        "a vector.png": b"<svg>" * 99,
    }


# --- arrays and pickles


def npy(shape: str, kind: str = "'<f8'", order: str = "False", data: bytes = bytes(4096)) -> bytes:
    header = f"{{'descr': {kind}, 'fortran_order': {order}, 'shape': {shape}, }}"
    header = header.ljust(-(len(header) + 11) % 64 + len(header)) + "\n"
    return b"\x93NUMPY\x02\x00" + struct.pack("<I", len(header)) + header.encode() + data


def npz(members: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as file:
        for name, data in members.items():
            file.writestr(name, data)
    return stream.getvalue()


SHAPES = (
    "()", "(0,)", "(9,)", "(3, 3)", "(4, 4)", "(1000000000000, 4, 4)", "(1000000000, 0)", "(0, 4, 4)", "(-1, 4, 4)",
    "(16, 4, 4)", "(True, 4, 4)", "(1, " * 31 + "1" + ")" * 31, "(1,) * 1000000000", "(2**64,)", "4", "None",
    "(512,)", "(512, 1)", "(1, 512)", "(" + "1, " * 60 + "512)", "(" + "9" * 5000 + ",)", "[" * 5000,
)  # fmt: skip
KINDS = (
    "'<f8'", "'>f8'", "'<f2'", "'<i8'", "'|b1'", "'|O'", "'<U128'", "'|V8'", "'|V2147483647'", "'<c16'", "'<M8[ns]'",
    "[('a', '<f8')]", "[('a', '|O')]", "'f8,f8'", "'" + "f8," * 5000 + "f8'", "None", "__import__('os')",
)  # fmt: skip


class Call:
    """Unpickled, it calls."""

    def __init__(self, function: Callable, *arguments: object) -> None:
        self.call = function, arguments

    def __reduce__(self) -> tuple:
        return self.call


def pickles() -> dict[str, bytes]:
    return {
        "a command": pickle.dumps({"camera_intrinsics": Call(os.mkdir, "/tmp/it-ran")}),
        "a far place": b"\x80\x02}r\xff\xff\xff\xff.",
        "a long text": b"\x80\x04\x8d" + b"\xff" * 7 + b"\x7f",
        "numbers": pickle.dumps({"K": list(range(10**5))}),
    }


def arrays() -> Iterator[tuple[str, str, bytes]]:
    """Name, reader and bytes."""
    made = {f"{kind[:20]} {shape[:20]} {order}": npy(shape, kind, order)
            for shape, kind, order in [*itertools.product(SHAPES, KINDS[:1], ("False", "True")),
                                       *itertools.product(SHAPES[3:5], KINDS, ("False",)),
                                       ("(3, 3)", "'<f8'", "None"), ("(3, 3)", "'<f8'", "1" * 9999)]}  # fmt: skip
    made |= {
        "small numbers in rows": npy("(4000000, 1)", "'|i1'", data=bytes(4_000_000)),
        "identical poses": npy("(20000, 4, 4)", "'<f4'", data=bytes(20_000 * 64)),
        "a header without end": b"\x93NUMPY\x02\x00\xff\xff\xff\xff{" + b"[" * 100_000,
        "an unknown version": b"\x93NUMPY\x09\x00" + bytes(99),
        "NaN": npy("(4, 4)", data=np.full(16, np.nan).tobytes()),
        "infinity": npy("(3, 3)", data=np.full(9, np.inf).tobytes()),
        "the largest": npy("(4, 4)", data=np.full(16, np.finfo(float).max).tobytes()),
        "hardly any": npy("(3, 3)", data=(np.eye(3) * 5e-324).tobytes()),
    }
    for (name, data), reader in itertools.product(made.items(), ("camera", "pose", "poses")):
        yield name, reader, data
    zeros = npy("(1000000,)", data=bytes(8_000_000))
    archives = {
        "40 arrays of nothing": npz({f"{number}.npy": zeros for number in range(40)}),
        "many arrays": npz({f"{number}.npy": b"" for number in range(20_000)}),
        "twice the same": npz({"K.npy": npy("(3, 3)")}) * 2,
        "levels of folders": npz({"a/" * 5000 + "K.npy": npy("(3, 3)")}),
        "upwards": npz({"../../K.npy": npy("(3, 3)")}),
        "objects": npz({"K.npy": npy("(3, 3)", "'|O'")}),
        "another compression": npz({"K.npy": npy("(3, 3)")}, zipfile.ZIP_LZMA),
        "bzip2": npz({"K.npy": zeros}, zipfile.ZIP_BZIP2),
        "a lie about its size": npz({"K.npy": zeros}).replace(struct.pack("<I", len(zeros)), struct.pack("<I", 200)),
        "a larger lie": npz({"K.npy": zeros}).replace(struct.pack("<I", len(zeros)), b"\xff\xff\xff\xff"),
        "nothing": npz({}),
        "the beginning": b"PK\3\4" + bytes(99),
    }  # fmt: skip
    yield from ((name, "camera", data) for name, data in archives.items())


# --- meshes


def ply(vertices: object, faces: object, length: str, index: str, body: bytes, order: str = "little") -> bytes:
    header = (
        f"ply\nformat binary_{order}_endian 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {faces}\nproperty list {length} {index} vertex_indices\nend_header\n"
    )
    return header.encode() + body


def meshes() -> Iterator[tuple[str, bytes]]:
    """Name of the file and bytes."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
    triangle = b"\x03" + struct.pack("<iii", 0, 1, 2)
    for count in (-1, 0, 1, 3, 10**7, 2**31, 2**63, 10**30, "9" * 5000, "²", "1e3", "0x10", ""):
        yield f"{str(count)[:20]} vertices.ply", ply(count, 1, "uchar", "int", corners + triangle)
        yield f"{str(count)[:20]} faces.ply", ply(3, count, "uchar", "int", corners + triangle)
    for length, index in itertools.product(
        ("char", "uchar", "int", "uint", "float", "double"), ("char", "float", "int")
    ):
        for number in (0, 1, 2, 127):
            body = corners + bytes([number]) + bytes(range(1, 60))
            yield f"{number} of {length} {index}.ply", ply(3, 1, length, index, body)
            yield f"{number} of {length} {index}, reversed.ply", ply(3, 1, length, index, body, "big")
    yield "a list of all.ply", ply(3, 1, "uint", "uchar", corners + b"\xff\xff\xff\xff" + bytes(99))
    yield "a negative list.ply", ply(3, 2, "int", "int", corners + struct.pack("<i", -3) + bytes(99))
    yield "lists of nothing.ply", ply(3, 8 * MB, "uchar", "int", corners + bytes(8 * MB))
    yield "one list of something.ply", ply(3, 2 * MB + 1, "uchar", "int", corners + triangle + bytes(2 * MB))
    yield "many lists of something.ply", ply(3, 8 * MB + 1, "uchar", "int", corners + triangle + bytes(8 * MB))
    yield "NaN.ply", ply(3, 1, "uchar", "int", np.full((3, 3), np.nan, "<f4").tobytes() + triangle)
    yield "infinity.ply", ply(3, 1, "uchar", "int", np.full((3, 3), np.inf, "<f4").tobytes() + triangle)
    yield "NaN as index.ply", ply(3, 1, "uchar", "float", corners + b"\x03" + np.full(3, np.nan, "<f4").tobytes())
    yield "a large polygon.ply", ply(3, 1, "uint", "uchar", corners + struct.pack("<I", 8 * MB) + bytes(8 * MB))
    yield "all zeros.ply", ply(600_000, 600_000, "uchar", "int", bytes(600_000 * 25))
    for announced in (0, 1, 2, 10**7 + 1, 2**31, 2**32 - 1):
        yield f"{announced} triangles.stl", bytes(80) + struct.pack("<I", announced) + bytes(150)
    yield "zeros.stl", bytes(80) + struct.pack("<I", 150_000) + bytes(50 * 150_000)
    yield "NaN.stl", bytes(80) + struct.pack("<I", 2) + b"\xff" * 100
    yield "solid.stl", b"solid" + bytes(75) + struct.pack("<I", 2**32 - 1) + bytes(150)
    for number in ("nan", "inf", "1e400", "-1e308", "1e-400", "0x1p3", "1_0", "1,5", "9" * 5000):
        yield f"{number[:10]}.obj", f"v {number} 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".encode()
        yield (
            f"{number[:10]}.stl",
            (
                f"solid a\nfacet normal 0 0 1\nouter loop\nvertex {number} 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
                "endloop\nendfacet\nendsolid a\n"
            ).encode(),
        )
    for number in ("0", "-1", "-4", "4", "99999999999", "9" * 30, "1.5", "1//", "/", "1/1/1/1", "+1", "- 1"):
        yield f"face {number.replace('/', 's')[:12]}.obj", f"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 {number}\n".encode()


# --- what is no file, or one without end


def socket_at(path: Path) -> None:
    """A socket; its path may be too long for one."""
    folder = os.open(path.parent, os.O_RDONLY)
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(f"/proc/self/fd/{folder}/{path.name}")
    os.close(folder)


def sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.write(b"ply\n" if path.suffix == ".ply" else b"")
        file.truncate(5 << 30)


def smaller(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(300 * MB)


NO_FILES: dict[str, Callable[[Path], object]] = {
    "pipe": os.mkfifo,
    "folder": Path.mkdir,
    "socket": socket_at,
    "zeros without end": lambda path: path.symlink_to("/dev/zero"),
    "nothing": lambda path: path.symlink_to("/dev/null"),
    "terminal": lambda path: path.symlink_to("/dev/tty"),
    "its own memory": lambda path: path.symlink_to("/proc/self/mem"),
    "kernel messages": lambda path: path.symlink_to("/proc/kmsg"),
    "the machine's memory": lambda path: path.symlink_to("/proc/kcore"),
    "itself": lambda path: path.symlink_to(path.name),
    "gone": lambda path: path.symlink_to("nowhere"),
    "5 GB": sparse,
    "300 MB": smaller,
}
READERS = {
    "camera.json": "camera", "camera.npy": "camera", "pose.npy": "pose", "poses.npy": "poses", "poses.json": "poses",
    "landmarks.csv": "landmarks", "case.toml": "case", "photographs.json": "photographs", "mesh.ply": "mesh",
    "mesh.obj": "mesh", "mesh.stl": "mesh", "frame.png": "image header", "film.mp4": "video",
    "whole.mp4": "film", "plan.toml": "drill plan", "ct.nii": "volume", "ct.nii.gz": "volume", "ct.nrrd": "volume",
    "ct.mha": "volume", "labels.nii": "labels",
}  # fmt: skip


def binaries() -> Iterator[Bomb]:
    """All of the above, but the images."""
    for name, reader, data in arrays():
        yield Bomb(f"{name}, {reader}", reader, "array.npy", content(data))
    for name, data in pickles().items():
        yield Bomb(name, "camera", "camera.pkl", content(data))
    for name, data in meshes():
        yield Bomb(name, "mesh", "mesh" + Path(name).suffix, content(data))
    for (name, make), (file, reader) in itertools.product(NO_FILES.items(), READERS.items()):
        yield Bomb(f"{name}, {file}", reader, file, make)


def pictures(reader: str) -> Iterator[Bomb]:
    """The images, for a reader."""
    for name, data in images().items():
        yield Bomb(f"{name}, {reader}", reader, "frame" + Path(name).suffix, content(data))
