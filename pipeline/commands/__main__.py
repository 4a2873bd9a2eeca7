"""The program ``oneframe``: runs one command and imports no other. Also ``python -m oneframe.commands``."""

import argparse
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from .. import __version__
from ..errors import InputError
from ..files.keys import nearest_name
from ..process.arguments import ArgumentParser
from ..process.command import run_command
from ..process.command_line import run_script

COMMANDS = (
    "surface", "sample", "frames", "case", "align", "overlay", "register", "light", "render",
    "check", "pack", "train", "evaluate", "report", "colour",
)  # fmt: skip
"""In the order of the data flow; each is a module of its name."""

EPILOG = """examples:
  %(prog)s sample --out sample_case
  %(prog)s align sample_case/case.toml --refine --out sample_case/aligned.toml
  %(prog)s render sample_case/aligned.toml --out dataset --count 24
  %(prog)s check dataset

%(prog)s COMMAND --help describes a command.
"""


def main() -> None:
    """The entry point of the program."""
    run_script(dispatch)


def dispatch(argv: Sequence[str]) -> int:
    """Run a command, and give its exit code."""
    if argv and argv[0] in COMMANDS:
        # reads what is no plain PNG
        from .. import blender  # noqa: F401

        return run_command(f"oneframe {argv[0]}", command_module(argv[0]), argv[1:])
    if argv and not argv[0].startswith("-"):
        raise InputError(f"command line: unknown command {argv[0]!r}; {nearest_name(argv[0], COMMANDS)}")
    # prints help or the version and exits, or raises
    _program_parser().parse(argv)
    raise InputError("command line: expected a command; --help lists them")


def _program_parser() -> ArgumentParser:
    """The parser of the program: its own options and the names of all commands."""
    parser = ArgumentParser(
        prog="oneframe",
        description="Make many novel views with exact ground truth from one microscope frame and a CT-derived surface.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")
    for name in COMMANDS:
        about = command_module(name).ABOUT
        commands.add_parser(name, help=about[0].lower() + about[1:].rstrip("."))
    return parser


def command_module(name: str) -> Any:
    """The module of a command, with ``ABOUT``, ``EPILOG``, ``add_arguments`` and ``run``."""
    return import_module(f".{name}", __package__)


if __name__ == "__main__":
    main()
