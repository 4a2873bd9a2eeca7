"""Every kind of damage to a pack is found, and mended by the command that packed it; a sound one has no finding."""

import io
import json
import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from oneframe.commands.__main__ import dispatch
from oneframe.errors import InputError
from oneframe.packing.pack import PackOptions, pack_dataset, verify_pack
from tests.tree import tree

SHARD = "shard-000000.tar"


def findings(pack: Path) -> list[str]:
    return verify_pack(pack, stream=io.StringIO())


def test_a_sound_pack_is_whole_and_one_with_a_shard_more_is_not(packed, copied_pack, capfd):
    assert findings(packed) == []
    assert dispatch(["pack", "--out", str(packed), "--verify"]) == 0
    assert "whole (all hashes)" in capfd.readouterr().out
    (copied_pack / "shard-000009.tar").write_bytes((copied_pack / SHARD).read_bytes())
    assert findings(copied_pack) == ["shard-000009.tar is no shard of this pack: remove it"]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_flipped_bit_anywhere_is_found(data, copied_pack):
    names = {path.relative_to(copied_pack) for path in copied_pack.rglob("*") if path.is_file()}
    path = copied_pack / data.draw(st.sampled_from(sorted(names - {Path("pack.json")})))
    sound = path.read_bytes()
    place, bit = data.draw(st.integers(0, len(sound) - 1)), data.draw(st.integers(0, 7))
    path.write_bytes(sound[:place] + bytes([sound[place] ^ 1 << bit]) + sound[place + 1 :])
    try:
        assert findings(copied_pack), (path.name, place, bit)
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
    "a table less": (lambda pack: (pack / "key_to_shard.json").unlink(), "key_to_shard.json is missing"),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_damage_is_found_and_mended(kind, dataset, packed, copied_pack, capfd):
    harm, message = DAMAGE[kind]
    harm(copied_pack)
    assert any(re.search(message, line) for line in findings(copied_pack))
    assert dispatch(["pack", "--out", str(copied_pack), "--verify"]) == 1
    assert "NOT whole" in capfd.readouterr().out
    pack_dataset(dataset, copied_pack, PackOptions(3), stream=io.StringIO())
    assert tree(copied_pack) == tree(packed)


def test_what_is_no_pack_is_a_sentence(dataset, copied_pack):
    with pytest.raises(InputError, match=r"expected a complete pack, found no pack\.json"):
        verify_pack(dataset)
    path = copied_pack / "pack.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"files": {}}))
    with pytest.raises(InputError, match="an unfinished one; run the command that packs it again"):
        verify_pack(copied_pack)
