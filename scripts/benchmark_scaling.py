"""Measure what 100 000 views take up to 1 000 workers, with stand-ins for rendering, and model up to 10 000 workers.

    python scripts/benchmark_scaling.py --out FILE.json [--quick] [--only NAME ...] [--seed N] [--folder DIR] [--redraw]

dataset: a resume scan over finished views, writing the tables, and `oneframe check --fast`, on a folder that takes 4 GB
while it runs. engine: processor time and memory of scheduler and client, with simulated workers. agreement: the model's
time of small runs beside the engine's. model: efficiency against the number of workers, with the engine's measured
cost. Figures of an earlier run in FILE.json are kept where --only leaves them out. A chart is written next to it.
"""

import os
import sys
from pathlib import Path

# as render_dataset.py does, and before numpy is imported
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# the repository's root: scripts are run from a checkout
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import json
import shutil
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from multiprocessing import get_context
from typing import Any

import numpy as np

from pipeline.blender.command_line import ArgumentParser, run_script
from pipeline.cluster.simulated_workers import EngineRun, StandIn, run_engine
from pipeline.errors import InputError, RunError
from pipeline.evaluation.charts.page import chart_outputs, require_matplotlib
from pipeline.evaluation.charts.scaling_chart import scaling_charts
from pipeline.evaluation.conditions import Conditions, current_conditions
from pipeline.evaluation.scaling.cluster_model import Policy, run_model
from pipeline.evaluation.scaling.dataset_times import check_quickly, measured, scan, write_tables
from pipeline.evaluation.scaling.efficiency import SECONDS_PER_VIEW, WORKERS, ModelPoint, OrderCost, sweep
from pipeline.evaluation.scaling.finished_views import write_finished_views
from pipeline.files.content import read_content, write_bytes_atomically
from pipeline.files.kinds import Kind, json_object
from pipeline.files.outputs import Output, check_outputs, made_folder, writing
from pipeline.files.tables import parsed_json
from pipeline.progress import Progress

NAMES = ("dataset", "engine", "agreement", "model")
VIEWS = 100_000
TOLERANCE = 0.1
"""The model's time of a run may differ from the engine's by this part."""
FIGURES = Kind("the figures of this script", lambda data: any(json_object(name)(data) for name in (*NAMES, "views")))

Figures = dict[str, Any]


