"""The command ``oneframe evaluate``."""

import argparse
import sys
from pathlib import Path

from ..process.arguments import at_least
from ..process.own_process import own_output

ABOUT = "Evaluate as in the paper: score views against real photographs, with the paper's own method beside them."
EPILOG = """examples:
  %(prog)s case.toml held_out.json --out evaluation
  %(prog)s case.toml held_out.json --case second.toml second.json --out evaluation --inception inception.onnx
  %(prog)s case.toml held_out.json --out evaluation --methods projective-cycles paper-cycles

PHOTOGRAPHS.json is a list of {"image": file, "cam_from_mesh": 4x4}; pixels whose alpha is 0 are left out.
Methods are projective, texture or vertex with -raster, -cycles or -eevee, the same with -fill before these, such as
projective-fill-raster, paper-pyvista, paper-cycles, and all. The command writes frames.csv with the scores of every
photograph, summary.md and figure.png. FID and KID need --inception: the documentation says how to export that file.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("case", metavar="CASE.toml", type=Path, help="frame, camera, surface and pose")
    parser.add_argument(
        "photographs", metavar="PHOTOGRAPHS.json", type=Path,
        help="photographs taken with the same camera, and their poses",
    )  # fmt: skip
    parser.add_argument(
        "--case", dest="more", metavar=("CASE.toml", "PHOTOGRAPHS.json"), type=Path, nargs=2, action="append",
        default=[], help="another case and its photographs; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--methods", metavar="METHOD", nargs="+", help="what to compare (default: ours in both colour modes, Eevee, "
        "and the paper's method where its renderer is installed)",
    )  # fmt: skip
    parser.add_argument(
        "--inception", metavar="FILE.onnx", type=Path, help="InceptionV3 up to its 2048 features, for FID and KID"
    )
    parser.add_argument("--seed", metavar="N", type=at_least(0), default=0, help="of resampling (default %(default)s)")
    output = parser.add_argument_group("output")
    output.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder to write")


def run(arguments: argparse.Namespace) -> None:
    """Write the evaluation and report its summary."""
    from ..blender.render.engines import RENDERERS
    from ..evaluation.evaluation_files import evaluation_run, run_evaluation
    from ..evaluation.methods import DEFAULT, chosen_methods

    methods = chosen_methods(arguments.methods or DEFAULT, RENDERERS)
    output = own_output()
    prepared = evaluation_run(
        [(arguments.case, arguments.photographs), *map(tuple, arguments.more)],
        arguments.out,
        methods,
        seed=arguments.seed,
        inception=arguments.inception,
    )
    output.writelines(f"{line}\n" for line in run_evaluation(prepared, stream=sys.stderr))
