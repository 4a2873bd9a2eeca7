"""Files that mean harm, for each reader: nested, endless, huge, lying, damaged.

Each bomb is a name, the name of a file, and a function that writes it. All are determined by their names.
"""

import gzip
import itertools
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

KB, MB = 1 << 10, 1 << 20
SIZES = {"1 KB": KB, "40 KB": 40 * KB, "600 KB": 600 * KB, "8 MB": 8 * MB}


@dataclass(frozen=True)
class Bomb:
    """``reader`` names a function of :mod:`victim`, ``write`` makes the file and whatever it needs beside it."""

    name: str
    reader: str
    file: str
    write: Callable[[Path], None]


def content(data: bytes | str) -> Callable[[Path], None]:
    """Writes bytes, or a text with any half of a surrogate pair."""
    data = data.encode(errors="surrogatepass") if isinstance(data, str) else data
    return lambda path: void(path.write_bytes(data))


def void(_: object) -> None:
    """What a function returns that writes."""


# --- texts of any size, for every reader

UNITS: dict[str, tuple[str, str, str]] = {
    "open brackets": ("", "[", ""),
    "open braces": ("", '{"a":', ""),
    "open pairs": ("", '[{"K":', ""),
    "round brackets": ("", "(", ""),
    "newlines": ("", "\n", ""),
    "newlines and a colon": ("", "\n", "a:"),
    "newlines in a key": ("K", "\n", ": 1"),
    "carriage returns": ("", "\r", ""),
    "spaces": ("", " ", ""),
    "tabs before a key": ("", "\t", "K: 1"),
    "zeros": ("", "\0", ""),
    "digits": ("", "9", ""),
    "digits of K": ('{"K": [', "7", "]}"),
    "digits after the point": ("0.", "3", ""),
    "exponents": ("1e", "9", ""),
    "minus signs": ("", "-", ""),
    "list marks": ("", "- ", ""),
    "question marks": ("", "? ", ""),
    "colons": ("", ": ", ""),
    "quotes": ("", '"', ""),
    "apostrophes": ("", "'", ""),
    "backslashes": ('"', "\\", '"'),
    "escapes": ('["', "\\u0041", '"]'),
    "commas": ("", ",", ""),
    "semicolons": ("name;x;y;z;u;v;", ";", "\n1;2;3"),
    "columns": ("name,x,y,z,u,v", ",enable", "\n1"),
    "a long cell": ("name,x,y,z,u,v\n", "a", ",1,2,3,4,5\n"),
    "rows": ("name,x,y,z,u,v\n", "a,1,2,3,4,5\n", ""),
    "empty rows": ("name,x,y,z,u,v\n", ",,,,,\n", ""),
    "words": ("", "word ", ""),
    "numbers": ("", "1 ", ""),
    "numbers and a word": ("", "1\n", "x"),
    "numbers on a line and a word": ("", "1 ", "x"),
    "comments": ("", "#\n", ""),
    "yaml levels": ("K: ", "[", "1"),
    "yaml tables": ("K: ", "{a: ", "1"),
    "yaml keys": ("%YAML:1.0\n---\n", "a: 1\n", ""),
    "yaml tags": ("K: ", "!!a ", "1"),
    "yaml text": ("K: |\n", "  x\n", ""),
    "xml levels": ("<?xml version='1.0'?><opencv_storage>", "<a>", ""),
    "xml attributes": ("<?xml version='1.0'?><opencv_storage><a ", "b='1' ", "/></opencv_storage>"),
    "xml spaces": ("<?xml version='1.0'?>", "\n", "<opencv_storage></opencv_storage>"),
    "xml comment": ("<?xml version='1.0'?><opencv_storage><!--", "-", ""),
    "xml numbers": ("<?xml version='1.0'?><opencv_storage><K>", "1 ", "</K></opencv_storage>"),
    "xml elements": ("<?xml version='1.0'?><opencv_storage>", "<_>1</_>", "</opencv_storage>"),
    "toml levels": ("K = ", "[", ""),
    "toml tables": ("K = ", "{a = ", ""),
    "toml dots": ("K", ".a", " = 1"),
    "toml heads": ("[camera", ".a", "]"),
    "toml lists of tables": ("", "[[landmarks]]\n", ""),
    "toml numbers": ("K = [", "1.5, ", "]"),
    "toml text": ('K = """', "\\\n", '"""'),
    "many keys": ("{", '"a":1,', '"b":1}'),
    "many lists": ("[", "[],", "[]]"),
    "many tables": ("[", "{},", "{}]"),
    "many cameras": ("[", '{"fx":1,"cx":2,"cy":3},', '{"fx":1,"cx":2,"cy":3}]'),
    "many named": ("[", '{"name":"a"},', '{"name":"b"}]'),
    "not a number": ("[", "NaN,", "NaN]"),
    "vertices": ("", "v 1 2 3\n", ""),
    "vertices without numbers": ("", "v \n", ""),
    "faces without numbers": ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "f \n", "f 1 2 3\n"),
    "a large face": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf", " 1 2 3", "\n"),
    "faces": ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "f 1 2 3\n", ""),
    "flat faces": ("v 0 0 0\n", "f 1 1 1\n", ""),
    "slashes": ("v 0 0 0\nf 1", "/", "\n"),
    "continued lines": ("v 0 0 ", "\\\n", "0\n"),
    "facets": ("solid a\n", "facet\n", "endsolid\n"),
    "ends of facets": ("solid a\n", "endfacet ", "\nendsolid\n"),
    "solids": ("", "solid a\n", "endsolid\n"),
    "solid words": ("solid a\n", "a ", "\nendsolid\n"),
    "ply elements": ("ply\nformat ascii 1.0\n", "element a 0\n", "end_header\n"),
    "ply properties": ("ply\nformat ascii 1.0\nelement vertex 1\n", "property float x\n", "end_header\n1\n"),
    "ply comments": ("ply\nformat ascii 1.0\n", "comment\n", "end_header\n"),
    "ply numbers": (
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n",
        "0 ", "",
    ),
    "ply uneven faces": (
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 99999\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n3 0 0 0\n",
        "0\n", "",
    ),
}  # fmt: skip
"""Name -> beginning, what is repeated, end."""


