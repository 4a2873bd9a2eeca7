"""Runs that are killed, stopped or lose their power at any moment: the same command again makes the same files.

The moments are placed by what a run does, not by a clock: before the n-th file that it creates, renames or removes,
be it in a view, a table, the video or the description, in the parent or in a worker.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.tree import tree
from tests.waiting import wait_until

pytestmark = [
    pytest.mark.render,
    pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX"),
]

ARGUMENTS = ("--count", "6", "--seed", "3", "--float-depth", "--video", "--video-frames", "3", "--workers", "2")
SIGNALS = ("SIGKILL", "SIGTERM", "SIGINT")
NEWEST = 6
"""Files that a loss of power may harm, although they were flushed: what disks do that claim too much."""


@pytest.fixture(scope="module")
def case(tmp_path_factory, write_tiny_case) -> Path:
    return write_tiny_case(tmp_path_factory.mktemp("case"))


@pytest.fixture(scope="module")
def render(case) -> Callable[..., subprocess.CompletedProcess]:
    """Renders into a folder, with a signal at a change of the file system."""
    program = Path(__file__).with_name("interrupted_command.py")

    def run(out: Path, *more: str, signal_name: str = "none", who: str = "parent", place: int = 0):
        command = [
            sys.executable,
            program,
            signal_name,
            who,
            str(place),
            "render",
            case,
            "--out",
            out,
            *ARGUMENTS,
            *more,
        ]
        return subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, start_new_session=True)

    return run


@pytest.fixture(scope="module")
def undisturbed(render, tmp_path_factory) -> tuple[dict[str, bytes], int]:
    """The files of a run that nothing disturbs, and the number of changes that its parent process makes."""
    out = tmp_path_factory.mktemp("undisturbed") / "out"
    ended = render(out, "--workers", "1")
    assert ended.returncode == 0, ended.stderr
    files = tree(out)
    assert {"checksums.json", "video/trajectory.mp4"} <= files.keys()
    return files, int(ended.stderr)


def lose_power(out: Path, rng: np.random.Generator) -> bool:
    """Cut off, empty or zero some of the newest files; whether one of them has kept its size."""
    # whoever loses the description removes it
    paths = (path for path in out.rglob("*") if path.is_file() and path.name != "dataset.json")
    files = sorted(paths, key=lambda path: path.stat().st_mtime_ns)
    kept_size = False
    for path in files[-NEWEST:]:
        size = path.stat().st_size
        harm = rng.integers(0, 4)
        if harm == 0:
            os.truncate(path, int(rng.integers(0, size + 1)))
        elif harm == 1:
            os.truncate(path, 0)
        elif harm == 2:
            path.write_bytes(bytes(size))
            kept_size = True
    return kept_size


def wait_for_the_end_of(out: Path) -> None:
    """Wait until no process works in a folder: workers of a killed parent notice its end by themselves."""
    wait_until(lambda: not any(str(out) in _command(process) for process in Path("/proc").glob("[0-9]*")))


def _command(process: Path) -> str:
    try:
        return (process / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
    except OSError:
        return ""


def test_the_same_command_again_makes_the_same_files(render, undisturbed, tmp_path, long_form):
    expected, changes = undisturbed
    rng = np.random.default_rng(11)
    count = 150 if long_form else 5
    stopped = 0
    for trial in range(count):
        # evenly over the run, from its first file to its last; a worker makes a part of them
        who = "worker" if trial % 4 == 3 else "parent"
        share = 0.35 if who == "worker" else 1.0
        place = int((trial + rng.random()) / count * changes * share)
        name = SIGNALS[trial % len(SIGNALS)]
        told = f"trial {trial}: {name} for the {who} at change {place} of {changes}"
        out = tmp_path / str(trial)
        ended = render(out, signal_name=name, who=who, place=place)
        stopped += ended.returncode != 0 or "was killed" in ended.stderr
        assert "Traceback" not in ended.stderr, f"{told}\n{ended.stderr}"
        wait_for_the_end_of(out)
        more = []
        if trial % 2 and out.exists():
            told += ", and a loss of power"
            # a file of the right size is only found out by its hash
            more = ["--verify"] if lose_power(out, rng) else []
        ended = render(out, "--workers", "1", *more)
        assert ended.returncode == 0, f"{told}\n{ended.stderr}"
        found = tree(out)
        assert sorted(found) == sorted(expected), told
        assert [name for name in expected if found[name] != expected[name]] == [], told
    assert stopped > count / 2
