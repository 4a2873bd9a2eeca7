"""``scripts/slurm_array.sh`` on a real Slurm: the same bytes as on one machine, whatever is killed meanwhile."""

import os
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from tests.cluster.slurm.slurm_on_this_machine import NODES
from tests.cluster.watching import records
from tests.tree import different_files
from tests.waiting import wait_until

SCRIPT = Path(__file__).resolve().parents[3] / "scripts" / "slurm_array.sh"
SHARDS, VIEWS = 4, 800
RENDER = ("--count", VIEWS)
JOB = ("--cpus-per-task", 1, "--mem", 500)

pytestmark = pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")


@pytest.fixture(scope="module")
def case(tmp_path_factory, write_tiny_case) -> Path:
    return write_tiny_case(tmp_path_factory.mktemp("case"))


@pytest.fixture
def submit(run_command, submitting):
    """Calls the script with sbatch's options, then those of the render command."""

    def call(case: Path, out: Path, *render: object, shards: object = SHARDS, options: tuple = JOB, **environment: str):
        command = [SCRIPT, "--shards", shards, *options, "--", case, "--out", out, *render]
        return run_command([str(word) for word in command], **submitting | environment)

    return call


def test_same_bytes_whatever_is_killed(slurm, submit, case, tmp_path, render_command, run_command):
    alone, out, rng = tmp_path / "alone", tmp_path / "out", np.random.default_rng(6)
    assert run_command(render_command(case, "--out", alone, *RENDER)).returncode == 0

    first = submit(case, out, *RENDER, "--seed", 0, options=(*JOB, "--at-once", 2))
    assert first.returncode == 0, first.stderr
    again = submit(case, out, *RENDER, "--seed", 0)
    assert "nothing to submit: 0 of 4 shards are finished" in again.stdout

    def rendering(element: str) -> dict[str, tuple[str, str]]:
        return {
            job: (name, node)
            for job, (name, node) in slurm.running().items()
            if name.endswith(element) and any(is_render(line) for line in slurm.processes(SLURM_JOB_ID=job).values())
        }

    def wait_for_work(element: str = "", *, at_once: bool = False) -> tuple[str, str, str]:
        """A job that renders, its name and its node: of several, any, and at any moment of its work."""
        while True:
            wait_until(lambda: rendering(element), otherwise=slurm.told)
            for job, place in rendering(element).items():
                time.sleep(0 if at_once else rng.uniform(0, 0.8))
                seen.append(records(out))
                if job in rendering(element):
                    return job, *place

    seen: list[dict[str, tuple[int, int]]] = []
    # the job itself, before its last view: Slurm calls it failed, and the tables can never be written
    job, _, _ = wait_for_work(at_once=True)
    assert slurm.kill(job) >= 2
    # as at a preemption
    _, name, _ = wait_for_work()
    slurm.call("scontrol", "requeue", name)
    # what renders: the shard goes back into the queue, and no other, though its number is also the array's
    job, _, _ = wait_for_work(f"_{SHARDS - 1}")
    slurm.kill(job, only="--shard ")
    time.sleep(1)
    _, _, node = wait_for_work()
    assert node in NODES
    slurm.fail_node(node)
    slurm.wait_until_idle()

    assert not (out / "checksums.json").exists(), slurm.told()
    lost = {f"shard-{number}.finished" for number in range(SHARDS)} - set(os.listdir(f"{out}.slurm"))
    assert len(lost) == 1, lost
    (number,) = (name.removeprefix("shard-").removesuffix(".finished") for name in lost)
    seen.append(records(out))
    second = submit(case, out, *RENDER, "--seed", 0)
    assert f"shards {number} of {SHARDS}" in second.stdout, second.stdout + second.stderr
    assert "finished before: 3 of 4 shards" in second.stdout
    slurm.wait_until_idle()

    logs = {path.name: path.read_text() for path in Path(f"{out}.slurm").glob("*.log")}
    assert different_files(out, alone) == [], logs
    assert len(records(out)) == VIEWS
    last = records(out)
    twice = {name for earlier in seen for name, state in earlier.items() if last[name] != state}
    assert any(seen), "nothing was killed during its work"
    assert not twice, "finished views were rendered again"
    assert sum(text.count("back into the queue") for text in logs.values()) == 1
    assert max(int(start) for text in logs.values() for start in _starts(text)) >= 2
    assert "nothing to submit: the dataset is finished" in submit(case, out, *RENDER, "--seed", 0).stdout


def is_render(line: str) -> bool:
    return "--shard " in line and "--task-of" not in line


def _starts(text: str) -> list[str]:
    return [line.rpartition("start ")[2] for line in text.splitlines() if line.startswith("--- ")]


def test_a_node_without_the_folder_refuses(slurm, submit, case):
    if slurm.unshared is None:
        pytest.skip("nodes have no view of their own of the file system here (unshare --mount)")
    here = slurm.root
    ended = submit(case, slurm.unshared / "out", *RENDER, shards=1, options=("-p", "blind", "--chdir", here, *JOB))
    assert ended.returncode == 0, ended.stderr
    slurm.wait_until_idle()
    (log,) = here.glob("slurm-*.out")
    assert log.read_text() == (
        f"error: node n3 does not see {slurm.unshared}/out as the submitting machine does; choose a folder that all "
        "nodes share (--out)\n"
    )
    assert not (slurm.unshared / "out").exists()


def test_a_shard_that_cannot_start_says_why(slurm, submit, case, tmp_path):
    out = tmp_path / "out"
    wrong = ("--count", 8, "--cone-deg", 200)
    assert submit(case, out, *wrong, shards=2).returncode == 0
    slurm.wait_until_idle()
    ended = submit(case, out, *wrong, shards=2)
    assert "shard 0 failed before: error: command line: cone_deg: expected 0 to 180, found 200\n" in ended.stdout
    assert "shards 0-1 of 2" in ended.stdout