def closed(begin: str, end: str) -> Callable[[int], str]:
    """As many levels as fit, each closed again."""
    return lambda size: begin * (size // len(begin + end)) + "1" + end * (size // len(begin + end))


def yaml_indented(size: int) -> str:
    """A table in a table, each one space further to the right."""
    levels = int((2 * size) ** 0.5)
    return "".join(" " * level + "a:\n" for level in range(levels))


def yaml_laughs(size: int) -> str:
    """Each line recalls the one before ten times."""
    lines = [f"a{level}: &a{level} [{', '.join([f'*a{level - 1}'] * 10)}]" for level in range(1, min(size // 60, 5000))]
    return "a0: &a0 [1]\n" + "\n".join(lines)


def xml_laughs(size: int) -> str:
    """Each entity holds the one before ten times."""
    entities = "".join(f'<!ENTITY a{level} "{f"&a{level - 1};" * 10}">' for level in range(1, min(size // 90, 2000)))
    return f'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY a0 "ha">{entities}]><opencv_storage>&a9;</opencv_storage>'


MADE: dict[str, Callable[[int], str | bytes]] = {
    "closed brackets": closed("[", "]"),
    "closed braces": closed('{"a":', "}"),
    "closed cameras": closed('{"camera":', "}"),
    "closed lists of K": lambda size: '{"K":' + closed("[", "]")(size) + "}",
    "closed lists of poses": lambda size: '{"cam_from_mesh":' + closed("[", "]")(size) + "}",
    "closed xml": lambda size: f"<?xml version='1.0'?><opencv_storage>{closed('<a>', '</a>')(size)}</opencv_storage>",
    "closed yaml": lambda size: "K: " + closed("[", "]")(size),
    "closed toml": lambda size: "K = " + closed("[", "]")(size),
    "closed toml tables": lambda size: "K = " + closed("{a = ", "}")(size),
    "yaml indentation": yaml_indented,
    "yaml laughs": yaml_laughs,
    "xml laughs": xml_laughs,
    "keys": lambda size: "{" + ",".join(f'"{number}": {{}}' for number in range(size // 12)) + "}",
    "toml keys": lambda size: "\n".join(f"a{number} = 1" for number in range(size // 12)),
    "toml parts": lambda size: "\n".join(f"a.b{number}.c.d = 1" for number in range(size // 18)),
    "UTF-16": lambda size: ("[" * (size // 2)).encode("utf-16"),
    "UTF-16 cut off": lambda size: b"\xff\xfe" + b"[\0" * (size // 2) + b"[",
    "no UTF-8": lambda size: b"\xc3\x28" * (size // 2),
    "a mark and brackets": lambda size: b"\xef\xbb\xbf" + b"[" * size,
    "compressed": lambda size: gzip.compress(bytes(size * 100), mtime=0),
    "noise": lambda size: np.random.default_rng(size).bytes(size),
    "noise of letters": lambda size: bytes(
        np.random.default_rng(size).choice(np.frombuffer(b"[]{}\":,.-+0123456789eENa\n \\'#=&*!<>/", np.uint8), size)
    ),
}

TEXT_READERS = {
    "camera.json": "camera", "camera.yaml": "camera", "camera.toml": "camera", "camera": "camera", "pose.json": "pose",
    "pose.txt": "pose", "poses.json": "poses", "landmarks.csv": "landmarks", "landmarks.json": "landmarks",
    "case.toml": "case", "photographs.json": "photographs", "mesh.ply": "mesh", "mesh.obj": "mesh", "mesh.stl": "mesh",
    "plan.toml": "drill plan", "ct.nrrd": "volume", "ct.mhd": "volume", "ct.nii": "volume",
}  # fmt: skip


def texts() -> Iterator[Bomb]:
    """Every text, in every size, for the readers in turn."""
    units = {
        name: (lambda size, parts=parts: parts[0] + parts[1] * (size // len(parts[1])) + parts[2])
        for name, parts in UNITS.items()
    }
    makers: dict[str, Callable[[int], str | bytes]] = units | MADE
    readers = list(TEXT_READERS.items())
    for turn, (name, make) in enumerate(makers.items()):
        for (label, size), shift in zip(SIZES.items(), (0, 1, 3, 0), strict=True):
            # all readers for the middle sizes, which hold the levels that crashed parsers; some for the others
            chosen = readers if label == "40 KB" else readers[(turn + shift) % 3 :: 3]
            for file, reader in chosen:
                yield Bomb(
                    f"{name}, {label}, {file}",
                    reader,
                    file,
                    lambda path, make=make, size=size: content(make(size))(path),
                )


# --- hostile values where a number or a name is expected

VALUES: dict[str, str] = {
    "deep": "[" * 30 + "]" * 30,
    "deeper": "[" * 400 + "]" * 400,
    "wide": "[" + ",".join(["1"] * 100_000) + "]",
    "rows": "[" + ",".join(["[1,2,3,4]"] * 4) + "]",
    "large": "1" + "0" * 400,
    "larger": "9" * 5000,
    "64 bits": "9223372036854775808",
    "long float": "0." + "3" * 400,
    "longer float": "1." + "7" * 100_000,
    "huge exponent": "1e400",
    "huger exponent": "1e999999999",
    "tiny": "1e-320",
    "largest": "1.7976931348623157e308",
    "NaN": "NaN",
    "infinity": "-Infinity",
    "null": "null",
    "true": "true",
    "empty list": "[]",
    "empty table": "{}",
    "text": '"x"',
    "long text": json.dumps("x" * 200_000),
    "zero in a text": '"a\\u0000b"',
    "half a pair": '"\\ud800.png"',
    "control characters": '"\\u001b[2J\\u0007\\r"',
    "endless file": '"/dev/zero"',
    "terminal": '"/dev/stdin"',
    "memory": '"/proc/self/mem"',
    "folder": '"."',
    "long name": json.dumps("n" * 300),
    "deep name": json.dumps("../" * 3000 + "etc/passwd"),
}

K = "[[900.0, 0, 32], [0, 900, 24], [0, 0, 1]]"
POSE = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 300], [0, 0, 0, 1]]"
CASE = (
    'units = "mm"\n[frame]\nimage = "frame.png"\n[camera]\nsize = [64, 48]\nK = {K}\n[surface]\nmesh = "surface.ply"\n'
    "[pose]\ncam_from_mesh = {POSE}\n"
)
STROKE = "[[strokes]]\nradius_mm = 2.0\npoints_mm = {points}\n"
NRRD = (
    "NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 8 8 8\nencoding: raw\n"
    "space directions: (1,0,0) (0,1,0) (0,0,1)\nendian: little\n\n"
)
TEMPLATES: dict[str, tuple[str, str, str]] = {
    "K": ("camera", "camera.json", '{"K": @}'),
    "an entry of K": ("camera", "camera.json", '{"K": [[@, 0, 1], [0, 1, 1], [0, 0, 1]]}'),
    "fx": ("camera", "camera.json", '{"fx": @, "cx": 1, "cy": 1}'),
    "distortion": ("camera", "camera.json", f'{{"K": {K}, "distortion": @}}'),
    "size": ("camera", "camera.json", f'{{"K": {K}, "size": @}}'),
    "pixel origin": ("camera", "camera.json", f'{{"K": {K}, "pixel_origin": @}}'),
    "model": ("camera", "camera.json", f'{{"K": {K}, "model": @, "distortion": [1, 2, 3]}}'),
    "yaml K": ("camera", "camera.yaml", "K: @\n"),
    "yaml data": ("camera", "camera.yaml", "K:\n  rows: 3\n  cols: 3\n  dt: d\n  data: @\n"),
    "yaml matrix": ("camera", "camera.yaml", "K: !!opencv-matrix\n  rows: @\n  cols: 3\n  dt: d\n  data: [1, 2]\n"),
    "numbers": ("camera", "camera.txt", "@ 0 1 0 1 1 0 0 1"),
    "colmap": ("camera", "cameras.txt", "1 PINHOLE @ 480 500 500 320 240\n"),
    "colmap's numbers": ("camera", "cameras.txt", "1 PINHOLE 640 480 @ 500 320 240\n"),
    "pose": ("pose", "pose.json", '{"cam_from_mesh": @}'),
    "an entry of a pose": ("pose", "pose.json", f'{{"cam_from_mesh": {POSE.replace("300", "@")}}}'),
    "a row of a pose": ("pose", "pose.json", '{"cam_from_mesh": [[1, 0, 0, 0], @, [0, 0, 1, 0], [0, 0, 0, 1]]}'),
    "poses": ("poses", "poses.json", "[@]"),
    "an entry of poses": ("poses", "poses.json", f"[{POSE.replace('[1, 0', '[@, 0')}]"),
    "a named pose": ("poses", "poses.json", '[{"cam_from_mesh": @}]'),
    "landmark": ("landmarks", "landmarks.json", "[@]"),
    "its name": ("landmarks", "landmarks.json", '[{"name": @}]'),
    "its point": ("landmarks", "landmarks.json", '[{"name": "a", "surface": @}]'),
    "an entry of its point": ("landmarks", "landmarks.json", '[{"name": "a", "surface": [@, 2, 3]}]'),
    "its pixel": ("landmarks", "landmarks.json", '[{"name": "a", "pixel": [@, 2]}]'),
    "a cell": ("landmarks", "landmarks.csv", "name,x,y,z,u,v\na,@,2,3,4,5\n"),
    "photograph": ("photographs", "photographs.json", "[@]"),
    "its image": ("photographs", "photographs.json", f'[{{"image": @, "cam_from_mesh": {POSE}}}]'),
    "its pose": ("photographs", "photographs.json", '[{"image": "a.png", "cam_from_mesh": @}]'),
    "units": ("case", "case.toml", CASE.format(K=K, POSE=POSE).replace('"mm"', "@")),
    "image of a case": ("case", "case.toml", CASE.format(K=K, POSE=POSE).replace('"frame.png"', "@")),
    "mesh of a case": ("case", "case.toml", CASE.format(K=K, POSE=POSE).replace('"surface.ply"', "@")),
    "size of a case": ("case", "case.toml", CASE.format(K=K, POSE=POSE).replace("[64, 48]", "@")),
    "K of a case": ("case", "case.toml", CASE.format(K="@", POSE=POSE)),
    "an entry of a case's K": ("case", "case.toml", CASE.format(K=K.replace("32", "@"), POSE=POSE)),
    "pose of a case": ("case", "case.toml", CASE.format(K=K, POSE="@")),
    "an entry of a case's pose": ("case", "case.toml", CASE.format(K=K, POSE=POSE.replace("300", "@"))),
    "distortion of a case": (
        "case", "case.toml", CASE.format(K=K, POSE=POSE).replace("[surface]", "distortion = @\n[surface]")
    ),
    "structures of a case": (
        "case", "case.toml", CASE.format(K=K, POSE=POSE) + '[[structures]]\nname = "a"\nmesh = @\n'
    ),
    "landmarks of a case": (
        "case", "case.toml", CASE.format(K=K, POSE=POSE) + '[[landmarks]]\nname = "a"\nsurface = [@, 1, 1]\n'
    ),
    "alignment of a case": ("case", "case.toml", CASE.format(K=K, POSE=POSE) + "[alignment]\nrms_px = @\ndate = @\n"),
    "margin": ("drill plan", "plan.toml", "[margins_mm]\na = @\n" + STROKE.format(points="[[1, 2, 3]]")),
    "points of a stroke": ("drill plan", "plan.toml", STROKE.format(points="@")),
    "an entry of its points": ("drill plan", "plan.toml", STROKE.format(points="[[1, @, 3], [4, 5, 6]]")),
    "its radius": ("drill plan", "plan.toml", STROKE.format(points="[[1, 2, 3]]").replace("2.0", "@")),
    "size of a volume": ("volume", "ct.nrrd", NRRD.replace("8 8 8", "8 8 @")),
    "directions of a volume": ("volume", "ct.nrrd", NRRD.replace("(0,0,1)", "(0,0,@)")),
    "options of a case": ("case", "case.toml", CASE.format(K=K, POSE=POSE) + "[dataset]\ncount = @\n"),
}  # fmt: skip


def values() -> Iterator[Bomb]:
    """Every value in every place of every table."""
    for (place, (reader, file, text)), (name, value) in itertools.product(TEMPLATES.items(), VALUES.items()):
        if file.endswith(".toml"):
            value = value.replace("NaN", "nan").replace("Infinity", "inf").replace("null", "1979-05-27")
        yield Bomb(f"{name} as {place}", reader, file, content(text.replace("@", value)))
