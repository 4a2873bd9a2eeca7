"""The command ``oneframe render``."""

import argparse
import os
import sys
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from ..dataset.option_arguments import add_option_arguments
from ..errors import InputError, naming
from ..process.arguments import resumable
from ..process.command import option, positional, switch
from ..process.command_line import end_with_input, script_command
from ..process.own_process import own_output
from ..progress import LINE_SECONDS, Progress

if TYPE_CHECKING:
    # --help must not wait for numpy
    from ..blender.dataset.job import Job

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "render_dataset.py"
"""This command as a script, which a checkout and the extension have."""

ABOUT = "Render a dataset of posed views from one aligned frame, or from each of a queue."
EPILOG = """examples:
  %(prog)s case.toml --out dataset --count 1000
  %(prog)s case.toml --out dataset --cone-deg 30 --distance-min 0.8 --distance-max 1.3 --video
  %(prog)s case.toml --out dataset --poses poses.npy --samples 8
  %(prog)s case.toml --out dataset --count 100000 --shard 3/50      (shard 3 of 0..49, on any machine)
  %(prog)s case.toml --out dataset --count 100000 --cluster tls://host:8786       (on a Dask cluster)
  %(prog)s queue --out views --count 500          (a dataset of 500 views of each aligned frame)

Run the same command again to continue a stopped run, or with a larger --count to add views. To merge shards from
separate folders, copy the folders into one and run the same command without --shard: it writes the tables. The case
file may hold all options that affect the content, in a table [dataset] (count = 1000, cone_deg = 30, ...).
"""


