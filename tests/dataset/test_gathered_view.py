"""A view from another machine is taken over whole, as its record says, or not at all."""

import json
from pathlib import Path

import pytest

from oneframe.dataset.identity import identity_of
from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.run.elsewhere import gather_view
from oneframe.errors import RunError

from .synthetic_dataset import KINDS, description_of, make_dataset

IDENTITY = identity_of(description_of())


@pytest.fixture(scope="module")
def other(tmp_path_factory) -> Path:
    make_dataset(tmp_path_factory.mktemp("other") / "dataset")
    return tmp_path_factory.getbasetemp() / "other0/dataset"


def files_of(root: Path, index: int, change: dict[str, bytes] | None = None) -> dict[str, bytes]:
    names = [ViewPaths(root, index).relative(kind) for kind in (*KINDS, "frame")]
    return {name: (root / name).read_bytes() for name in names} | (change or {})


def test_a_view_is_the_same_afterwards(other, tmp_path):
    for index in range(4):
        gather_view(ViewPaths(tmp_path, index), IDENTITY, KINDS, files_of(other, index))
    files = {path.relative_to(tmp_path) for path in tmp_path.rglob("*") if path.is_file()}
    assert len(files) == 4 * (len(KINDS) + 1)
    assert all((tmp_path / file).read_bytes() == (other / file).read_bytes() for file in files)


@pytest.mark.parametrize("kind", ["rgb", "depth_mm", "frame"])
def test_what_is_not_as_recorded_leaves_no_view(other, tmp_path, kind):
    paths = ViewPaths(tmp_path, 1)
    name = paths.relative(kind)
    data = (other / name).read_bytes()
    for wrong in (data[:-1], data[:40] + b"1" + data[41:], data + b"0", b"{}"):
        with pytest.raises(RunError):
            gather_view(paths, IDENTITY, KINDS, files_of(other, 1, {name: wrong}))
        assert not paths.file("frame").exists()
        assert not [*tmp_path.rglob(".partial*")]


def test_a_view_of_another_dataset_or_place_is_refused(other, tmp_path):
    with pytest.raises(RunError, match="another"):
        gather_view(ViewPaths(tmp_path, 1), "ab" * 32, KINDS, files_of(other, 1))
    record = json.loads((other / ViewPaths(tmp_path, 1).relative("frame")).read_bytes())
    record["files"]["../outside.png"] = record["files"].popitem()[1]
    data = (json.dumps(record, separators=(",", ":")) + "\n").encode()
    harm = {ViewPaths(tmp_path, 1).relative("frame"): data}
    with pytest.raises(RunError, match="another"):
        gather_view(ViewPaths(tmp_path, 1), IDENTITY, KINDS, files_of(other, 1, harm))
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
