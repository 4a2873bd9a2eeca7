"""Measure the surface from CT: errors against analytic surfaces beside scikit-image's, and a whole run.

    python scripts/benchmark_surface.py [--size 200] [--rounds 3] [--whole 512] [--out FILE.json]

The whole run is `oneframe surface` with default options on a synthetic CT of --whole voxels a side (0: none), in a
process of its own: seconds of the clock and of processors, and the largest memory.
"""

import sys
from pathlib import Path

# the repository's root: scripts are run from a checkout
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import json
import os
import platform
import resource
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict

import numpy as np

from pipeline.blender.command_line import ArgumentParser, run_script
from pipeline.blender.process import own_output
from pipeline.errors import RunError
from pipeline.evaluation.trials.surface_accuracy import ACCURACY_HEAD, measure_shapes, write_synthetic_bone
from pipeline.files.content import write_bytes_atomically
from pipeline.files.kinds import Kind, json_object
from pipeline.files.outputs import Output, check_outputs, made_folder, writing
from pipeline.files.temporary import temporary_folder

FIGURES = Kind("the figures of this script", json_object("shapes", "machine"))
SCRIPT = Path(__file__).with_name("ct_to_surface.py")
SPACING_MM = 0.4


def main(argv: Sequence[str]) -> int:
    parser = ArgumentParser(prog="benchmark_surface.py", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--size", metavar="N", type=int, default=200, help="voxels a side of the analytic shapes")
    parser.add_argument("--rounds", metavar="N", type=int, default=3)
    parser.add_argument(
        "--whole", metavar="N", type=int, default=512, help="voxels a side of the whole run, 0 for none"
    )
    parser.add_argument("--out", metavar="FILE", type=Path, help="write all figures as JSON")
    arguments = parser.parse(argv)
    if arguments.size < 160 or arguments.rounds < 1 or arguments.whole < 0:
        parser.error("expected --size from 160, --rounds from 1 and --whole from 0")
    if arguments.out:
        check_outputs([Output(arguments.out, FIGURES)], {})
    output = own_output()

    def report(line: str) -> None:
        output.write(line + "\n")
        output.flush()

    for line in ACCURACY_HEAD:
        report(line)
    shapes = measure_shapes(arguments.size, arguments.rounds, report)
    figures: dict[str, object] = {
        "machine": {"processors": os.cpu_count(), "python": platform.python_version(), "numpy": np.__version__},
        "size": arguments.size, "rounds": arguments.rounds, "shapes": [asdict(shape) for shape in shapes],
    }  # fmt: skip
    if arguments.whole:
        figures["whole"] = whole_run(arguments.whole, report)
    if arguments.out:
        with writing(made_folder(arguments.out)):
            write_bytes_atomically(arguments.out, (json.dumps(figures, indent=2) + "\n").encode())
    return 0


def whole_run(size: int, report: Callable[[str], None]) -> dict[str, float]:
    """``oneframe surface`` on a synthetic CT: what it took.

    Raises
    ------
    RunError
        It failed.
    """
    with temporary_folder() as folder:
        write_synthetic_bone(folder / "ct.mha", size, SPACING_MM, np.random.default_rng(0))
        begin = time.monotonic()
        line = [sys.executable, str(SCRIPT), str(folder / "ct.mha"), "--out", str(folder / "out")]
        ended = subprocess.run(line, capture_output=True, text=True, check=False)
        seconds = time.monotonic() - begin
        if ended.returncode:
            raise RunError(f"ct_to_surface.py: expected a surface, it failed: {ended.stderr.strip()[-300:]}")
        record = json.loads((folder / "out" / "surface.json").read_text())["surface"]
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    found = {
        "size": size, "seconds": seconds, "processor_seconds": usage.ru_utime + usage.ru_stime,
        "megabytes": usage.ru_maxrss / 1024, "extracted_faces": record["extracted_faces"], "faces": record["faces"],
    }  # fmt: skip
    report(
        f"{size}³ voxels: {seconds:.1f} s, {found['processor_seconds']:.1f} s of processors, "
        f"{found['megabytes']:.0f} MB; {record['extracted_faces']:,} faces, {record['faces']:,} after simplification"
    )
    return found


if __name__ == "__main__":
    run_script(main)
