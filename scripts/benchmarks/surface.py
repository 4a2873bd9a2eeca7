"""The surface from CT: errors against analytic surfaces beside scikit-image's, and a whole run.

The whole run is `oneframe surface` with default options on a synthetic CT of --whole voxels a side (0: none), in a
process of its own: seconds of the clock and of processors, and the largest memory.
"""

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

from oneframe.errors import RunError
from oneframe.files.temporary import temporary_folder

from .figures import write_figures
from .surface_accuracy import measure_shapes, write_synthetic_bone

SPACING_MM = 0.4
QUICK = {"size": 160, "rounds": 1, "whole": 96}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    parser.add_argument("--size", metavar="N", type=int, default=200, help="voxels a side of the shapes, from 160")
    parser.add_argument("--rounds", metavar="N", type=int, default=3)
    parser.add_argument(
        "--whole", metavar="N", type=int, default=512, help="voxels a side of the whole run, 0 for none"
    )


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Measure the shapes, then the whole run."""
    shapes = measure_shapes(arguments.size, arguments.rounds, report)
    figures: dict[str, object] = {
        "machine": {"processors": os.cpu_count(), "python": platform.python_version(), "numpy": np.__version__},
        "size": arguments.size, "rounds": arguments.rounds, "shapes": shapes,
    }  # fmt: skip
    if arguments.whole:
        figures["whole"] = whole_run(arguments.whole, report)
    write_figures(arguments.out, figures)


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
        line = [
            sys.executable,
            "-m",
            "oneframe.commands",
            "surface",
            str(folder / "ct.mha"),
            "--out",
            str(folder / "out"),
        ]
        ended = subprocess.run(line, capture_output=True, text=True, check=False)
        seconds = time.monotonic() - begin
        if ended.returncode:
            raise RunError(f"oneframe surface: expected a surface, it failed: {ended.stderr.strip()[-300:]}")
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
