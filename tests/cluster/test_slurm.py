"""``scripts/slurm_array.sh``: the bytes of one machine, though a shard is killed and goes back into the queue."""

import os
import shutil
import sys
from pathlib import Path

import pytest

from tests.tree import different_files

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "slurm_array.sh"
RENDER = ("--count", "6", "--engine", "raster")
SBATCH = """#!/bin/bash
# runs a job at once, as often as it asks for: an array's elements from the last to the first
here=$(dirname "$0") array='' output='' elements=('')
while [[ $1 == --* ]]; do
    case $1 in
        --array=0-*) array=7 && elements=($(seq "${1#--array=0-}" -1 0)) ;;
        --output=*) output=${1#--output=} ;;
        --dependency=*) echo "$1" >>"$here/told" ;;
    esac
    shift
done
for number in "${elements[@]}"; do
    [ -z "$array" ] || export SLURM_ARRAY_TASK_ID=$number SLURM_ARRAY_JOB_ID=$array
    for start in 0 1 2; do
        rm -f "$here/requeued"
        SLURM_JOB_ID=8 SLURM_RESTART_COUNT=$start "$@" >>"${output/\\%a/$number}" 2>&1
        [ -e "$here/requeued" ] || break
    done
done
echo "${array:-8};cluster"
"""

pytestmark = [pytest.mark.render, pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")]


@pytest.fixture
def environment(tmp_path):
    """Programs of a Slurm that has one place, and ``oneframe``, whose first shard dies at its first start."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name, text in {
        "sbatch": SBATCH,
        "scontrol": '#!/bin/bash\necho "$*" >>"$(dirname "$0")/told"\ntouch "$(dirname "$0")/requeued"\n',
        "oneframe": '#!/bin/bash\n[[ "$*" != *"--shard 0/3" || $SLURM_RESTART_COUNT != 0 ]] || kill -9 $$\n'
        f'exec "{sys.executable}" -m oneframe.commands "$@"\n',
    }.items():
        (folder / name).write_text(text)
        (folder / name).chmod(0o755)
    return {"PATH": f"{folder}:{os.environ['PATH']}", "BLENDER": ""}


def test_an_array_of_shards_makes_the_dataset_of_one_machine(
    environment, tmp_path, write_tiny_case, run_command, render_command
):
    case, out = write_tiny_case(tmp_path / "case"), tmp_path / "out"
    assert run_command(render_command(case, "--out", tmp_path / "alone", *RENDER)).returncode == 0
    command = [str(SCRIPT), "--shards", "3", "--mem=8G", "--", str(case), "--out", str(out), *RENDER]
    ended = run_command(command, **environment)
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout == f"job 7: 3 shards; job 8: the tables, after all of them; logs in {out}.slurm\n"
    assert (tmp_path / "bin" / "told").read_text().split() == ["requeue", "7_0", "--dependency=afterok:7"]
    assert (tmp_path / "out.slurm" / "shard-0.log").read_text().count("--- job 7_0 ") == 2
    assert different_files(out, tmp_path / "alone") == []
    ended = run_command([*command[:3], "--", str(case), "--seed", "1"], **environment)
    assert (ended.returncode, ended.stderr[:6]) == (2, "usage:")
