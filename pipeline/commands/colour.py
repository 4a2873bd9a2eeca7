"""The command ``oneframe colour``."""

from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Literal

from ..dataset.options import OPTIONS, UNSEEN
from ..process.command import choice, option, positional
from ..process.own_process import own_output

ABOUT = "Write the surface with the frame's colours on it, as GLB, OBJ or PLY."
EPILOG = """examples:
  %(prog)s case.toml --out surface.glb
  %(prog)s case.toml --out surface.ply --colour vertex

PLY and OBJ keep the coordinates and units of the case's mesh; GLB is in metres with y up, as glTF requires.
"""


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    case: Path = positional("CASE.toml", "frame, camera, surface and pose")
    out: Path = option("FILE", "file to write: .glb, .obj or .ply", MISSING)
    colour: Literal["texture", "vertex"] = choice(
        "an image mapped on the surface, or one colour per vertex (default %(default)s)", "texture",
        choices=("texture", "vertex"),
    )  # fmt: skip
    unseen: str = choice(OPTIONS["unseen"].text, "neutral", choices=UNSEEN)


def run(arguments: Arguments) -> None:
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
