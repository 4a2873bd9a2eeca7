"""The command ``oneframe evaluate``."""

import sys
from dataclasses import MISSING, dataclass
from pathlib import Path

from ..process.command import option, positional
from ..process.own_process import own_output

ABOUT = "Evaluate as in the paper: score views against real photographs, with the paper's own method beside them."
EPILOG = """examples:
  %(prog)s case.toml held_out.json --out evaluation
  %(prog)s case.toml held_out.json --case second.toml second.json --out evaluation --inception inception.onnx
  %(prog)s case.toml held_out.json --out evaluation --methods projective-cycles paper-cycles

PHOTOGRAPHS.json is a list of {"image": file, "cam_from_mesh": 4x4}, BOP's scene_gt.json (#/1: of object 1), or COLMAP's
images.txt; pixels whose alpha is 0 are left out. Photographs by another camera or with another zoom have "camera": file
too, as for oneframe case --camera, or "scene_camera.json#7" of several in it.
Methods are projective or vertex with -raster, -cycles or -eevee, the same with -fill before these, such as
projective-fill-raster, paper-pyvista and paper-cycles. The command writes frames.csv with the scores of every
photograph, summary.md and figure.png. FID and KID need --inception: the documentation says how to export that file.
"""


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    case: Path = positional("CASE.toml", "frame, camera, surface and pose")
    photographs: Path = positional("PHOTOGRAPHS.json", "photographs and their poses")
    more: tuple[tuple[Path, Path], ...] = option(
        ("CASE.toml", "PHOTOGRAPHS.json"), "another case and its photographs; may be repeated", (), each=True,
        flag="--case",
    )  # fmt: skip
    methods: tuple[str, ...] | None = option(
        "METHOD", "what to compare (default: ours in both colour modes, Eevee, and the paper's method where its "
        "renderer is installed)"
    )  # fmt: skip
    inception: Path | None = option("FILE.onnx", "InceptionV3 up to its 2048 features, for FID and KID")
    out: Path = option("DIR", "folder to write", MISSING)


def run(arguments: Arguments) -> None:
    """Write the evaluation and report its summary."""
    from ..blender.render.engines import RENDERERS
    from ..evaluation.evaluate import evaluation_run, run_evaluation
    from ..evaluation.methods import DEFAULT, chosen_methods

    methods = chosen_methods(arguments.methods or DEFAULT, RENDERERS)
    output = own_output()
    pairs = [(arguments.case, arguments.photographs), *arguments.more]
    prepared = evaluation_run(pairs, arguments.out, methods, inception=arguments.inception)
    output.writelines(f"{line}\n" for line in run_evaluation(prepared, stream=sys.stderr))
