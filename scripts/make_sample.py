"""Make the built-in sample case: a drilled temporal bone, a microscope frame of it, and held-out photographs.

python scripts/make_sample.py --out DIR
blender -b -P scripts/make_sample.py -- --out DIR        (a Blender whose Python has scikit-image)
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import argparse
import time
from collections.abc import Sequence

from pipeline.blender.command_line import own_output, run_script
from pipeline.blender.sample.sample_case import write_sample_case
from pipeline.sample.temporal_bone import sample_surface


def parse_arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make_sample.py", description=__doc__.splitlines()[0])
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=Path("sample_case"), help="folder to write (default: %(default)s)"
    )
    return parser.parse_args(argv)


def main(argv: Sequence[str]) -> int:
    arguments = parse_arguments(argv)
    output = own_output()
    start = time.monotonic()
    surface = sample_surface()
    print(f"surface of {len(surface.bone.faces)} triangles", file=output, flush=True)
    for path in write_sample_case(arguments.out, surface):
        print(f"{time.monotonic() - start:6.1f} s  {path}", file=output, flush=True)
    print(f"next: render_dataset.py {path} --out dataset", file=output, flush=True)
    return 0


if __name__ == "__main__":
    run_script(main)
