"""The program ``oneframe`` and the scripts: the same commands, found by their names, quick to say what is wrong."""

import argparse
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from oneframe.commands.__main__ import COMMANDS, EPILOG, command_module, dispatch
from oneframe.errors import InputError
from oneframe.process.command import command_parser
from oneframe.process.command_line import blender_command

ROOT = Path(__file__).resolve().parents[2]


def parser_of(name: str) -> argparse.ArgumentParser:
    module = command_module(name)
    return command_parser(f"oneframe {name}", module)


def examples(epilog: str) -> list[list[str]]:
    """Arguments of the lines under "examples:", without the remarks in parentheses."""
    lines = epilog.partition("examples:\n")[2].partition("\n\n")[0].splitlines()
    return [shlex.split(line.partition("  (")[0].strip().removeprefix("%(prog)s")) for line in map(str.strip, lines)]


def assert_one_line(ended: subprocess.CompletedProcess, code: int, message: str) -> None:
    assert (ended.returncode, ended.stdout) == (code, "")
    assert ended.stderr.startswith("error: ")
    assert ended.stderr.count("\n") == 1
    assert message in ended.stderr


@pytest.mark.parametrize("name", COMMANDS)
def test_every_example_of_the_help_is_a_command_line(name):
    module = command_module(name)
    assert len(examples(module.EPILOG)) >= 2
    for arguments in examples(module.EPILOG):
        parser_of(name).parse(arguments)


def test_the_examples_of_the_program_are_command_lines():
    for command, *arguments in examples(EPILOG):
        parser_of(command).parse(arguments)


@pytest.mark.parametrize("start", [[str(ROOT / "scripts" / "oneframe.py")], ["-m", "oneframe.commands"]], ids=str)
def test_a_process_of_the_script_or_the_program_is_what_runs_here(start, run_oneframe, run_command):
    """What other tests run in their own process."""
    for arguments in (["colour", "--help"], ["rendr"]):
        started, here = run_command([sys.executable, *start, *arguments]), run_oneframe(*arguments)
        assert (started.returncode, started.stdout, started.stderr) == (here.returncode, here.stdout, here.stderr)


def test_help_needs_neither_blender_nor_numpy(run_command):
    lines = [["--help"], ["--version"], *([name, "--help"] for name in COMMANDS if name != "check")]
    code = (
        "import sys\n"
        "sys.modules.update(dict.fromkeys(['bpy', 'cv2', 'numpy', 'scipy', 'skimage']))\n"
        "from oneframe.commands.__main__ import dispatch\n"
        "from oneframe.process.command_line import exit_code\n"
        f"sys.exit(max(exit_code(dispatch, line) for line in {lines!r}))"
    )
    ended = run_command([sys.executable, "-c", code])
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout.count("oneframe") >= len(lines)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "expected a command"),
        (["rendr"], "unknown command 'rendr'; did you mean 'render'?"),
        (["--vresion"], "unknown argument '--vresion'; did you mean '--version'?"),
        # before the missing --out is complained about
        (["render", "case.toml", "--ot", "dataset"], "unknown argument '--ot'; did you mean '--out'?"),
        (["render", "case.toml"], "the following arguments are required: --out"),
        (["pack", "--out", "x"], "expected the folder of the dataset, DIR, or --verify without it"),
        (["train", "dataset", "--seed", "9" * 400], "expected a finite number below 2^63"),
        (["evaluate", "case.toml", "--out", "x"], "the following arguments are required: PHOTOGRAPHS.json"),
    ],
    ids=str,
)
def test_mistyped_commands_and_options_are_named(arguments, message):
    with pytest.raises(InputError, match=re.escape(message)):
        dispatch(arguments)


def test_a_missing_package_is_named(run_command, tmp_path):
    code = (
        "import sys; sys.modules['cv2'] = None\n"
        "from oneframe.process.command_line import exit_code\n"
        "from oneframe.commands.__main__ import dispatch\n"
        f"sys.exit(exit_code(dispatch, ['align', {str(tmp_path / 'case.toml')!r}]))"
    )
    assert_one_line(run_command([sys.executable, "-c", code]), 3, "expected OpenCV")


@pytest.mark.render
def test_scripts_run_in_a_blender_program(write_tiny_case, tmp_path, run_command, run_oneframe):
    """In a real Blender, as shipped."""
    if not (program := os.environ.get("BLENDER")):
        pytest.skip("the environment variable BLENDER names no Blender program")

    def in_blender(*arguments, script="oneframe.py"):
        command = [*blender_command(program, str(ROOT / "scripts" / script)), *map(str, arguments)]
        return run_command(command, BLENDER_USER_RESOURCES=str(tmp_path / "resources"))

    case, out = write_tiny_case(tmp_path / "case"), tmp_path / "out"
    ended = in_blender(case, "--out", out, "--count", "6", "--workers", "2", script="render_dataset.py")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout.startswith("0/6 views\n")
    assert ended.stdout.endswith(f"dataset of 6 views: {out}\n")
    assert run_oneframe("check", out).returncode == 0
    ended = in_blender("colour", case, "--out", tmp_path / "surface.ply")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert (tmp_path / "surface.ply").read_bytes().startswith(b"ply\n")
    ended = in_blender("render", case, "--out", out, "--cuont", "6")
    assert ended.returncode == 2
    assert ended.stderr == "error: command line: unknown argument '--cuont'; did you mean '--count'?\n"
