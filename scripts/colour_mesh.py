"""Write the surface with the frame's colours on it, as GLB, OBJ or PLY.

python scripts/colour_mesh.py CASE.toml --out surface.glb [--colour texture|vertex]
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import argparse
from collections.abc import Sequence

from pipeline.blender.case.load_case import load_case
from pipeline.blender.colour.export import export_coloured_surface
from pipeline.blender.command_line import own_output, run_script
from pipeline.case.case_file import read_case


def main(argv: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="colour_mesh.py", description=__doc__.splitlines()[0])
    parser.add_argument("case", metavar="CASE.toml", type=Path)
    parser.add_argument("--out", metavar="FILE", type=Path, required=True, help="ends in .glb, .obj or .ply")
    parser.add_argument("--colour", choices=("texture", "vertex"), default="texture")
    arguments = parser.parse_args(argv)
    output = own_output()
    loaded = load_case(read_case(arguments.case))
    for sentence in (*loaded.messages, *export_coloured_surface(loaded, arguments.out, colour=arguments.colour)):
        output.write(sentence + "\n")
    output.write(f"coloured surface: {arguments.out}\n")
    output.flush()
    return 0


if __name__ == "__main__":
    run_script(main)