def main(argv: Sequence[str]) -> int:
    parser = ArgumentParser(prog="benchmark_scaling.py", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", metavar="FILE.json", type=Path, required=True, help="the figures; the chart beside it")
    parser.add_argument("--only", nargs="+", choices=NAMES, default=NAMES, metavar="NAME", help=" ".join(NAMES))
    parser.add_argument("--quick", action="store_true", help="3000 views, few workers: does it run?")
    parser.add_argument("--seed", type=int, default=0, help="of the model, and of the agreement")
    parser.add_argument("--folder", metavar="DIR", type=Path, help="where the finished views are put for a while")
    parser.add_argument("--redraw", action="store_true", help="measure nothing; draw the chart again from --out")
    arguments = parser.parse(argv)
    require_matplotlib()
    named = {"figures": arguments.out} if arguments.redraw else {}
    check_outputs([*([] if named else [Output(arguments.out, FIGURES)]), *chart_outputs(arguments.out)], named)
    figures = read_figures(arguments.out) if arguments.redraw or arguments.out.exists() else {}
    if not arguments.redraw:
        figures["conditions"] = asdict(current_conditions({"seed": arguments.seed, "quick": arguments.quick}))
        figures["views"] = views = 3000 if arguments.quick else VIEWS
        measures: dict[str, Callable[[], object]] = {
            "dataset": lambda: measure_dataset(arguments.folder, views),
            "engine": lambda: measure_engine(views, (1, 10) if arguments.quick else (1, 10, 100, 1000)),
            "agreement": lambda: measure_agreement((2, 10) if arguments.quick else (2, 10, 50), arguments.seed),
            "model": lambda: model(views, figures.get("engine", []), arguments.seed, quick=arguments.quick),
        }
        for name in NAMES:
            if name in arguments.only:
                print(f"{name}:", flush=True)
                figures[name] = measures[name]()
                with writing(made_folder(arguments.out)):
                    write_bytes_atomically(arguments.out, (json.dumps(figures, indent=1) + "\n").encode())
    if "model" in figures:
        draw(figures, arguments.out)
    return 0


def read_figures(path: Path) -> Figures:
    """The figures of an earlier run."""
    content = parsed_json(read_content(path, "figures of benchmark_scaling.py"), str(path))
    if not isinstance(content, dict) or "conditions" not in content:
        raise InputError(f"{path}: expected figures of benchmark_scaling.py, found something else; choose another file")
    return content


def measure_dataset(folder: Path | None, views: int) -> Figures:
    """Time and memory of a resume scan, of the tables, and of the quick check; of the tables also for a tenth."""
    place = Path(tempfile.mkdtemp(prefix="oneframe-scaling-", dir=folder))
    figures: Figures = {}
    try:
        for count in (views // 10, views):
            root = place / str(count)
            with Progress(count, "finished views written", stream=sys.stderr) as progress:
                for written in write_finished_views(root, count, processes=os.cpu_count() or 1):
                    for _ in range(written):
                        progress.advance()
            figures[str(count)] = {}
            for name, step in (("scan", scan), ("tables", write_tables), ("check", check_quickly)):
                effort = measured(step, root, count)
                figures[str(count)][name] = asdict(effort)
                print(
                    f"  {count} views, {name}: {effort.seconds:.1f} s, {effort.processor_seconds:.1f} s of CPU, "
                    f"{effort.peak_mb:.0f} MB",
                    flush=True,
                )
    finally:
        shutil.rmtree(place)
    return figures


def measure_engine(views: int, workers: Sequence[int]) -> list[Figures]:
    """What orders cost at each number of simulated workers."""
    found = []
    with Progress(len(workers), "numbers of workers", stream=sys.stderr) as progress:
        for number in workers:
            run = _engine(number, StandIn(views))
            found.append(asdict(run) | {"order_seconds": run.order_seconds})
            progress.advance()
            print(
                f"  {number} workers, {run.orders} orders, {run.seconds:.0f} s: an order takes "
                f"{run.client_seconds / run.orders:.2g} s of the client, {run.scheduler_seconds / run.orders:.2g} s of "
                "the scheduler; "
                f"{run.client_mb:.0f} and {run.scheduler_mb:.0f} MB",
                flush=True,
            )
    return found


def measure_agreement(workers: Sequence[int], seed: int) -> list[Figures]:
    """The time of small runs whose views really take their time, beside the model's.

    Raises
    ------
    RunError
        They differ by more than :data:`TOLERANCE`. Where a second order waits at each worker, the model is an upper
        bound: Dask sometimes takes it away from a slow worker again, the model never.
    """
    found: list[Figures] = []
    for number in workers:
        for held in (1, 2):
            stand_in = StandIn(
                # an order takes a fifteenth of the usual time, and so does a view
                100 * number, 0.067, True, 0.2, 0.1, 5.0, 0.3, target_seconds=1.0, seed=seed, orders_held=held,
            )  # fmt: skip
            run = _engine(number, stand_in)
            cluster = stand_in.modelled(number, order_seconds=run.order_seconds)
            modelled = run_model(
                cluster, Policy.CHUNKS, stand_in.views, stand_in.seconds_per_view, np.random.default_rng(seed)
            )
            found.append(
                {"workers": number, "orders_held": held, "engine_s": run.seconds, "model_s": modelled.seconds,
                 "engine_orders": run.orders, "model_orders": modelled.orders}
            )  # fmt: skip
            print(
                f"  {number} workers, {held} orders held: engine {run.seconds:.2f} s, model {modelled.seconds:.2f} s",
                flush=True,
            )
            ratio = modelled.seconds / run.seconds
            if ratio < 1 - TOLERANCE or (held == 1 and ratio > 1 + TOLERANCE):
                raise RunError(
                    f"{number} workers: expected engine and model to agree within {TOLERANCE:.0%}, found {found[-1]}; "
                    "repeat it on a machine that does nothing else"
                )
    return found


def _engine(workers: int, stand_in: StandIn) -> EngineRun:
    # a client of its own, for its memory
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(run_engine, workers, stand_in).result()


def model(views: int, engine: Sequence[Figures], seed: int, *, quick: bool) -> list[Figures]:
    """Efficiency at every number of workers."""
    if not engine:
        raise InputError("model: expected the engine's figures, found none; measure them before, or leave out --only")
    cost = OrderCost(tuple(run["workers"] for run in engine), tuple(run["order_seconds"] for run in engine))
    numbers, targets = ((1, 10, 100), (15.0,)) if quick else (WORKERS, (15.0, 60.0))
    total = len(SECONDS_PER_VIEW) * len(numbers) * (2 + 2 * len(targets))
    points = []
    with Progress(total, "points of the model", stream=sys.stderr) as progress:
        for point in sweep(views, cost, seed=seed, workers=numbers, targets=targets, runs=1 if quick else 3):
            points.append(asdict(point))
            progress.advance()
    return points


def draw(figures: Figures, out: Path) -> None:
    """Draw the chart beside the figures."""
    costs = [
        (run["workers"], 1000 * run["client_seconds"] / run["orders"], 1000 * run["scheduler_seconds"] / run["orders"])
        for run in figures["engine"]
    ]
    points = [ModelPoint(**point) for point in figures["model"]]
    for path in scaling_charts(points, costs, Conditions(**figures["conditions"]).short(), out):
        print(path)


if __name__ == "__main__":
    run_script(main)
