"""The options of a dataset run on the command line, and the run's options from there and from a case file."""

import argparse
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from .options import (
    FOR_TRAINING,
    LENS,
    NONE,
    OPTIONS,
    PATHS,
    DatasetOptions,
    checked_together,
    checked_values,
    option_groups,
)

if TYPE_CHECKING:
    from ..light.lens_light import LensLight


def add_option_arguments(parser: argparse.ArgumentParser) -> None:
    """Add a command line option for each, under their headings; the namespace holds only those that the user sets."""
    for title, options in option_groups().items():
        group = parser.add_argument_group(title)
        for option in options:
            if option.kind is bool:
                group.add_argument(
                    option.flag, action=argparse.BooleanOptionalAction, default=argparse.SUPPRESS, help=option.text
                )
                continue
            default = "" if option.default is None else f" (default {option.default})"
            choices, numeric = option.choices, option.kind in (int, float)
            metavar = "|".join(choices) if choices else ("X" if option.kind is float else "N") if numeric else "PATH"
            group.add_argument(
                option.flag,
                type=_number if numeric else str,
                default=argparse.SUPPRESS,
                metavar=metavar,
                help=option.text + default,
            )
        if title == "views":
            group.add_argument(
                "--for-training", action="store_true", default=argparse.SUPPRESS,
                help="what networks learn from most: "
                + ", ".join(f"{OPTIONS[key].flag} {value}" for key, value in FOR_TRAINING.items())
                + ", of the light what [light] and the engine have; an option beside it counts more",
            )  # fmt: skip


def option_arguments(options: DatasetOptions) -> list[str]:
    """The command line that gives exactly these options, whatever a case file says."""
    arguments = []
    for option in OPTIONS.values():
        value = getattr(options, option.key)
        if option.kind is bool:
            arguments.append(option.flag if value else option.flag.replace("--", "--no-", 1))
        elif value is not None:
            arguments.append(f"{option.flag}={value}")
    return arguments


def absolute_options(options: DatasetOptions) -> DatasetOptions:
    """The same with absolute paths, for a process that runs elsewhere."""
    named = {name: getattr(options, name) for name in PATHS}
    return replace(options, **{name: os.path.abspath(path) for name, path in named.items() if path})


def _number(text: str) -> int | float:
    try:
        return int(text)
    except ValueError:
        return float(text)


_number.__name__ = "number"  # argparse uses the name in its message


def merged_options(
    table: Mapping[str, object],
    arguments: Mapping[str, object],
    case_path: Path,
    *,
    light: "LensLight | None" = None,
    where: str = "command line",
) -> DatasetOptions:
    """Options of a run: its arguments take precedence over the case file's [dataset] table; others are passed over.

    ``light`` is the case's, for ``for_training``; ``where`` begins messages on arguments.
    """
    from_table = checked_values(table, f"{case_path.name}: [dataset]")
    for name in PATHS & from_table.keys():
        from_table[name] = str(case_path.parent / str(from_table[name]))
    given = {name: arguments[name] for name in OPTIONS if name in arguments}
    if arguments.get("for_training"):
        has_shadows = light is not None and light.lamp_cam_mm is not None
        has_shadows &= given.get("engine", from_table.get("engine")) != "eevee"
        fullest = {"light": FOR_TRAINING["light"] if has_shadows else NONE if light is None else LENS}
        given = FOR_TRAINING | fullest | given
    # combinations only now: the command line may resolve a conflict in the table
    return checked_together({**from_table, **checked_values(given, where)}, "options")
