"""The command ``oneframe colour``."""

import argparse
from pathlib import Path

from ..dataset.options import UNSEEN
from ..process.own_process import own_output

ABOUT = "Write the surface with the frame's colours on it, as GLB, OBJ or PLY."
EPILOG = """examples:
  %(prog)s case.toml --out surface.glb
  %(prog)s case.toml --out surface.ply --colour vertex

PLY and OBJ keep the coordinates and units of the case's mesh; GLB is in metres with y up, as glTF requires.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("case", metavar="CASE.toml", type=Path, help="frame, camera, surface and pose")
    output = parser.add_argument_group("output")
    output.add_argument("--out", metavar="FILE", type=Path, required=True, help="file to write: .glb, .obj or .ply")
    output.add_argument(
        "--colour", choices=("texture", "vertex"), default="texture",
        help="an image mapped on the surface, or one colour per vertex (default %(default)s)",
    )  # fmt: skip
    output.add_argument(
        "--unseen", choices=UNSEEN, default="neutral",
        help="surface that the frame did not see: grey, or the observed colours, continued smoothly over the surface "
        "(default %(default)s)",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> None:
    """Write the coloured surface and report how much of it the frame saw."""
    from ..blender.colour.export import check_export, export_coloured_surface
    from ..case.case_file import read_case
    from ..case.loaded_case import load_case

    output = own_output()
    case = read_case(arguments.case)
    check_export(arguments.out, case.input_files(), colour=arguments.colour)
    loaded = load_case(case)
    messages = export_coloured_surface(loaded, arguments.out, colour=arguments.colour, unseen=arguments.unseen)
    output.writelines(f"{message}\n" for message in (*loaded.messages, *messages))
    output.write(f"coloured surface: {arguments.out}\n")
