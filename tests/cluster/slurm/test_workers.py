"""``--cluster slurm`` on a real Slurm: Dask's workers in its jobs, one of which is cancelled during the run."""

import os
import re
import stat
import subprocess
from collections.abc import Iterable
from pathlib import Path

import pytest

from oneframe.cluster.slurm_settings import SlurmSettings, checked_slurm_settings, read_slurm_settings
from oneframe.errors import InputError
from tests.cluster.slurm.slurm_on_this_machine import Slurm
from tests.cluster.strangers import check_closed, listeners
from tests.cluster.written_records import records
from tests.different_files import different_files
from tests.waiting import wait_until

VIEWS = 300


@pytest.mark.render
def test_a_cancelled_job_changes_no_byte(slurm, submitting, tmp_path, write_tiny_case, render_command, run_command):
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")
    case, alone, out = write_tiny_case(tmp_path / "case"), tmp_path / "alone", tmp_path / "out"
    assert run_command(render_command(case, "--out", alone, "--count", VIEWS)).returncode == 0
    with case.open("a") as file:
        file.write('[cluster]\njobs = 2\ncores = 1\nmemory = "1GB"\nwalltime = "00:10:00"\nqueue = "main"\n')
    run = subprocess.Popen(
        render_command(case, "--out", out, "--count", VIEWS, "--cluster", "slurm"),
        env=os.environ | submitting,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_until(lambda: len(records(out)) >= 20, run, slurm.told)
    kept = records(out)
    jobs = sorted(slurm.running())
    assert 1 <= len(jobs) <= 2
    keys = check_doors(run.pid, slurm, jobs)
    slurm.call("scancel", jobs[0])
    output, errors = run.communicate()
    assert run.returncode == 0, errors + output + slurm.told()
    assert different_files(out, alone) == []
    last = records(out)
    assert {name for name, state in kept.items() if last[name] != state} == set(), "finished views were rendered again"
    slurm.wait_until_idle()
    assert not keys.exists()


def check_doors(run: int, slurm: Slurm, jobs: Iterable[str]) -> Path:
    """Check that nobody but the run gets into its scheduler and its jobs; the folder of what lets them in."""
    inside = {number: line for job in jobs for number, line in slurm.processes(SLURM_JOB_ID=job).items()}
    addresses = listeners([run, *inside])
    assert len(addresses) >= 3
    check_closed(addresses)
    (key,) = {Path(path) for line in inside.values() for path in re.findall(r"--tls-key (\S+)", line)}
    assert [stat.S_IMODE(path.stat().st_mode) for path in (key, key.parent)] == [0o600, 0o700]
    return key.parent


@pytest.mark.render
def test_jobs_end_with_a_killed_run(slurm, submitting, tmp_path, write_tiny_case, render_command):
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")
    case, settings = write_tiny_case(tmp_path / "case"), tmp_path / "cluster.toml"
    settings.write_text('jobs = 2\nmemory = "1GB"\n')
    command = render_command(case, "--out", tmp_path / "out", "--cluster", "slurm", "--cluster-settings", settings)
    run = subprocess.Popen(command, env=os.environ | submitting, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_until(lambda: slurm.call("squeue", "-h").strip(), run)
    assert run.poll() is None
    run.kill()
    run.wait()
    slurm.wait_until_idle()


def test_what_slurm_refuses_is_told(slurm, submitting, tmp_path, write_tiny_case, render_command, run_command):
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")
    case, settings = write_tiny_case(tmp_path / "case"), tmp_path / "cluster.toml"
    settings.write_text('queue = "nowhere"\n')
    command = render_command(case, "--out", tmp_path / "out", "--cluster", "slurm", "--cluster-settings", settings)
    ended = run_command(command, **submitting)
    assert ended.returncode == 3
    assert "error: --cluster slurm: no workers can be started (Slurm refuses a job of these settings: " in ended.stderr
    assert "partition" in ended.stderr
    assert slurm.call("squeue", "-h") == ""


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"wall_time": "1:00:00"}, "unknown key 'wall_time'; did you mean 'walltime'?"),
        ({"jobs": 0}, "jobs: expected a whole number from 1 to 10000, found 0"),
        ({"cores": True}, "cores: expected a whole number"),
        ({"memory": 8}, "memory: expected a size"),
        ({"memory": "8 cows"}, "memory: expected a size"),
        ({"walltime": "soon"}, "walltime: expected a time"),
        ({"queue": "two words"}, "queue: expected a name"),
        ({"options": "--qos=long"}, "options: expected a list"),
    ],
)
def test_settings_are_checked(table, message):
    with pytest.raises(InputError, match=r"^case\.toml: \[cluster\]: ") as caught:
        checked_slurm_settings(table, "case.toml: [cluster]")
    assert message in str(caught.value)


def test_settings_in_a_file_of_their_own(tmp_path):
    path = tmp_path / "cluster.toml"
    for text in ('queue = "cpu"\njobs = 3\n', '[cluster]\nqueue = "cpu"\njobs = 3\n'):
        path.write_text(text)
        assert read_slurm_settings(path) == SlurmSettings(queue="cpu", jobs=3)
    with pytest.raises(InputError, match="does not exist"):
        read_slurm_settings(tmp_path / "missing.toml")
