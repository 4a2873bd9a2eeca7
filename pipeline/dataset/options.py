"""The options of a dataset run: one list for the command line, the case file's [dataset] table and the record."""

import argparse
import dataclasses
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..files.keys import nearest_name

ENGINES = ("cycles", "raster", "eevee")
COLOURS = ("projective", "texture", "vertex")
UNSEEN = ("neutral", "fill")
SAMPLERS = ("cone", "gaussian", "shell", "trajectory")
LARGEST_NUMBER = 2**53
"""Whole numbers beyond this have no exact float, and no option needs them."""


def _option(default: Any, text: str, **limits: Any) -> Any:
    return field(default=default, metadata={"help": text, **limits})


@dataclass(frozen=True)
class DatasetOptions:
    """Everything that determines the content of a dataset in addition to the case."""

    count: int = _option(100, "number of views", least=1, most=10_000_000)
    seed: int = _option(0, "seed of the poses; view i depends only on the seed and i", least=0)
    poses: str | None = _option(
        None, "explicit poses cam_from_mesh, in the frame of the mesh file: .npy (N x 4 x 4) or a JSON list; they "
        "replace the sampler and --count"
    )  # fmt: skip
    scale: float = _option(1.0, "size of the views relative to the frame's", least=1 / 64, most=8)
    engine: str = _option(
        "cycles", "renderer; cycles is exact; raster is as exact and faster; eevee needs OpenGL", choices=ENGINES
    )
    samples: int = _option(
        1, "1: one exact ray through each pixel centre; more: anti-aliased, with this many rays in each pixel that an "
        "edge crosses. Depth and masks are exact either way", least=1, most=256,
    )  # fmt: skip
    colour: str = _option(
        "projective", "how the frame colours the surface: projective (exact at every shaded point), texture (baked), "
        "vertex (the paper's method)", choices=COLOURS,
    )  # fmt: skip
    unseen: str = _option(
        "neutral", "surface that the frame did not see: neutral (grey), or fill (the observed colours, continued "
        "smoothly over the surface). The mask of the observed surface is the same", choices=UNSEEN,
    )  # fmt: skip
    max_incidence_deg: float = _option(
        87.0, "largest angle between the frame's ray and the surface's normal at which surface counts as "
        "seen; what the frame sees at a grazing angle is stretched to streaks in other views", least=0, most=90,
    )  # fmt: skip
    float_depth: bool = _option(False, "also write depth as float32 millimetres (.npy)")
    video: bool = _option(False, "also render a smooth trajectory as MP4 with its poses")
    video_frames: int = _option(120, "length of the video in frames (24 per second)", least=2)
    sampler: str = _option(
        "cone", "distribution of poses around the frame's pose: cone of viewing directions; gaussian in se(3); shell: "
        "uniform in the volume of a spherical shell; trajectory: a smooth closed curve", choices=SAMPLERS,
    )  # fmt: skip
    cone_deg: float = _option(20.0, "cone, trajectory: largest tilt of the viewing direction", least=0, most=180)
    roll_deg: float = _option(15.0, "cone, shell, trajectory: largest in-plane roll, either way", least=0, most=180)
    distance_min: float = _option(
        0.9, "cone, shell, trajectory: smallest distance, relative to the frame's", least=0.01
    )
    distance_max: float = _option(1.1, "cone, shell, trajectory: largest distance, relative to the frame's", least=0.01)
    shift_mm: float = _option(2.0, "cone: largest lateral shift in the image plane", least=0)
    sigma_deg: float = _option(5.0, "gaussian: standard deviation of the rotation about each axis", least=0, most=60)
    sigma_mm: float = _option(3.0, "gaussian: standard deviation of the translation along each axis", least=0)
    polar_deg: float = _option(60.0, "shell: largest angle from the frame's viewing direction", least=0, most=180)
    min_observed: float = _option(0.5, "least observed fraction of the surface in a view", least=0, most=1)
    min_surface: float = _option(
        0.3, "least fraction of a view that the surface covers, relative to the frame's", least=0, most=1
    )  # fmt: skip
    min_clearance_mm: float = _option(5.0, "least distance from camera to surface", least=0)


def checked_options(values: Mapping[str, object], where: str) -> DatasetOptions:
    """Check options in a mapping such as the [dataset] table; those that are missing keep their defaults.

    Raises
    ------
    InputError
        An unknown name; a value of the wrong kind, not finite or out of range; options that exclude each other.
    """
    return _checked_together(_checked_values(values, where), where)


