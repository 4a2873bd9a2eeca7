"""Where methods fail, past the breaking point, and what the software answers there.

Topics: pnp (poses from landmarks, beside OpenCV's solvers), refinement (of the built-in sample case), colouring,
camera (rendered pixels against K).
Each writes PATH/stability_TOPIC.csv, one row a setting: trials, wrong results, wrong results without a word, answers
(works, warns, falls back, refuses), errors and the software's limit; and its chart.
"""

import argparse
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import bpy
import cv2

from oneframe.blender.render.engines import keep_freed_memory
from oneframe.blender.sample.sample_case import write_sample_case
from oneframe.evaluation.conditions import current_conditions
from oneframe.files.temporary import temporary_folder
from oneframe.progress import Progress
from oneframe.sample.temporal_bone import sample_surface

from .alignment.refinement_scenes import case_scene
from .charts.stability_charts import CHARTS
from .figures import read_rows, write_rows
from .sweeps import camera, colouring, landmarks, refinement
from .sweeps.cells import Cell, Task

QUICK: dict[str, object] = {}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    parser.add_argument("--only", nargs="+", choices=CHARTS, default=CHARTS, metavar="TOPIC", help=" ".join(CHARTS))
    parser.add_argument("--seed", type=int, default=0, help="of all random trials; rows depend on nothing else")


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Measure topics, and write their tables."""
    cv2.setNumThreads(1)
    keep_freed_memory()
    for topic in arguments.only:
        configuration = {"topic": topic, "seed": arguments.seed, "quick": arguments.quick}
        conditions = current_conditions(configuration, blender=bpy.app.version_string)
        cells: list[Cell] = []
        with temporary_folder() as folder:
            tasks = list(tasks_of(topic, folder, arguments))
            with Progress(len(tasks), f"measurements of {topic}", stream=sys.stderr) as progress:
                for task in tasks:
                    cells += task()
                    progress.advance()
        write_rows(arguments.out / f"stability_{topic}.csv", cells, conditions, "answer")


def draw(out: Path) -> list[Path]:
    """Draw all tables of a folder."""
    tables = {topic: out / f"stability_{topic}.csv" for topic in CHARTS}
    return [
        path
        for topic, table in tables.items()
        if table.exists()
        for path in CHARTS[topic](*read_rows(table, Cell), table)
    ]


def tasks_of(topic: str, folder: Path, arguments: argparse.Namespace) -> Iterator[Task]:
    """The measurements of a topic; ``folder`` is for temporary files."""
    seed, quick = arguments.seed, arguments.quick
    if topic == refinement.TOPIC:
        for _ in write_sample_case(folder, sample_surface(), held_out=False):
            pass
        yield from refinement.tasks(case_scene(folder / "case.toml"), seed, quick=quick)
    elif topic == landmarks.TOPIC:
        yield from landmarks.tasks(seed, quick=quick)
    elif topic == colouring.TOPIC:
        yield from colouring.tasks(quick=quick)
    else:
        yield from camera.tasks(folder, quick=quick)
