"""Packs: what is in them, the same bytes whoever makes them, and what is refused."""

import io
import json
import re
import shutil
import tarfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.commands.__main__ import dispatch
from oneframe.dataset.tables.bop import run_lengths, write_test_targets
from oneframe.errors import InputError, RunError
from oneframe.packing.layout import mask_columns, mask_json
from oneframe.packing.pack import PackOptions, pack_dataset, verify_pack
from tests.dataset.masks import masks
from tests.tree import tree

ROOT = Path(__file__).resolve().parents[2]
COUNT = 4


def pack(root: Path, out: Path, **options) -> dict[str, bytes]:
    how = PackOptions(options.pop("views_per_shard", 3))
    pack_dataset(root, out, how, stream=io.StringIO(), **options)
    return tree(out)


def test_the_same_bytes_whoever_packs(dataset, packed, tmp_path):
    """Any number of threads, another place, and again over what is there."""

    expected = pack(dataset, tmp_path / "one", views_per_shard=1)
    elsewhere = Path(shutil.copytree(dataset, tmp_path / "moved" / "dataset"))
    assert pack(elsewhere, tmp_path / "three", views_per_shard=1, workers=3) == expected
    before = (tmp_path / "one" / "shard-000000.tar").stat().st_mtime_ns
    assert pack(dataset, tmp_path / "one", views_per_shard=1) == expected
    assert (tmp_path / "one" / "shard-000000.tar").stat().st_mtime_ns == before
    assert pack(dataset, tmp_path / "again") == tree(packed)


def test_chosen_views_in_their_order(dataset, tmp_path):
    files = pack(dataset, tmp_path / "out", views=[3, 0, 2], views_per_shard=2)
    keys = {"000000_000003": 0, "000000_000000": 0, "000000_000002": 1}
    assert json.loads(files["key_to_shard.json"]) == keys
    assert list(json.loads(files["key_to_shard.json"])) == list(keys)
    write_test_targets(tmp_path, [0, 2, 3])
    assert files["test_targets_bop19.json"] == (tmp_path / "test_targets_bop19.json").read_bytes()
    assert verify_pack(tmp_path / "out", stream=io.StringIO()) == []
    for views in ([], [0, 0], [4], [-1]):
        with pytest.raises(InputError, match="views to pack: expected different numbers from 0 to 3"):
            pack(dataset, tmp_path / "none", views=views)
    assert not (tmp_path / "none").exists()


def test_jpeg_is_the_rgb_as_opencv_compresses_it(dataset, tmp_path):
    out = tmp_path / "out"
    assert dispatch(["pack", str(dataset), "--out", str(out), "--jpeg", "80"]) == 0
    with tarfile.open(out / "shard-000000.tar") as archive:
        for view in range(COUNT):
            data = archive.extractfile(f"000000_{view:06d}.rgb.jpg").read()
            image = cv2.imread(str(dataset / f"train_synt/000000/rgb/{view:06d}.png"))
            assert data == cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
    assert verify_pack(out, stream=io.StringIO()) == []
    with pytest.raises(RunError, match=r"jpeg_quality was 80, is None; opencv was .*, is None"):
        pack(dataset, out, views_per_shard=1000)


@given(mask=masks, data=st.data())
def test_masks_come_back_and_damaged_ones_are_a_sentence(mask, data):
    text = mask_json(mask)
    entry = json.loads(text)["0"]
    assert (tuple(entry["counts"]), tuple(entry["size"])) == (run_lengths(mask), mask.shape)
    np.testing.assert_array_equal(mask_columns(text, mask.shape, "m").T, mask)
    with pytest.raises(InputError, match="m: expected"):
        mask_columns(text[: data.draw(st.integers(0, len(text) - 1))], mask.shape, "m")


# --- what is refused ------------------------------------------------------------------------------------------------


def test_an_incomplete_dataset_says_which_views_and_how_to_render_them(copied, tmp_path):
    for view in (1, 2):
        (copied / f"train_synt/000000/frame/{view:06d}.json").unlink()
    with pytest.raises(
        InputError,
        match="expected 4 views, found 2: views 1-2 are missing; run the command that rendered it again",
    ):
        pack(copied, tmp_path / "out")
    shutil.rmtree(copied / "train_synt")
    with pytest.raises(InputError, match="views 0-3 are missing"):
        pack(copied, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["dataset.json", "models/obj_000001.ply"])
def test_a_damaged_dataset_is_refused(name, copied, tmp_path):
    for harm in (lambda path: path.write_bytes(path.read_bytes()[:-9] + b"x" * 9), lambda path: path.unlink()):
        harm(copied / name)
        with pytest.raises(InputError, match=f"{Path(name).name}|no checksums.json|JSON"):
            pack(copied, tmp_path / "out")
        assert not (tmp_path / "out").exists()


def other_run(record: bytes) -> bytes:
    return re.sub(rb'"identity":"[0-9a-f]{64}"', b'"identity":"' + b"ab" * 32 + b'"', record)


@pytest.mark.parametrize("kind", ["rgb", "depth_mm", "frame", "of another run"])
def test_a_changed_view_is_refused_and_finished_shards_are_kept(kind, copied, packed, tmp_path):
    (path,) = (copied / "train_synt" / "000000" / kind.replace("of another run", "frame")).glob("000003*")
    sound = path.read_bytes()
    path.write_bytes(other_run(sound) if kind == "of another run" else sound[:30] + b"!" + sound[31:])
    assert path.read_bytes() != sound
    with pytest.raises(RunError, match=f"{path}: expected .*(; |, or )remove "):
        pack(copied, tmp_path / "out", workers=1)
    assert {*tree(tmp_path / "out")} == {"pack.json", "shard-000000.tar"}
    path.write_bytes(sound)
    assert pack(copied, tmp_path / "out") == tree(packed)


@pytest.mark.parametrize("place", ["packed", ".."])
def test_a_pack_within_the_dataset_or_around_it_is_refused(place, copied):
    before = tree(copied)
    with pytest.raises(InputError, match="expected a folder for the pack beside that of the dataset"):
        pack(copied, copied / place)
    assert tree(copied) == before


def test_other_files_and_packs_are_refused(dataset, copied, copied_pack, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    (other / "thesis.tex").write_text("years of work")
    with pytest.raises(RunError, match=r"found other files \(such as thesis\.tex\)"):
        pack(dataset, other)
    with pytest.raises(RunError, match="views_per_shard was 3, is 2"):
        pack(dataset, copied_pack, views_per_shard=2)
    # notes beside the shards stay
    (copied_pack / "LICENSE").write_text("mine")
    assert pack(dataset, copied_pack)["LICENSE"] == b"mine"
    with pytest.raises(RunError, match="expected a new or empty folder or a pack to resume"):
        pack(dataset, copied)
    # the pack of another dataset
    manifest = json.loads((copied_pack / "pack.json").read_text())
    (copied_pack / "pack.json").write_text(json.dumps(manifest | {"identity": "ab" * 32}))
    before = tree(copied_pack)
    with pytest.raises(RunError, match="identity was abab"):
        pack(dataset, copied_pack)
    assert tree(copied_pack) == before
