"""The command ``oneframe surface``."""

import argparse
import math
from pathlib import Path

from ...errors import InputError
from ...process.arguments import at_least
from ...process.own_process import own_output

ABOUT = "Make the bone surface of a CT, drilled if you like, and the structures of a label map."
EPILOG = """examples:
  %(prog)s ct.nii.gz --out surface
  %(prog)s ct.nrrd --out surface --threshold otsu --crop 20 10 0 60 50 45
  %(prog)s ct.nii.gz --out surface --labels labels.nii.gz --drill mastoidectomy.toml
  %(prog)s ct.nii.gz --out surface --labels labels.nii.gz --remove predicted.nii.gz
  %(prog)s dicom_folder --list
  %(prog)s dicom_folder --series 2 --out surface

VOLUME is a CT in Hounsfield units: NIfTI, NRRD, MetaImage, or a folder of DICOM slices. The folder gets surface.ply
(LPS, mm), structures/*.ply, and surface.json, which says what was done.
Names, dates and other text of the headers are written nowhere.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("volume", metavar="VOLUME", type=Path, help="the CT: a file, or a folder of DICOM slices")
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder to write")
    volume = parser.add_argument_group("volume")
    volume.add_argument("--list", action="store_true", help="list the series in a folder of DICOM slices, and end")
    volume.add_argument("--series", metavar="N", type=int, help="take series N of the list")
    volume.add_argument(
        "--crop", metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"), nargs=6, type=float,
        help="keep only the box between two corners, LPS mm",
    )  # fmt: skip
    bone = parser.add_argument_group("bone")
    bone.add_argument(
        "--threshold", metavar="HU|otsu", type=_threshold,
        help="bone lies above it; otsu finds it from the grey values (default 300)",
    )  # fmt: skip
    bone.add_argument(
        "--islands", metavar="MM3", type=at_least(0, float),
        help="keep all parts of at least this volume (default: the largest part alone)",
    )  # fmt: skip
    bone.add_argument(
        "--holes", metavar="MM3", type=at_least(0, float), default=1.0,
        help="fill enclosed holes below this volume; air cells are larger (default %(default)g)",
    )  # fmt: skip
    removal = parser.add_argument_group("what is removed")
    removal.add_argument(
        "--drill", metavar="PLAN.toml", type=Path, help="strokes of a virtual drill, and margins around structures"
    )
    removal.add_argument(
        "--remove", metavar="LABELS", type=Path, help="a label map, such as a network's prediction: all its labels"
    )
    removal.add_argument(
        "--operated", metavar="VOLUME", type=Path, help="a registered CT from after the operation: the bone it lacks"
    )
    structures = parser.add_argument_group("structures")
    structures.add_argument(
        "--labels",
        metavar="LABELS",
        type=Path,
        help="a label map: a mesh for each label but bone, and what the drill spares",
    )
    mesh = parser.add_argument_group("mesh")
    mesh.add_argument(
        "--tolerance", metavar="MM", type=at_least(0, float),
        help="how far the simplified surface may lie from the original, and a quarter of it around what is removed or "
        "else the structures; 0 keeps all faces (default: half the smallest distance of voxels)",
    )  # fmt: skip
    mesh.add_argument(
        "--smooth",
        metavar="N",
        type=at_least(0),
        default=10,
        help="steps of smoothing, 0 for none (default %(default)s)",
    )


def run(arguments: argparse.Namespace) -> None:
    """Write surface, structures, picture and report, and say what they are."""
    from ...volume.reading.volume_reader import list_series
    from .stages import write_surface

    if arguments.out is None and not arguments.list:
        raise InputError("command line: --out: expected a folder to write")
    output = own_output()
    if arguments.list:
        output.writelines(f"{series}\n" for series in list_series(arguments.volume))
        return
    write_surface(arguments, output)


def _threshold(text: str) -> float | str:
    if text == "otsu":
        return text
    try:
        return at_least(-math.inf, float)(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a number of HU or otsu, found {text!r}") from None