def _checked_values(values: Mapping[str, object], where: str) -> dict[str, object]:
    fields = {entry.name: entry for entry in dataclasses.fields(DatasetOptions)}
    checked: dict[str, object] = {}
    for name, value in values.items():
        if name not in fields:
            raise InputError(f"{where}: unknown option {name!r}; {nearest_name(name, tuple(fields))}")
        checked[name] = _checked_value(name, value, fields[name], where)
    return checked


def _checked_together(checked: Mapping[str, object], where: str) -> DatasetOptions:
    options = DatasetOptions(**checked)  # type: ignore[arg-type]
    if options.distance_min > options.distance_max:
        raise InputError(
            f"{where}: expected distance_min <= distance_max, found {options.distance_min:g} > "
            f"{options.distance_max:g}; swap them"
        )
    return options


def _checked_value(name: str, value: Any, entry: dataclasses.Field, where: str) -> object:
    kind: Any = entry.type
    if kind is bool:
        if not isinstance(value, bool):
            raise InputError(f"{where}: {name}: expected true or false, found {value!r}")
        return value
    if kind is str or kind == str | None:
        choices = entry.metadata.get("choices")
        if not isinstance(value, str) or (choices and value not in choices):
            hint = f"; {nearest_name(value, choices)}" if choices and isinstance(value, str) else ""
            raise InputError(
                f"{where}: {name}: expected {' or '.join(choices or ['a file name'])}, found {value!r}{hint}"
            )
        return value
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST_NUMBER
    if not is_number or (kind is int and value != int(value)):
        raise InputError(f"{where}: {name}: expected a {'whole ' if kind is int else ''}number, found {value!r}")
    least, most = entry.metadata.get("least", -math.inf), entry.metadata.get("most", math.inf)
    if not least <= value <= most:
        limits = f"at least {least:g}" if most == math.inf else f"{least:g} to {most:g}"
        raise InputError(f"{where}: {name}: expected {limits}, found {value!r}")
    return kind(value)


def option_names() -> tuple[str, ...]:
    """The names of all options, in their order."""
    return tuple(entry.name for entry in dataclasses.fields(DatasetOptions))


def add_option_arguments(parser: argparse._ActionsContainer, names: Collection[str] | None = None) -> None:
    """Add one command line option per field, or per name; the namespace holds only those that the user sets."""
    for entry in dataclasses.fields(DatasetOptions):
        if names is not None and entry.name not in names:
            continue
        flag = "--" + entry.name.replace("_", "-")
        if entry.type is bool:
            parser.add_argument(
                flag, action=argparse.BooleanOptionalAction, default=argparse.SUPPRESS, help=entry.metadata["help"]
            )
            continue
        default = "" if entry.default is None else f" (default {entry.default})"
        numeric = entry.type in (int, float)
        choices = entry.metadata.get("choices")
        metavar = "|".join(choices) if choices else ("X" if entry.type is float else "N") if numeric else "FILE"
        parser.add_argument(
            flag,
            type=_number if numeric else str,
            default=argparse.SUPPRESS,
            metavar=metavar,
            help=entry.metadata["help"] + default,
        )


def option_arguments(options: DatasetOptions) -> list[str]:
    """The command line that gives exactly these options, whatever a case file says."""
    arguments = []
    for entry in dataclasses.fields(DatasetOptions):
        flag, value = entry.name.replace("_", "-"), getattr(options, entry.name)
        if entry.type is bool:
            arguments.append(f"--{flag}" if value else f"--no-{flag}")
        elif value is not None:
            arguments.append(f"--{flag}={value}")
    return arguments


def _number(text: str) -> int | float:
    try:
        return int(text)
    except ValueError:
        return float(text)


_number.__name__ = "number"  # argparse uses the name in its message


def merged_options(table: Mapping[str, object], arguments: argparse.Namespace, case_path: Path) -> DatasetOptions:
    """Options of a run: the command line takes precedence over the case file's [dataset] table.

    Raises
    ------
    InputError
        As :func:`checked_options`.
    """
    names = option_names()
    from_table = _checked_values(table, f"{case_path.name}: [dataset]")
    if "poses" in from_table:
        from_table["poses"] = str(case_path.parent / str(from_table["poses"]))
    given = {name: getattr(arguments, name) for name in names if hasattr(arguments, name)}
    # combinations only now: the command line may resolve a conflict in the table
    return _checked_together({**from_table, **_checked_values(given, "command line")}, "options")
