"""The command ``oneframe surface``."""

import argparse
import math
from dataclasses import dataclass
from pathlib import Path

from ...errors import InputError
from ...process.arguments import at_least
from ...process.command import option, positional, switch
from ...process.own_process import own_output

ABOUT = "Make the bone surface of a CT, drilled if you like, and the structures of a label map."
EPILOG = """examples:
  %(prog)s ct.nii.gz --out surface
  %(prog)s ct.nrrd --out surface --threshold otsu --crop 20 10 0 60 50 45
  %(prog)s ct.nii.gz --out surface --labels labels.nii.gz --drill mastoidectomy.toml
  %(prog)s ct.nii.gz --out surface --labels labels.nii.gz --remove predicted.nii.gz
  %(prog)s dicom_folder --list
  %(prog)s dicom_folder --series 2 --out surface

VOLUME is a CT in Hounsfield units: NIfTI, NRRD, or a folder of DICOM slices. The folder gets surface.ply
(LPS, mm), structures/*.ply, and surface.json, which says what was done.
Names, dates and other text of the headers are written nowhere.
"""


def _threshold(text: str) -> float | str:
    if text == "otsu":
        return text
    try:
        return at_least(-math.inf, float)(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a number of HU or otsu, found {text!r}") from None


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    volume: Path = positional("VOLUME", "the CT: a file, or a folder of DICOM slices")
    out: Path | None = option("DIR", "folder to write")
    list: bool = switch("list the series in a folder of DICOM slices, and end")
    series: int | None = option("N", "take series N of the list")
    crop: tuple[float, float, float, float, float, float] | None = option(
        ("X0", "Y0", "Z0", "X1", "Y1", "Z1"), "keep only the box between two corners, LPS mm"
    )  # fmt: skip
    threshold: float | str | None = option(
        "HU|otsu", "bone lies above it; otsu finds it from the grey values (default 300)", parse=_threshold
    )  # fmt: skip
    islands: float | None = option(
        "MM3", "keep all parts of at least this volume (default: the largest part alone)", least=0
    )  # fmt: skip
    holes: float = option(
        "MM3", "fill enclosed holes below this volume; air cells are larger (default %(default)g)", 1.0, least=0
    )  # fmt: skip
    drill: Path | None = option("PLAN.toml", "strokes of a virtual drill, and margins around structures")
    remove: Path | None = option("LABELS", "a label map, such as a network's prediction: all its labels")
    labels: Path | None = option("LABELS", "a label map: a mesh for each label but bone, and what the drill spares")
    tolerance: float | None = option(
        "MM", "how far the simplified surface may lie from the original, and a quarter of it around what is "
        "removed or else the structures; 0 keeps all faces (default: half the smallest distance of voxels)", least=0
    )  # fmt: skip
    smooth: int = option("N", "steps of smoothing, 0 for none (default %(default)s)", 10, least=0)


def run(arguments: Arguments) -> None:
    """Write surface, structures, picture and report, and say what they are."""
    from ...volume.reading.volume_reader import list_series
    from .stages import write_surface

    output = own_output()
    if arguments.list:
        output.writelines(f"{series}\n" for series in list_series(arguments.volume))
        return
    if arguments.out is None:
        raise InputError("command line: --out: expected a folder to write")
    write_surface(arguments, arguments.out, output)
