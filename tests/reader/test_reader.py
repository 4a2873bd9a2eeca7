"""The reader: the same arrays from a folder, a pack and another decoder; in threads, processes and slices."""

import io
import json
import multiprocessing
import os
import pickle
import re
import struct
import subprocess
import sys
import tarfile
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.dataset.layout import ViewPaths
from oneframe.errors import InputError
from oneframe.files.content import LARGEST_INPUT
from oneframe.images.png import encode_png
from oneframe.packing.pack import PackOptions, pack_dataset
from oneframe.reader import Dataset, View, open_dataset

PARTS = ("rgb", "depth_mm", "mask", "observed", "source_frame", "k", "cam_from_model")
ROOT = Path(__file__).resolve().parents[2]


def arrays(view: View) -> dict[str, np.ndarray]:
    return {name: getattr(view, name) for name in PARTS}


def assert_same(one: View, other: View) -> None:
    for name in PARTS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert (one.index, one.boxes, one.visib_fract) == (other.index, other.boxes, other.visib_fract)


@pytest.fixture(params=["folder", "pack"])
def opened(request, dataset, packed) -> Dataset:
    return open_dataset(dataset if request.param == "folder" else packed)


def test_arrays_are_those_of_the_files(opened, dataset):
    scene = dataset / "train_synt" / "000000"
    tables = {name: json.loads((scene / f"scene_{name}.json").read_text()) for name in ("camera", "gt", "gt_info")}
    for place, view in enumerate(opened):
        file = ViewPaths(dataset, place).file
        np.testing.assert_array_equal(view.rgb, cv2.imread(str(file("rgb")))[..., ::-1])
        np.testing.assert_array_equal(view.depth_mm, np.load(file("depth_mm")))
        for mask, kind in ((view.mask, "mask_visib"), (view.observed, "mask_observed")):
            np.testing.assert_array_equal(mask, cv2.imread(str(file(kind)), cv2.IMREAD_UNCHANGED) > 0)
        np.testing.assert_array_equal(view.source_frame, cv2.imread(str(file("source_frame")), cv2.IMREAD_UNCHANGED))
        camera, (truth,), (info,) = (tables[name][str(place)] for name in ("camera", "gt", "gt_info"))
        np.testing.assert_array_equal(view.k, np.reshape(camera["cam_K"], (3, 3)))
        np.testing.assert_array_equal(view.cam_from_model[:3, :3].ravel(), truth["cam_R_m2c"])
        np.testing.assert_array_equal(view.cam_from_model[:, 3], [*truth["cam_t_m2c"], 1])
        assert [*view.boxes.bbox_obj] == info["bbox_obj"]
        assert [*view.boxes.bbox_visib] == info["bbox_visib"]
        assert view.visib_fract == info["visib_fract"]
        assert view.index == place
        kinds = {name: (array.dtype.name, array.shape) for name, array in arrays(view).items()}
        assert kinds == {
            "rgb": ("uint8", (48, 64, 3)), "depth_mm": ("float32", (48, 64)), "mask": ("bool", (48, 64)),
            "observed": ("bool", (48, 64)), "source_frame": ("uint8", (48, 64)),
            "k": ("float64", (3, 3)), "cam_from_model": ("float64", (4, 4)),
        }  # fmt: skip
        assert all(array.flags.c_contiguous and array.flags.writeable for array in arrays(view).values())


def test_depth_without_float_depth_is_the_image_times_its_scale(copied):
    """As bop_toolkit computes it."""
    path = copied / "dataset.json"
    path.write_text(path.read_text().replace('"float_depth": true', '"float_depth": false'))
    for place, view in enumerate(open_dataset(copied)):
        image = cv2.imread(str(ViewPaths(copied, place).file("depth")), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(view.depth_mm, image.astype(np.float32) * 0.01)
        assert view.depth_mm.dtype == np.float32


def test_it_is_a_sequence(opened):
    assert (len(opened), opened.name, opened.size_wh) == (4, "lumpy sphere", (64, 48))
    assert [view.index for view in opened] == list(opened.views) == [0, 1, 2, 3]
    assert opened[-1].index == 3
    part = opened[3:0:-2]
    assert (len(part), [*part.views], part[0].index, [view.index for view in part[1:]]) == (2, [3, 1], 3, [1])
    assert [view.index for view in reversed(opened)] == [3, 2, 1, 0]
    with pytest.raises(IndexError):
        opened[4]
    places = [place for shard in opened.shards for place in shard]
    assert places == [*range(4)]


def test_chosen_views_keep_their_order_and_numbers(dataset, tmp_path):
    pack_dataset(dataset, tmp_path / "out", PackOptions(2), views=[3, 0, 2], stream=io.StringIO())
    chosen, whole = open_dataset(tmp_path / "out"), open_dataset(dataset)
    assert [*chosen.views] == [3, 0, 2]
    assert chosen.shards == (range(2), range(2, 3))
    for view in chosen:
        assert_same(view, whole[view.index])


def total(views: Dataset, place: int) -> float:
    return float(views[place].depth_mm.sum())


@pytest.mark.parametrize(("method", "opened"), [("fork", "pack"), ("spawn", "folder")], indirect=["opened"])
def test_processes_share_it(method, opened):
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"this system has no {method}")
    # the children of a fork get open files
    expected = [total(opened, place) for place in range(4)]
    code = (
        "import multiprocessing, pickle, sys\n"
        "from tests.reader.test_reader import total\n"
        "if __name__ == '__main__':\n"
        "    views = pickle.load(sys.stdin.buffer)\n"
        "    views[0].rgb\n"
        f"    with multiprocessing.get_context('{method}').Pool(2) as pool:\n"
        "        print(pool.starmap(total, [(views, place) for place in range(4)]))\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], input=pickle.dumps(opened), capture_output=True, cwd=ROOT, check=False,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr.decode()
    assert json.loads(ended.stdout) == expected


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (lambda pack: (pack / "shard-000001.tar").unlink(), "expected whole shards, but shard-000001.tar is missing"),
        (lambda pack: os.truncate(pack / "shard-000001.tar", 9000), "shard-000001.tar has 9000 bytes instead of"),
        (lambda pack: (pack / "pack.json").write_text("{}"), "expected the format 'oneframe pack 1'"),
        (lambda pack: (pack / "pack.json").write_text("{"), "pack.json: expected JSON"),
        (lambda pack: (pack / "dataset.json").write_text("{}"), "expected the format 'oneframe dataset 2'"),
    ],
)  # fmt: skip
def test_a_damaged_pack_is_a_sentence(harm, message, copied_pack):
    harm(copied_pack)
    with pytest.raises(InputError, match=message):
        open_dataset(copied_pack)


