"""A command's arguments, declared once as the fields of a frozen dataclass: its parser and its type follow from them.

The type of a field says what it takes: ``bool`` is a switch, ``X | None`` may be left out, ``tuple[X, ...]`` takes
several values and ``tuple[X, X]`` that many.
"""

import argparse
import dataclasses
import math
import types
import typing
from collections.abc import Callable, Collection, Sequence
from dataclasses import MISSING, dataclass, field
from pathlib import Path
from typing import Any

from ..files.content import files_of_command
from .arguments import ArgumentParser, at_least, explained_imports

KEY = "argument"


def command_parser(prog: str, command: Any) -> ArgumentParser:
    """The parser of a command, a module of :mod:`oneframe.commands`, that the user calls by ``prog``.

    It has ``ABOUT``, one sentence; ``EPILOG``, examples and notes in which ``%(prog)s`` stands for how it is called;
    ``Arguments``, the dataclass; ``run``, which takes them; and perhaps ``add_arguments``, for what others declare.
    """
    layout = argparse.RawDescriptionHelpFormatter
    parser = ArgumentParser(prog=prog, description=command.ABOUT, epilog=command.EPILOG, formatter_class=layout)
    add_declared(parser, command.Arguments)
    getattr(command, "add_arguments", lambda _: None)(parser)
    return parser


def run_command(prog: str, command: Any, argv: Sequence[str]) -> int:
    """Parse the arguments of a command and run it; gives its exit code.

    A command that adds arguments which are declared elsewhere gets all of them as argparse does, and ``argv``.
    """
    with explained_imports(), files_of_command():
        parsed = command_parser(prog, command).parse(argv)
        if hasattr(command, "add_arguments"):
            parsed.argv = argv
            return command.run(parsed) or 0
        return command.run(declared_values(command.Arguments, parsed)) or 0


@dataclass(frozen=True)
class Argument:
    """How a field is given on the command line.

    Attributes
    ----------
    metavar, about
        How its value is named, and what it is; ``%(default)s`` stands for the default.
    is_option
        Whether it has a flag; else its place counts.
    flag
        Another one than the field's name.
    least
        Of a number; any finite one if left out.
    choices
        The values that it may have.
    parse
        Makes the value of a text, where its type does not.
    each
        Whether several values are given by several flags.
    excludes
        Name of a group of which one is given, and no more.
    """

    metavar: str | tuple[str, ...]
    about: str
    is_option: bool = True
    flag: str = ""
    least: float = -math.inf
    choices: Collection[str] = ()
    parse: Callable[[str], Any] | None = None
    each: bool = False
    excludes: str = ""


def positional(metavar: str, about: str, default: Any = MISSING) -> Any:
    """A field that is given by its place."""
    return field(default=default, metadata={KEY: Argument(metavar, about, is_option=False)}, kw_only=True)


def option(metavar: str | tuple[str, ...], about: str, default: Any = None, **declared: Any) -> Any:
    """A field that is given by a flag; it must be, if its default is :data:`dataclasses.MISSING`."""
    return field(default=default, metadata={KEY: Argument(metavar, about, **declared)}, kw_only=True)


def choice(about: str, default: Any = None, *, choices: Collection[str]) -> Any:
    """A field that is given by a flag, and has one of these values."""
    return option("", about, default, choices=choices)


def switch(about: str) -> Any:
    """A field that is true if its flag is given."""
    return option("", about, False)


def add_declared(parser: argparse.ArgumentParser, arguments: type) -> None:
    """Add the arguments that a dataclass declares to a parser."""
    kinds, groups = typing.get_type_hints(arguments), dict[str, Any]()
    for entry in dataclasses.fields(arguments):
        argument: Argument = entry.metadata[KEY]
        owner: Any = parser
        if argument.excludes:
            if argument.excludes not in groups:
                groups[argument.excludes] = parser.add_mutually_exclusive_group(required=True)
            owner = groups[argument.excludes]
        settings = _settings(argument, kinds[entry.name], entry.default)
        if argument.is_option:
            flag = argument.flag or "--" + entry.name.replace("_", "-")
            required = entry.default is MISSING and not argument.excludes
            owner.add_argument(flag, dest=entry.name, required=required, **settings)
        else:
            owner.add_argument(entry.name, **settings)


def declared_values(arguments: type, parsed: argparse.Namespace) -> Any:
    """The dataclass of what was parsed."""
    values = {entry.name: getattr(parsed, entry.name) for entry in dataclasses.fields(arguments)}
    return arguments(**{name: tuple(value) if isinstance(value, list) else value for name, value in values.items()})


def _settings(argument: Argument, kind: Any, default: Any) -> dict[str, Any]:
    """What argparse is told."""
    if isinstance(kind, types.UnionType):
        kind = next(part for part in typing.get_args(kind) if part is not type(None))
    settings: dict[str, Any] = {"help": argument.about, "default": None if default is MISSING else default}
    if kind is bool:
        return settings | {"action": "store_true"}
    settings["metavar"] = argument.metavar or None
    parts = typing.get_args(kind)
    if parts and not argument.choices:
        kind = parts[0]
        if argument.each:
            settings |= {"action": "append", "default": list(default)}
            if of_each := typing.get_args(kind):
                kind, settings["nargs"] = of_each[0], len(of_each)
        else:
            settings["nargs"] = "+" if parts[-1] is Ellipsis else len(parts)
    elif not argument.is_option and default is not MISSING:
        settings["nargs"] = "?"
    if argument.choices:
        settings |= {"choices": argument.choices, "metavar": None}
    if argument.parse is not None:
        settings["type"] = argument.parse
    elif kind in (int, float):
        settings["type"] = at_least(argument.least, kind)
    elif kind is Path:
        settings["type"] = kind
    return settings
