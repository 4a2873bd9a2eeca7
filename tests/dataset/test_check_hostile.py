"""A folder full of harm is a dataset with findings: no traceback, no waiting, no memory, whatever a file claims."""

import io
import json
import os
import shutil
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from oneframe.dataset import layout
from oneframe.dataset.check.check_dataset import CheckReport, check_dataset
from oneframe.dataset.view_ranges import ranges_text, runs
from tests.dataset.sealing import sealed

SCENE = "train_synt/000000"
RGB, RECORD = f"{SCENE}/rgb/000001.png", f"{SCENE}/frame/000001.json"
JSON = ("camera.json", "transforms.json", "checksums.json", f"{SCENE}/scene_gt.json", RECORD)
ANY = (*JSON, "poses.csv", "video/poses.csv", "video/trajectory.mp4", "models/obj_000001.ply", "overlay.png", RGB)
posix_only = pytest.mark.skipif(os.name != "posix", reason="pipes, devices and links of POSIX")


pytestmark = pytest.mark.usefixtures("small_scenes")


def checked(root: Path) -> CheckReport:
    return check_dataset(root, stream=io.StringIO())


def edit(path: Path, **values: object) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | values))


def png(width: int, height: int, data: bytes) -> bytes:
    """A grey PNG that claims a size."""
    chunks = ((b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)), (b"IDAT", data), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in chunks
    )


def become(target: Callable[[Path], object], names: tuple[str, ...] = ANY) -> Callable[[Path], None]:
    def change(root: Path) -> None:
        for name in names:
            (root / name).unlink()
            target(root / name)

    return change


def fill(data: bytes, names: tuple[str, ...] = ANY) -> Callable[[Path], None]:
    return become(lambda path: path.write_bytes(data), names)


BOMBS: dict[str, Callable[[Path], object]] = {
    "huge PNG": fill(png(50_000, 50_000, zlib.compress(bytes(1000))), (RGB, "overlay.png", "contact_sheet.png")),
    "PNG that expands": fill(png(64, 48, zlib.compress(bytes(1 << 26))), (RGB, "overlay.png")),
    "huge PNG, sealed": lambda root: (BOMBS["huge PNG"](root), sealed(root)),
    "PNG that expands, sealed": lambda root: (BOMBS["PNG that expands"](root), sealed(root)),
    "deep JSON": fill(b'{"a":' + b"[" * 100_000 + b"]" * 100_000 + b"}", JSON),
    "long integer": fill(b'{"fx":' + b"9" * 5000 + b"}", JSON),
    "integer beyond 64 bits": lambda root: edit(root / "camera.json", depth_scale=10**4000),
    "infinite number": fill(b'{"depth_scale": 1e999, "identity": NaN}', JSON),
    "key twice": lambda root: (root / "camera.json").write_text('{"fx": 1, ' + (root / "camera.json").read_text()[1:]),
    "no UTF-8": fill(b"\xff\xfe\0\x80" * 40),
    "nothing": fill(b""),
    "sparse": lambda root: [os.truncate(root / name, 1 << 33) for name in ANY],
    "playlist": lambda root: (fill(b"#EXTM3U\nhttp://127.0.0.1:9/x\n", ("video/trajectory.mp4",))(root), sealed(root)),
    "CSV without end": fill(b'"' + b"a" * 3000, ("poses.csv", "video/poses.csv")),
    "runs beyond the image": lambda root: (edit(root / RECORD, rle_counts=[-5, 10**15]), sealed(root)),
    "pose in the surface": lambda root: (edit(root / RECORD, cam_t_m2c=[0, 0, 0]), sealed(root)),
    "pose beyond everything": lambda root: (edit(root / RECORD, cam_t_m2c=[1e300, 0, 1e300]), sealed(root)),
    "pipes": become(os.mkfifo),
    "devices": become(lambda path: path.symlink_to("/dev/zero")),
    "links to themselves": become(lambda path: path.symlink_to(path.name)),
    "folders": become(Path.mkdir),
    "a folder in a circle": lambda root: (root / SCENE / "rgb/up").symlink_to(".."),
    "the whole disk": lambda root: (shutil.rmtree(root / "models"), (root / "models").symlink_to("/")),
    "strange names": lambda root: (root / SCENE / "rgb" / os.fsdecode(b"\xff\x1b[31m\n.png")).touch(),
    "many files": lambda root: [(root / SCENE / "rgb" / f"{number}.png").touch() for number in range(3000)],
}  # fmt: skip


