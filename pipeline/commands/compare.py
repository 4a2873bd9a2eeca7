"""The command ``oneframe compare``."""

import argparse
from pathlib import Path

from ..dataset.options import COLOURS
from ..process.arguments import explained_imports
from ..process.own_process import own_output

ABOUT = "Compare synthetic views with real photographs of the same poses, and measure their similarity."
EPILOG = """examples:
  %(prog)s case.toml held_out.json --out comparison
  %(prog)s case.toml held_out.json --out comparison --colour vertex

PHOTOGRAPHS.json is a list of {"image": file, "cam_from_mesh": 4x4}. The command writes likeness.csv with the
similarities, a picture for each photograph (photograph, view, difference) and sheet.png with all of them.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("case", metavar="CASE.toml", type=Path, help="frame, camera, surface and pose")
    parser.add_argument(
        "photographs",
        metavar="PHOTOGRAPHS.json",
        type=Path,
        help="photographs taken with the same camera, and their poses",
    )
    output = parser.add_argument_group("output")
    output.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder to write")
    output.add_argument(
        "--colour", choices=COLOURS, default=COLOURS[0],
        help="how the frame colours the surface (default %(default)s)",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Write the comparison and report the similarity for each photograph."""
    with explained_imports():
        from ..blender.case.load_case import load_case, read_photographs
        from ..blender.evaluation.comparison import SHEET, check_comparisons, write_comparisons
        from ..case.case_file import read_case
        from ..dataset.check.findings import printable
    output = own_output()
    case = read_case(arguments.case)
    loaded = load_case(case)
    photographs, messages = read_photographs(arguments.photographs, case)
    for message in (*loaded.messages, *messages):
        output.write(f"note: {message}\n")
    check_comparisons(arguments.out, photographs, {**case.input_files(), "list of photographs": arguments.photographs})
    for comparison in write_comparisons(loaded, photographs, arguments.out, colour=arguments.colour):
        found, name = comparison.similarity, printable(comparison.photograph.image.name)
        if found is None:
            output.write(f"{name}: shows nothing that the frame saw; not compared\n")
            continue
        output.write(
            f"{name}: SSIM {found.ssim:.3f}, mean error {found.mean_error:.1f}/255, "
            f"correlation {found.correlation:.3f} over {found.pixels} px\n"
        )
    output.write(f"photograph, view, difference: {arguments.out / SHEET}\n")
    return 0
