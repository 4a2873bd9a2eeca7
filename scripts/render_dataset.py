"""Render a dataset of posed views from one aligned frame.

python scripts/render_dataset.py CASE.toml --out DIR [options]
blender -b -P scripts/render_dataset.py -- CASE.toml --out DIR [options]
"""

import os
import sys
from pathlib import Path

# the matrices are small: threads of numpy's BLAS only wait, and busily, on the cores that render
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import argparse
from collections.abc import Sequence

from pipeline.blender.command_line import ArgumentParser, end_with_input, own_output, run_script, script_command
from pipeline.blender.dataset.job import Job
from pipeline.blender.dataset.run import run, work
from pipeline.case.case_file import read_case
from pipeline.dataset.folder import parse_shard
from pipeline.dataset.options import add_option_arguments, merged_options
from pipeline.errors import InputError
from pipeline.progress import LINE_SECONDS

EXAMPLES = """
examples:
  render_dataset.py case.toml --out dataset --count 1000
  render_dataset.py case.toml --out dataset --cone-deg 30 --distance-min 0.8 --distance-max 1.3 --video
  render_dataset.py case.toml --out dataset --poses poses.npy --samples 8
  render_dataset.py case.toml --out dataset --count 100000 --shard 3/50      (part 3 of 0..49, on any machine)

The same command goes on where a stopped run ended. Shards that rendered into folders of their own are merged by
copying these into one; the same command without --shard then writes the tables. All options that concern the
content may also stand in the case file, in a table [dataset] (count = 1000, cone_deg = 30, ...).
"""


def parse_arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = ArgumentParser(
        prog="render_dataset.py",
        description=__doc__.splitlines()[0],
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("case", metavar="CASE.toml", type=Path, help="frame, camera, surface and pose")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, required=True, help="folder of the dataset; resumed if there"
    )
    add_option_arguments(parser)
    parser.add_argument("--workers", metavar="N", type=int, default=0, help="processes (default: one a core)")
    parser.add_argument("--shard", metavar="I/N", default="0/1", help="render part I (from 0) of N parts only")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    # for a program that runs this script and shows how far it is
    parser.add_argument("--progress-seconds", type=float, default=LINE_SECONDS, help=argparse.SUPPRESS)
    parser.add_argument("--end-with-input", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse(argv)
    if arguments.workers < 0:
        raise InputError(f"command line: --workers: expected 0 (one a core) or more, found {arguments.workers}")
    return arguments


def main(argv: Sequence[str]) -> int:
    arguments = parse_arguments(argv)
    output = own_output()
    case = read_case(arguments.case)
    options = merged_options(case.dataset, arguments, arguments.case)
    job = Job(case, arguments.out, options, parse_shard(arguments.shard))
    if arguments.worker:
        work(job, workers=arguments.workers, stream=output)
    else:
        if arguments.end_with_input:
            end_with_input()
        command = [*script_command(__file__), *argv, "--worker"]
        run(
            job,
            workers=arguments.workers,
            worker_command=command,
            stream=output,
            progress_seconds=arguments.progress_seconds,
        )
    return 0


if __name__ == "__main__":
    run_script(main)
