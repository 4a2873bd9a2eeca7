"""Commands that write many files, wherever one is killed: a case names its own files, and a shard of a pack is whole.

Instead of killing a run at each of its changes of the file system, one run is watched, and its folder copied before
each change: these are all the states that a kill could leave.
"""

import hashlib
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from oneframe.case.case_file import read_case
from oneframe.case.surface_folder import read_surface_folder
from oneframe.commands.__main__ import dispatch
from oneframe.errors import InputError
from oneframe.images.png import encode_png
from tests.alignment.test_refinement import hills
from tests.packing.conftest import dataset  # noqa: F401
from tests.registration.test_registration import SOURCE, photograph, seen_from, write_case
from tests.tree import tree
from tests.volume.ball_ct import write_ball_ct

pytestmark = pytest.mark.render

CHANGES = ("os.rename", "os.remove", "os.mkdir", "os.rmdir")
_watching: list[Callable[[], None]] = []


def _hook(event: str, arguments: tuple) -> None:
    if _watching and (event in CHANGES or (event == "open" and "x" in str(arguments[1]))):
        before_change = _watching.pop()
        before_change()
        _watching.append(before_change)


sys.addaudithook(_hook)


@contextmanager
def copied_before_each_change(folder: Path) -> Iterator[list[Path]]:
    """All states of a folder; each copy lies beside it, so that relative paths to other folders hold."""
    states: list[Path] = []

    def copy() -> None:
        states.append(folder.with_name(f"{folder.name}_{len(states)}"))
        shutil.copytree(folder, states[-1]) if folder.exists() else states[-1].mkdir()

    _watching.append(copy)
    try:
        yield states
    finally:
        _watching.clear()
    copy()


def content(case: Path) -> tuple[str, ...]:
    """What a case and its files hold."""
    files = read_case(case, posed=False).input_files().values()
    return tuple(hashlib.sha256(path.read_bytes()).hexdigest() for path in files)


def check_states(out: Path, run: Callable[[], None], read: Callable[[Path], tuple[str, ...]]) -> list[Path]:
    """Run over what is there; the folder always holds what it held before or what it holds in the end."""
    before = read(out)
    with copied_before_each_change(out) as states:
        run()
    after = read(out)
    assert before != after
    found = [read(state) for state in states]
    assert set(found) == {before, after}
    assert sorted(found, key=[before, after].index) == found
    return states


@pytest.fixture
def frames(tmp_path) -> Path:
    mesh = hills(1)
    write_case(tmp_path, mesh, SOURCE)
    for name, tilts in (("one", (4, 25)), ("another", (-4, -25))):
        (tmp_path / name).mkdir()
        for number, tilt in enumerate(tilts):
            codes = np.rint(255 * photograph(mesh, seen_from(tilt, 5))).astype(np.uint8)
            (tmp_path / name / f"{number}.png").write_bytes(encode_png(codes))
    return tmp_path


def test_register(frames):
    out = frames / "out"

    def run(name: str) -> None:
        line = ["register", frames / "case.toml", frames / name, "--out", out, "--colour-frames", "2"]
        assert dispatch([*map(str, line)]) == 0

    run("one")
    states = check_states(out, lambda: run("another"), lambda folder: content(folder / "case.toml"))
    written = set(tree(out))
    assert written >= {"poses.json", "case.toml"}
    for state in states:
        # nothing shows other poses than those beside it
        if (state / "poses.json").read_bytes() == (out / "poses.json").read_bytes():
            page = state / "registration.html"
            assert not page.exists() or page.read_bytes() == (out / page.name).read_bytes()
    # what a killed run has left goes with the next one
    shutil.rmtree(out)
    shutil.copytree(states[-3], out)
    run("another")
    assert set(tree(out)) == written


def test_surface(tmp_path):
    write_ball_ct(tmp_path)
    out = tmp_path / "out"

    def run(level: str) -> None:
        line = ["surface", tmp_path / "ct.nii.gz", "--labels", tmp_path / "labels.nii.gz", "--threshold", level]
        assert dispatch([*map(str, line), "--out", str(out)]) == 0

    def read(folder: Path) -> tuple[str, ...]:
        with suppress(InputError):
            found = read_surface_folder(folder)
            files = [folder / "surface.json", found.mesh, *(each.mesh for each in found.structures)]
            return tuple(hashlib.sha256(path.read_bytes()).hexdigest() for path in files)
        return ()

    run("400")
    before = read(out)
    with copied_before_each_change(out) as states:
        run("700")
    assert {read(state) for state in states} == {before, (), read(out)}


def test_pack(dataset, tmp_path):  # noqa: F811
    """And the same command goes on from there, to the same bytes."""
    out = tmp_path / "out"

    def run(out: Path) -> dict[str, bytes]:
        line = ["pack", dataset, "--out", out, "--views-per-shard", "2", "--workers", "1"]
        assert dispatch([*map(str, line)]) == 0
        return tree(out)

    with copied_before_each_change(out) as states:
        expected = run(out)
    assert len(states) > 12
    for state in states:
        assert tree(state).items() >= {(shard.name, expected[shard.name]) for shard in state.glob("shard-*.tar")}
        assert run(state) == expected
