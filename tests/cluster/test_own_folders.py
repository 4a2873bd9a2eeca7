"""Workers that share nothing with the run's machine: the case is sent there, or lies elsewhere; views are gathered."""

import os
import re
import shutil
import signal
import subprocess
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason='needs Dask: pip install "oneframe[cluster]"')

from pipeline.cluster.worker_places import end_run, own_folder
from pipeline.dataset.folder import RunFolder, Shard
from pipeline.dataset.identity import description_bytes, identity_of
from pipeline.errors import RunError
from tests.cluster.test_cluster_render import records, render_processes, wait_until
from tests.different_files import different_files

on_linux = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux's /proc")

VIEWS = 60


@pytest.fixture(scope="module")
def case(tmp_path_factory, write_tiny_case) -> Path:
    return write_tiny_case(tmp_path_factory.mktemp("case"))


@pytest.fixture(scope="module")
def reference(case, tmp_path_factory, render_command, run_command) -> Path:
    out = tmp_path_factory.mktemp("one machine") / "dataset"
    ended = run_command(render_command(case, "--out", out, "--count", VIEWS))
    assert (ended.returncode, ended.stderr) == (0, "")
    return out


@on_linux
@pytest.mark.render
def test_gathered_views_are_those_of_one_machine_though_a_worker_dies(
    case, reference, tmp_path, render_command, monkeypatch
):
    # paths of this machine are of no use to the workers
    moved = tmp_path / "moved/case"
    shutil.copytree(case.parent, moved)
    out = tmp_path / "out"
    flags = ("--count", VIEWS, "--cluster", "local:2", "--gather", "--send-case")
    process = subprocess.Popen(
        render_command(moved / case.name, "--out", out, *flags),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        wait_until(lambda: len(records(out)) >= 3 and render_processes(process.pid), process)
        commands = [Path(f"/proc/{pid}/cmdline").read_bytes() for pid in render_processes(process.pid)]
        assert not [text for text in commands if os.fsencode(moved) in text or os.fsencode(out) in text]
        os.kill(next(iter(render_processes(process.pid).values())), signal.SIGKILL)
        output, errors = process.communicate(timeout=120)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert (process.returncode, errors) == (0, "")
    # the other one may end the run before the lost one is missed, or is back
    assert re.search("the case was sent to [23] workers", output), output
    assert different_files(out, reference) == []


@pytest.mark.render
def test_views_stay_on_workers_and_are_found_there(case, reference, tmp_path, render_command, run_command):
    out, own, there = tmp_path / "out", tmp_path / "own", tmp_path / "there"
    shutil.copytree(case.parent, there)
    plain = render_command(case, "--out", out, "--count", VIEWS)
    flags = ("--cluster", "local:2", "--out-on-workers", own, "--case-on-workers", there / case.name)
    ended = run_command([*plain, *map(str, flags)])
    assert (ended.returncode, ended.stderr) == (0, "")
    assert f"{VIEWS} views rendered by 2 workers" in ended.stdout
    assert f"the views are in {own} of " in ended.stdout
    assert not (out / "checksums.json").exists()
    gathered = tmp_path / "gathered"
    shutil.copytree(out, gathered)
    # the documented copy, and then the tables
    shutil.copytree(own, out, dirs_exist_ok=True)
    assert run_command(plain).returncode == 0
    assert different_files(out, reference) == []
    command = render_command(case, "--out", gathered, "--count", VIEWS, *flags, "--gather")
    assert f"0 orders; {VIEWS} found finished on a disk; 1 MB gathered" in run_command(command).stdout
    assert different_files(gathered, reference) == []


class Machine:
    """A worker without Dask."""

    def __init__(self, folder: Path) -> None:
        self.local_folder, self.opened = folder, {}

    def open_folder(self, name, root):
        self.opened[name] = root

    def ask_for_case(self, folder):
        raise NotImplementedError

    def beat(self, state, done):
        raise NotImplementedError


def test_a_folder_with_something_else_is_refused(tmp_path):
    used = tmp_path / "used"
    used.mkdir()
    (used / "thesis.txt").write_text("mine")
    description = {"format": "oneframe dataset 2", "count": 3}
    with pytest.raises(RunError, match=r"found other files; choose another folder \(--out-on-workers\)"):
        own_folder("run 1", str(used), "ab" * 32, description, Machine(tmp_path))
    assert [path.name for path in used.iterdir()] == ["thesis.txt"]


def test_runs_of_one_dataset_share_a_folder_and_others_are_kept_out(tmp_path):
    description = {"format": "oneframe dataset 2", "count": 3}
    machine, identity = Machine(tmp_path), identity_of(description)
    folders = {own_folder(run, "", identity, description, machine) for run in ("run 1", "run 2", "run 1")}
    (folder,) = folders
    assert machine.opened == {"run 1": folder, "run 2": folder}
    assert (folder / "dataset.json").read_bytes() == description_bytes(description)
    end_run("run 1")
    for _ in range(2):
        with pytest.raises(RunError, match="another process"):
            RunFolder(folder, description, Shard())
        end_run("run 1")
    end_run("run 2")
    with RunFolder(folder, description, Shard()):
        pass
