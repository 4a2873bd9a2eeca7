"""The program ``oneframe``: runs one command and imports no other. Also ``python -m oneframe.commands``."""

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from .. import __version__
from ..errors import InputError
from ..files.keys import nearest_name
from ..process.command_line import ArgumentParser, run_script
from .parser import explained_imports, fill_parser

COMMANDS = (
    "surface", "sample", "frames", "case", "align", "overlay", "render", "check", "pack", "compare", "evaluate",
    "report", "colour",
)  # fmt: skip
"""The modules of this package that are commands, in the order of the data flow."""

SHELLS = ("bash", "zsh", "tcsh")
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
    """Run a command.

    Parameters
    ----------
    argv
        The command and its arguments, or options of the program itself.

    Returns
    -------
    The exit code.

    Raises
    ------
    InputError
        No command or an unknown one; the command raises its own errors.
    """
    if argv and argv[0] in COMMANDS:
        return _command(argv[0]).main(argv[1:])
    if argv and not argv[0].startswith("-"):
        raise InputError(f"command line: unknown command {argv[0]!r}; {nearest_name(argv[0], COMMANDS)}")
    # prints help, the version or a completion script and exits, or raises
    program_parser(with_options=False).parse(argv)
    raise InputError("command line: expected a command; --help lists them")


def program_parser(*, with_options: bool) -> ArgumentParser:
    """The parser of the program: its own options and the names of all commands, ``with_options`` also theirs."""
    parser = ArgumentParser(
        prog="oneframe",
        description="Make many novel views with exact ground truth from one microscope frame and a CT-derived surface.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    parser.add_argument(
        "--print-completion", metavar="|".join(SHELLS), choices=SHELLS, action=_PrintCompletion,
        help="print the completion script for a shell",
    )  # fmt: skip
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")
    for name in COMMANDS:
        module = _command(name)
        command = commands.add_parser(name, help=module.ABOUT[0].lower() + module.ABOUT[1:].rstrip("."))
        if with_options:
            fill_parser(command, module.ABOUT, module.EPILOG, module.add_arguments)
    return parser


class _PrintCompletion(argparse.Action):
    """Prints a completion script and exits, as ``--version`` does."""

    def __call__(self, parser: argparse.ArgumentParser, _namespace: object, shell: Any, _option: object = None) -> None:
        with explained_imports():
            import shtab
        whole = program_parser(with_options=True)
        for action in _all_actions(whole):
            if action.type is Path or action.metavar == "FILE":
                action.complete = shtab.DIRECTORY if action.metavar == "DIR" else shtab.FILE  # type: ignore[attr-defined]
        sys.stdout.write(shtab.complete(whole, shell) + "\n")
        parser.exit()


def _all_actions(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    actions = list(parser._actions)
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            actions += [each for command in action.choices.values() for each in _all_actions(command)]
    return actions


def _command(name: str) -> ModuleType:
    return import_module(f".{name}", __package__)


if __name__ == "__main__":
    main()
