"""Every kind of damage to a pack is found, by hashes or beside the dataset; a sound one has no finding."""

import io
import json
import os
import re
import tarfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from oneframe.dataset.checksums import sum_of_file
from oneframe.errors import InputError
from oneframe.packing.pack import PackOptions, pack_dataset
from oneframe.packing.verify import verify_pack

SHARD = "shard-000000.tar"


def findings(pack: Path, root: Path | None = None) -> list[str]:
    return verify_pack(pack, root, stream=io.StringIO()).findings.shown()


def members(path: Path) -> dict[str, bytes]:
    with tarfile.open(path) as archive:
        return {entry.name: archive.extractfile(entry).read() for entry in archive}


def write_members(path: Path, content: dict[str, bytes]) -> None:
    with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as archive:
        for name, data in content.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            archive.addfile(entry, io.BytesIO(data))


def sealed(pack: Path) -> None:
    """Write sizes and hashes of all files as they are now into the manifest."""
    path = pack / "pack.json"
    manifest = json.loads(path.read_text())
    for name, entry in {**manifest["shards"], **manifest["files"]}.items():
        found = sum_of_file(pack / name)
        entry |= {"sha256": found.sha256, "bytes": found.bytes}
    path.write_text(json.dumps(manifest))


def test_a_sound_pack_is_whole(dataset, packed):
    report = verify_pack(packed, dataset, stream=io.StringIO())
    assert report.summary() == (
        "pack of 4 views in 2 shards: whole (all hashes, and each shard as the dataset makes it)"
    )


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_flipped_bit_anywhere_is_found(data, copied_pack):
    path = copied_pack / data.draw(st.sampled_from(sorted(p.name for p in copied_pack.iterdir() if p.is_file())))
    sound = path.read_bytes()
    place, bit = data.draw(st.integers(0, len(sound) - 1)), data.draw(st.integers(0, 7))
    path.write_bytes(sound[:place] + bytes([sound[place] ^ 1 << bit]) + sound[place + 1 :])
    try:
        if json.loads(sound) == json.loads(path.read_bytes()) and path.name == "pack.json":
            return  # blanks between its values
    except ValueError:
        pass
    try:
        assert findings(copied_pack), (path.name, place, bit)
    except InputError as error:
        # of the manifest, nothing can be verified
        if "pack.json" not in str(error):
            raise
    finally:
        path.write_bytes(sound)


def swapped(pack: Path) -> None:
    first, second = pack / SHARD, pack / "shard-000001.tar"
    first.rename(pack / "x")
    second.rename(first)
    (pack / "x").rename(second)


DAMAGE: dict[str, tuple[Callable[[Path], object], str]] = {
    "truncated": (lambda pack: os.truncate(pack / SHARD, 20_000), f"{SHARD} has 20000 bytes instead of"),
    "swapped": (swapped, f"{SHARD} has .* bytes instead of"),
    "a shard less": (lambda pack: (pack / SHARD).unlink(), f"{SHARD} is missing"),
    "a shard more": (lambda pack: (pack / "shard-000002.tar").write_bytes(b"x"), "this pack has no such shard"),
    "a file more": (lambda pack: (pack / "models" / "x.txt").write_text("x"), "no pack has such a file"),
    "a table less": (lambda pack: (pack / "key_to_shard.json").unlink(), "key_to_shard.json is missing"),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_damage_is_found(kind, dataset, copied_pack):
    harm, message = DAMAGE[kind]
    harm(copied_pack)
    for root in (None, dataset):
        found = findings(copied_pack, root)
        assert any(re.search(message, line) for line in found), found


def with_another(member: str) -> Callable[[dict[str, bytes]], dict[str, bytes]]:
    return lambda content: content | {f"000000_000001.{member}": content[f"000000_000002.{member}"] + b" "}


CHANGES: dict[str, Callable[[dict[str, bytes]], dict[str, bytes]]] = {
    "a member less": lambda content: {name: content[name] for name in content if "000001.rgb" not in name},
    "a member more": lambda content: content | {"000000_000009.rgb.png": b"x"},
    "another order": lambda content: dict(reversed(content.items())),
    "an image": with_another("rgb.png"),
    "a number": with_another("gt.json"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_shard_unlike_the_dataset_is_found_although_its_hash_is_right(change, dataset, copied_pack):
    write_members(copied_pack / SHARD, CHANGES[change](members(copied_pack / SHARD)))
    sealed(copied_pack)
    assert findings(copied_pack) == []
    assert findings(copied_pack, dataset) == [f"{SHARD} does not hold what the dataset does"]


def test_what_is_no_pack_is_a_sentence(dataset, copied_pack, tmp_path):
    with pytest.raises(InputError, match="expected a complete pack, found no pack"):
        verify_pack(dataset)
    (copied_pack / "pack.json").unlink()
    (copied_pack / ".work").mkdir()
    with pytest.raises(InputError, match="an unfinished one; run the command that packs it again"):
        verify_pack(copied_pack)


def test_notes_beside_the_shards_are_no_damage(dataset, copied_pack):
    for name in ("README.md", "LICENSE", ".gitattributes"):
        (copied_pack / name).write_text("mine")
    assert findings(copied_pack) == []
    pack_dataset(dataset, copied_pack, PackOptions(3), stream=io.StringIO())
    assert (copied_pack / "LICENSE").read_text() == "mine"