@posix_only
@pytest.mark.parametrize("name", BOMBS)
def test_what_means_harm_is_a_finding(copied, name):
    BOMBS[name](copied)
    report = checked(copied)
    assert report.findings
    assert all(line.isprintable() for line in report.findings.shown())
    assert len(report.findings.shown()) <= 25


@posix_only
@pytest.mark.parametrize("harm", ["pipe", "sparse", "deep", "wide", "count"])
def test_a_description_that_means_harm_is_a_finding(copied, harm):
    path = copied / "dataset.json"
    content = json.loads(path.read_text())
    if harm == "pipe":
        path.unlink()
        os.mkfifo(path)
        path.unlink()
        path.symlink_to("/dev/zero")
    elif harm == "sparse":
        os.truncate(path, 1 << 40)
    elif harm == "deep":
        path.write_bytes(b"[" * 200_000)
    elif harm == "wide":
        edit(path, camera=content["camera"] | {"width": 50_000, "height": 50_000})
    else:
        edit(path, count=10**30)
    assert checked(copied).findings


@posix_only
@pytest.mark.parametrize("name", ["models", RGB, "notes.txt"])
def test_a_link_that_leads_out_is_a_finding(copied, name):
    (copied / name).exists() or (copied / name).touch()
    shutil.move(copied / name, copied.parent / "outside")
    (copied / name).symlink_to(copied.parent / "outside")
    assert any(line.startswith(f"{name}: expected a part of the dataset") for line in checked(copied).findings.shown())
    shutil.move(copied.parent / "outside", copied / ".within")
    (copied / name).unlink()
    (copied / name).symlink_to(copied / ".within")
    assert not checked(copied).findings


def test_the_cost_is_that_of_what_exists_not_of_what_is_announced(sound, tmp_path, monkeypatch):
    monkeypatch.setattr(layout, "VIEWS_PER_SCENE", 1000)
    copied = Path(shutil.copytree(sound, tmp_path / "dataset"))
    edit(copied / "dataset.json", count=3_000_000)
    report = checked(copied)
    # three views in scene 0; scene 1 begins with the view 1000
    lines = report.findings.shown()
    expected = "expected 3000000 views, found 4: nothing exists of 3-999, 1001-2999999"
    assert f"dataset.json: {expected}" in lines
    assert len(report.findings) < 30


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux's /proc")
def test_memory_stays_small(copied):
    """All at once, in a process of its own: its peak is little more than that of the libraries."""
    for name in ("huge PNG", "deep JSON", "sparse"):
        BOMBS[name](copied)
    (copied / "camera.json").unlink()
    code = (
        "import io, sys; from pathlib import Path; from oneframe.dataset.check.check_dataset import check_dataset; "
        "check_dataset(Path(sys.argv[1]), stream=io.StringIO()); "
        "print(open('/proc/self/status').read().split('VmHWM:')[1].split()[0])"
    )
    ended = subprocess.run([sys.executable, "-c", code, copied], capture_output=True, text=True, check=True)
    assert int(ended.stdout) < 300_000


def test_numbers_are_shown_as_ranges():
    assert runs([]) == []
    assert runs([1, 2, 3, 7, 9, 10]) == [range(1, 4), range(7, 8), range(9, 11)]
    assert ranges_text([range(3, 4), range(5, 7), range(7, 9), range(9, 9)]) == "3, 5-8"
    assert ranges_text(runs(list(range(0, 20, 2)))) == "0, 2, 4, 6, ..."
