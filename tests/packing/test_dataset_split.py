"""``--split`` packs the parts of a rendered dataset: disjoint, and each with its own targets."""

import json
from pathlib import Path

import pytest

from oneframe.commands.__main__ import dispatch
from oneframe.packing.manifest import read_manifest
from oneframe.packing.pack import verify_pack

VIEWS = 60


@pytest.fixture(scope="module")
def rendered(tmp_path_factory, write_tiny_case, run_oneframe) -> Path:
    folder = tmp_path_factory.mktemp("split")
    out = folder / "dataset"
    case = write_tiny_case(folder / "case")
    ended = run_oneframe("render", case, "--out", out, "--count", VIEWS, "--cone-deg", 40, "--workers", 1)
    assert ended.returncode == 0, ended.stderr
    return out


@pytest.mark.render
def test_parts_of_a_dataset(rendered, tmp_path, capfd):
    def packed(*options: object) -> tuple[set[int], str]:
        out = tmp_path / "-".join(map(str, options))
        assert dispatch([str(word) for word in ("pack", rendered, "--out", out, "--split", *options)]) == 0
        assert verify_pack(out) == []
        views = set(read_manifest(out).plan.views)
        targets = json.loads((out / "test_targets_bop19.json").read_text())
        assert {entry["im_id"] for entry in targets} <= views
        about = read_manifest(out).plan.about
        assert about.startswith(f"{options[0]}, of ")
        return views, about

    (train, info), (val, _), (test, _) = (packed(part) for part in ("train", "val", "test"))
    assert len(test) == VIEWS // 10
    assert len(train) + len(val) + len(test) == len(train | val | test)
    none = VIEWS - len(train | val | test)
    sentence = f"{len(train)} train, {len(val)} val, {len(test)} test; {none} in none, nearer than 0.64 px"
    assert sentence in info
    assert f"split: {sentence}" in capfd.readouterr().out
    wider, _ = packed("train", "--split-gap-px", 4)
    assert wider < train
