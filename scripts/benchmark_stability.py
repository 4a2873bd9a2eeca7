"""Measure where methods fail, past the breaking point, and what the software answers there.

    python scripts/benchmark_stability.py --out FOLDER [--only TOPIC ...] [--seed N] [--quick] [--redraw]

Topics: pnp (poses from landmarks, beside OpenCV's solvers), refinement (on the built-in sample case), colouring, camera
(rendered pixels against K), renderers, sampling. Each writes FOLDER/stability_TOPIC.csv, one row a setting: trials,
wrong results, wrong results without a word, answers (works, warns, falls back, refuses), errors and the software's
limit; and its chart as SVG and PNG. --redraw draws the charts again from the tables. Times and memory are this
machine's.
"""

import os
import sys
from pathlib import Path

# before numpy is imported: the matrices are small, so BLAS threads cost more than they save
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# the repository's root: scripts are run from a checkout
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from collections.abc import Iterator, Sequence

import bpy
import cv2

from pipeline.blender.command_line import ArgumentParser, run_script
from pipeline.blender.evaluation import stability_camera, stability_colouring, stability_renderers
from pipeline.blender.process import own_output
from pipeline.blender.render.engines import keep_freed_memory
from pipeline.blender.sample.sample_case import write_sample_case
from pipeline.evaluation.charts.page import require_matplotlib
from pipeline.evaluation.charts.stability_charts import draw_topic, topic_outputs
from pipeline.evaluation.conditions import current_conditions
from pipeline.evaluation.scenes.refinement_scenes import case_scene
from pipeline.evaluation.stability import landmarks, refinement, sampling
from pipeline.evaluation.stability.cells import Task, cells_kind, read_cells, write_cells
from pipeline.files.outputs import check_outputs, companion, made_folder, writing
from pipeline.files.temporary import temporary_folder
from pipeline.progress import Progress
from pipeline.sample.temporal_bone import sample_surface

TOPICS = (
    landmarks.TOPIC,
    refinement.TOPIC,
    stability_colouring.TOPIC,
    stability_camera.TOPIC,
    stability_renderers.TOPIC,
    sampling.TOPIC,
)


def main(argv: Sequence[str]) -> int:
    parser = ArgumentParser(prog="benchmark_stability.py", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", metavar="FOLDER", type=Path, required=True)
    parser.add_argument("--only", nargs="+", choices=TOPICS, default=TOPICS, metavar="TOPIC", help=" ".join(TOPICS))
    parser.add_argument("--seed", type=int, default=0, help="of all random trials; rows depend on nothing else")
    parser.add_argument("--quick", action="store_true", help="few values and trials: does it run?")
    parser.add_argument("--redraw", action="store_true", help="measure nothing; draw the charts again from --out")
    arguments = parser.parse(argv)
    if arguments.seed < 0:
        parser.error("expected --seed from 0")
    require_matplotlib()
    tables = {topic: arguments.out / f"stability_{topic}.csv" for topic in TOPICS if topic in arguments.only}
    charts = [output for topic, table in tables.items() for output in topic_outputs(topic, table)]
    if arguments.redraw:
        check_outputs(charts, {f"table of {topic}": table for topic, table in tables.items()})
    else:
        kinds = {topic: cells_kind(topic) for topic in tables}
        own = [companion(table, kinds[topic], kinds[topic].is_of) for topic, table in tables.items()]
        check_outputs([*own, *charts], {})
    output = own_output()
    for topic, table in tables.items():
        if not arguments.redraw:
            measure(topic, table, arguments.seed, quick=arguments.quick)
        for path in draw_topic(topic, *read_cells(table), table):
            output.write(f"{path}\n")
            output.flush()
    return 0


def measure(topic: str, table: Path, seed: int, *, quick: bool) -> None:
    """Measure a topic and write its table."""
    cv2.setNumThreads(1)
    keep_freed_memory()
    configuration = {"topic": topic, "seed": seed, "quick": quick}
    conditions = current_conditions(configuration, blender=bpy.app.version_string)
    cells = []
    with temporary_folder() as folder:
        tasks = list(tasks_of(topic, folder, seed, quick=quick))
        with Progress(len(tasks), f"measurements of {topic}", stream=sys.stderr) as progress:
            for task in tasks:
                cells += task()
                progress.advance()
    with writing(made_folder(table)):
        write_cells(table, cells, conditions)


def tasks_of(topic: str, folder: Path, seed: int, *, quick: bool) -> Iterator[Task]:
    """The measurements of a topic; ``folder`` is for temporary files."""
    if topic == refinement.TOPIC:
        for _ in write_sample_case(folder, sample_surface(), held_out=False):
            pass
        return refinement.tasks(case_scene(folder / "case.toml"), seed, quick=quick)
    if topic == landmarks.TOPIC:
        return landmarks.tasks(seed, quick=quick)
    if topic == sampling.TOPIC:
        return sampling.tasks(seed, quick=quick)
    if topic == stability_colouring.TOPIC:
        return stability_colouring.tasks(quick=quick)
    if topic == stability_camera.TOPIC:
        return stability_camera.tasks(folder, quick=quick)
    return stability_renderers.tasks(folder, quick=quick)


if __name__ == "__main__":
    run_script(main)