def test_what_is_no_dataset_is_a_sentence(copied, tmp_path):
    for path in (tmp_path / "nothing", tmp_path, copied / "dataset.json"):
        with pytest.raises(InputError, match=f"{re.escape(str(path))}: expected the folder of a dataset or a pack"):
            open_dataset(path)
    (copied / "train_synt/000000/frame/000002.json").unlink()
    with pytest.raises(InputError, match="expected 4 views, views 2 are missing; run the command that rendered it"):
        open_dataset(copied)


@pytest.mark.parametrize("place", range(0, 40, 4))
def test_damaged_members_are_sentences(place, copied_pack):
    """A shard of the right size with other bytes: values, or a sentence that names the shard."""
    path = copied_pack / "shard-000000.tar"
    data = bytearray(path.read_bytes())
    step = len(data) // 40
    data[place * step : place * step + 60] = b"\xff" * 60
    path.write_bytes(data)
    for view in open_dataset(copied_pack):
        for name in PARTS:
            try:
                getattr(view, name)
            except InputError as error:
                if path.name not in str(error):
                    raise


def test_claims_take_no_memory(copied, copied_pack):
    """An image of 60000 x 60000 px in a hundred bytes, a member of 8 GB, a manifest of a trillion views."""
    huge = bytearray(encode_png(np.zeros((48, 64, 3), np.uint8)))
    huge[16:24] = struct.pack(">II", 60_000, 60_000)
    huge[29:33] = struct.pack(">I", zlib.crc32(huge[12:29]))
    ViewPaths(copied, 0).file("rgb").write_bytes(huge)
    with pytest.raises(InputError, match=r"rgb/000000\.png: expected a file of a view"):
        open_dataset(copied)[0].rgb  # noqa: B018
    path = ViewPaths(copied, 0).file("depth_mm")
    path.write_bytes(path.read_bytes().replace(b"(48, 64), }    ", b"(999999999,), }"))
    with pytest.raises(InputError, match=r"depth_mm/000000\.npy: expected an array of numbers"):
        open_dataset(copied)[0].depth_mm  # noqa: B018
    shard = copied_pack / "shard-000000.tar"
    entry = tarfile.TarInfo("000000_000000.camera.json")
    entry.size = 8**11 - 1
    shard.write_bytes(entry.tobuf(tarfile.USTAR_FORMAT) + shard.read_bytes()[512:])
    sums = json.loads((copied_pack / "pack.json").read_text())
    for size in (shard.stat().st_size, 8**11 + 512):
        os.truncate(shard, size)
        sums["files"][shard.name]["bytes"] = size
        (copied_pack / "pack.json").write_text(json.dumps(sums))
        with pytest.raises(InputError, match=r"shard-000000\.tar: expected a whole shard"):
            open_dataset(copied_pack)[0].k  # noqa: B018
    path = copied_pack / "pack.json"
    text = path.read_text()
    for count in (4, 10**12):
        content = json.loads(text)
        content["views"] = [[0, 10**12]]
        path.write_text(json.dumps(content | {"count": count}))
        with pytest.raises(InputError, match=r"pack\.json: .*expected at most [0-9]+"):
            open_dataset(copied_pack)


def huge(path: Path) -> None:
    path.touch()
    os.truncate(path, 8 * LARGEST_INPUT)


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def rest(path: Path) -> None:
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(40))


@pytest.mark.skipif(os.name != "posix", reason="pipes, devices and sparse files of POSIX")
@pytest.mark.parametrize("kind", ["rgb", "depth_mm", "mask_visib", "frame"])
@pytest.mark.parametrize("make", [huge, os.mkfifo, device, rest, lambda path: None])
def test_what_cannot_be_a_file_of_a_view_is_a_sentence(kind, make, copied):
    """None of them is waited for, or read into memory."""
    view, path = open_dataset(copied)[1], ViewPaths(copied, 1).file(kind)
    path.unlink()
    make(path)
    with pytest.raises(InputError, match=f"{kind}/000001.*: expected .*; .*"):
        [getattr(view, part) for part in ("rgb", "depth_mm", "mask", "observed", "k")]