@dataclass(frozen=True)
class Arguments:
    """What the command takes beside the options of a dataset run."""

    case: Path = positional("CASE.toml|QUEUE", "frame, camera, surface and pose; or a folder of such cases")
    out: Path = option("DIR", "folder of the dataset; an unfinished one is resumed", MISSING)
    workers: int = option("N", "number of processes (default: one per core)", 0, least=0)
    shard: str = option("I/N", "render only shard I of N, counted from 0", "0/1")
    verify: bool = switch(
        "compare the hashes of all finished files, not only that they are there with their sizes; what has changed is "
        "rendered again"
    )
    cluster: str | None = option(
        "ADDRESS", "render on the workers of a Dask cluster: the address of its scheduler, such as tls://host:8786"
    )
    insecure: bool = switch(
        "with --cluster: take a scheduler on another machine without TLS, though everybody in its network can run "
        "programs as you"
    )
    blender_on_workers: str | None = option(
        "PROGRAM", "with --cluster: the Blender program that renders on the workers' machines (default: the bpy module "
        "in the workers' Python)"
    )  # fmt: skip
    # after the arguments of a queue, for a worker at one of its cases
    queued_case: Path | None = option("", argparse.SUPPRESS)
    worker: bool = switch(argparse.SUPPRESS)
    # for a program that runs this command and shows its progress
    progress_seconds: float = option("", argparse.SUPPRESS, LINE_SECONDS)
    end_with_input: bool = switch(argparse.SUPPRESS)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of a dataset run, which are declared with it."""
    add_option_arguments(parser)


def own_command() -> list[str]:
    """Starts this command in another process."""
    return script_command(str(SCRIPT)) if SCRIPT.is_file() else [sys.executable, "-m", __package__, "render"]


@resumable()
def run(arguments: argparse.Namespace) -> None:
    """Render the dataset, or those of a queue, or act as one of its worker processes."""
    if arguments.queued_case is not None:
        arguments.case = arguments.queued_case
    for name in ("insecure", "blender_on_workers"):
        if getattr(arguments, name) and arguments.cluster is None:
            flag = "--" + name.replace("_", "-")
            raise InputError(f"command line: {flag}: expected with --cluster only; add it, or leave out both")
    for name, default in (("shard", "0/1"), ("workers", 0)):
        if arguments.cluster is not None and getattr(arguments, name) != default:
            raise InputError(
                f"command line: --cluster: expected without --{name}, found --{name} {getattr(arguments, name)}; the "
                f"cluster's workers share the views by themselves: leave --{name} out"
            )
    # the matrices are small: numpy's BLAS threads would only busy-wait on the cores that render
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    render_this = _render_queue if arguments.case.is_dir() else _render_case
    render_this(arguments, own_output())


def _render_case(arguments: argparse.Namespace, output: TextIO) -> None:
    from ..blender.dataset.run import run as render
    from ..blender.dataset.run import work
    from ..case.pose_record import INITIAL_GUESS
    from ..dataset.layout import RECORD
    from ..files.outputs import check_folder

    job = _job(arguments)
    case = job.case
    if case.refused:
        raise InputError(
            f"{case.path}: expected a frame to render, it was refused: {case.refused}; "
            "take it back in the window, or delete [frame] refused"
        )
    check_folder(arguments.out, _read_by(job))
    if arguments.worker:
        work(job, workers=arguments.workers, stream=output)
        return
    # the right eye's workers are in the left eye's dataset
    around = next((each for each in arguments.out.resolve().parents if (each / RECORD).is_file()), None)
    if around is not None:
        raise InputError(
            f"{arguments.out}: expected a folder of its own, found it in the dataset {around}; name another"
        )
    if arguments.end_with_input:
        end_with_input()
    if case.alignment.method == INITIAL_GUESS:
        output.write(f"note: the pose of {case.path.name} is an initial guess that nobody has aligned\n")
    if arguments.cluster is not None:
        _render_on_cluster(job, arguments, output)
    # what is left: tables and video, if others have rendered
    render(
        job,
        workers=arguments.workers,
        worker_command=[*own_command(), *arguments.argv, "--worker"],
        stream=output,
        verify=arguments.verify,
        progress_seconds=arguments.progress_seconds,
    )


def _job(arguments: argparse.Namespace) -> "Job":
    from ..blender.dataset.job import Job
    from ..case.case_file import read_case
    from ..dataset.option_arguments import merged_options
    from ..dataset.run.run_folder import parse_shard

    case = read_case(arguments.case)
    options = merged_options(case.dataset, vars(arguments), arguments.case, light=case.light)
    return Job(case, arguments.out, options, parse_shard(arguments.shard))


def _read_by(job: "Job") -> dict[str, Path]:
    """What a job reads, by what it is."""
    from ..dataset.description import input_files

    return job.case.input_files() | input_files(job.case, job.options)


def _render_queue(arguments: argparse.Namespace, output: TextIO) -> None:
    """Render the aligned cases of a queue, each as its own command would."""
    from ..blender.dataset.job import open_job
    from ..case.case_file import read_case
    from ..case.case_queue import ALIGNED, CHECKED, queued_cases, state_of
    from ..dataset.layout import CASES
    from ..dataset.run.run_folder import check_description
    from ..files.outputs import check_own_folder

    out: Path = arguments.out
    paths = queued_cases(arguments.case)
    if not paths:
        raise InputError(
            f"{arguments.case}: expected a case file, or a queue: a folder of folders with a case.toml each; found none"
        )
    own: dict[str, argparse.Namespace] = {}
    read: dict[str, Path] = {}
    for path in paths:
        name = path.parent.name
        with naming(name):
            case = read_case(path, posed=False)
            if (state := state_of(case)) not in (ALIGNED, CHECKED):
                output.write(f"{name}: left out, it is {state}{case.refused and f': {case.refused}'}\n")
                continue
            here = {"case": path, "out": out / CASES / name}
            argv = [*arguments.argv, "--queued-case", str(path), "--out", str(here["out"])]
            own[name] = argparse.Namespace(**vars(arguments) | here | {"argv": argv})
            job = _job(own[name])
            opened = open_job(job)
            check_description(job.out, opened.description, opened.given_poses)
            read |= {f"{what} of {name}": file for what, file in _read_by(job).items()}
            output.write(f"{name}: {state}\n")
    if not own:
        raise InputError(f"{arguments.case}: expected cases that are aligned or checked, found none; align them first")
    check_own_folder(out, CASES, read, alone=False)
    for number, (name, each) in enumerate(own.items(), start=1):
        output.write(f"{name}: rendering, {number} of {len(own)}\n")
        with naming(name):
            _render_case(each, output)


def _render_on_cluster(job: "Job", arguments: argparse.Namespace, output: TextIO) -> None:
    """Have the shards of a job rendered by the workers of a cluster."""
    from ..blender.dataset.job import open_job
    from ..cluster.scheduler import open_scheduler
    from ..cluster.shards import render_shards
    from ..dataset.option_arguments import absolute_options, option_arguments
    from ..dataset.run.run_folder import check_description, run_token

    opened = open_job(job)
    check_description(job.out, opened.description, opened.given_poses)
    options = option_arguments(absolute_options(job.options))
    command = [os.path.abspath(job.case.path), f"--out={os.path.abspath(job.out)}", *options]
    if arguments.verify:
        command.append("--verify")
    with open_scheduler(arguments.cluster, insecure=arguments.insecure) as client, run_token(job.out) as token:
        output.write(f"workers of the scheduler {arguments.cluster}\n")
        with Progress(opened.count, "views", stream=output, line_seconds=arguments.progress_seconds) as progress:
            render_shards(client, command, token, opened.count, progress, blender=arguments.blender_on_workers)
