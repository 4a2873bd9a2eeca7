"""A pack that is killed at any moment: shards are whole or not there, and the same command ends it, byte for byte."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.tree import tree

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
PROGRAM = Path(__file__).parents[1] / "outside" / "interrupted_command.py"


def run(dataset: Path, out: Path, place: int | None = None) -> subprocess.CompletedProcess:
    told = ("none", "parent", 0) if place is None else ("SIGKILL", "parent", place)
    command = [sys.executable, PROGRAM, *told, "pack", dataset, "--out", out, "--views-per-shard", 2, "--workers", 1]
    return subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def whole(dataset, tmp_path_factory) -> tuple[dict[str, bytes], int]:
    """The files of a pack that nothing disturbs, and the number of changes of the file system that make them."""
    out = tmp_path_factory.mktemp("whole") / "out"
    ended = run(dataset, out)
    assert ended.returncode == 0, ended.stderr
    return tree(out), int(ended.stderr)


def test_a_killed_pack_is_finished_by_the_same_command(dataset, whole, tmp_path, long_form):
    expected, changes = whole
    assert changes > 20
    for place in range(changes) if long_form else range(1, changes, -(-changes // 3)):
        out = tmp_path / str(place)
        assert run(dataset, out, place).returncode == -signal.SIGKILL
        for shard in out.glob("shard-*.tar"):
            data = shard.read_bytes()
            assert data == expected[shard.name]
        ended = run(dataset, out)
        assert ended.returncode == 0, f"change {place} of {changes}: {ended.stderr}"
        assert tree(out) == expected, f"change {place} of {changes}"
