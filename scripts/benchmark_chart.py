"""Measure speed against accuracy, and draw one against the other.

    python scripts/benchmark_chart.py --out FILE.csv [--quick] [--case CASE.toml [PHOTOGRAPHS.json]]... [--bloster DIR]

Scenes are the built-in sample case, each --case and bloster's photographs. In each, every configuration renders the
same views with the whole command; PyVista and Cycles alone run in between. --redraw draws the chart again.
"""

import os
import sys
from pathlib import Path

# as render_dataset.py does, and before numpy is imported
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# the repository's root: scripts are run from a checkout
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import argparse
import tempfile
from collections.abc import Callable, Sequence
from typing import TextIO

import bpy

from pipeline.blender.command_line import ArgumentParser, run_script
from pipeline.blender.evaluation.render_accuracy import JUDGED_VIEWS, SceneTrials, converged_reference, pyvista_peers
from pipeline.blender.evaluation.render_scenes import RenderScene, case_scene, write_bloster
from pipeline.blender.process import own_output
from pipeline.blender.render.engines import check_engine, keep_freed_memory
from pipeline.blender.sample.sample_case import HELD_OUT, write_sample_case
from pipeline.errors import InputError, RunError
from pipeline.evaluation.charts.page import chart_outputs, require_matplotlib
from pipeline.evaluation.charts.speed_accuracy_chart import speed_accuracy_charts
from pipeline.evaluation.conditions import current_conditions
from pipeline.evaluation.measured_table import write_table
from pipeline.evaluation.trials.speed_accuracy import COLUMNS, POINTS, Configuration, SpeedPoint, read_points
from pipeline.files.outputs import Output, check_outputs, made_folder, writing
from pipeline.progress import Progress
from pipeline.sample.temporal_bone import sample_surface

RENDER_SCRIPT = Path(__file__).with_name("render_dataset.py")
QUICK = (
    Configuration(),
    Configuration("raster"),
    Configuration(samples=8),
    Configuration(colour="vertex"),
)
"""What --quick measures."""
CONFIGURATIONS = (
    *QUICK,
    Configuration(colour="texture"),
    Configuration(samples=4),
    Configuration(samples=16),
    Configuration(samples=8, colour="texture"),
    Configuration(samples=8, colour="vertex"),
    Configuration(more={"unseen": "fill"}),
    Configuration("raster", more={"unseen": "fill"}),
    Configuration("eevee"),
    Configuration("workbench", colour="vertex"),
    Configuration(mesh_px=0.1),
    Configuration(mesh_px=0.5),
    Configuration("raster", mesh_px=0.1),
    Configuration("raster", mesh_px=0.5),
    Configuration(more={"quality": "auto"}),
    Configuration(more={"quality": "draft"}),
    Configuration(samples=8, more={"quality": "auto"}),
    Configuration(processes=1),
    Configuration("raster", processes=1),
)


def main(argv: Sequence[str]) -> int:
    parser = ArgumentParser(prog="benchmark_chart.py", description=(__doc__ or "").partition("\n")[0])
    add_arguments(parser)
    arguments = parser.parse(argv)
    if arguments.rounds is not None and arguments.rounds < 1:
        parser.error(f"expected --rounds from 1, found {arguments.rounds}")
    if any(len(case) > 2 for case in arguments.case):
        parser.error("expected --case CASE.toml [PHOTOGRAPHS.json], found more files")
    if arguments.without_sample and not (arguments.case or arguments.bloster or arguments.redraw):
        parser.error("expected --case or --bloster with --without-sample, found neither")
    require_matplotlib()
    inputs = {"table": arguments.out} if arguments.redraw else {}
    inputs |= {f"case {number}": case[0] for number, case in enumerate(arguments.case, start=1)}
    check_outputs(
        [*([] if arguments.redraw else [Output(arguments.out, POINTS)]), *chart_outputs(arguments.out)], inputs
    )
    stream = own_output()
    if not arguments.redraw:
        rounds, views, along = (1, 12, 5) if arguments.quick else (2, 24, 11)
        rounds = arguments.rounds or rounds
        conditions = current_conditions(
            {"seed": arguments.seed, "rounds": rounds, "views": views, "reference rays": along * along},
            blender=bpy.app.version_string,
        )
        points = measure(arguments, rounds, views, along, stream)
        with writing(made_folder(arguments.out)):
            write_table(arguments.out, COLUMNS, [point.row() for point in points], conditions)
    points, lines = read_points(arguments.out)
    for path in speed_accuracy_charts(points, small_print(lines), arguments.out):
        stream.write(f"{path}\n")
    return 0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("--out", metavar="FILE.csv", type=Path, required=True, help="table; the chart goes next to it")
    parser.add_argument(
        "--case", metavar="FILE", nargs="+", type=Path, action="append", default=[],
        help="another scene: CASE.toml and optionally its PHOTOGRAPHS.json, as for compare_views.py",
    )  # fmt: skip
    parser.add_argument("--bloster", metavar="DIR", type=Path, help="another scene: the photographs of bloster")
    parser.add_argument("--without-sample", action="store_true", help="leave the built-in sample case out")
    parser.add_argument("--rounds", metavar="N", type=int, help="alternating rounds (default 2; 1 with --quick)")
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="seed of the poses (default 0)")
    parser.add_argument("--quick", action="store_true", help="few configurations and views, one round")
    parser.add_argument("--redraw", action="store_true", help="measure nothing; draw the chart again from --out")


def measure(arguments: argparse.Namespace, rounds: int, views: int, along: int, stream: TextIO) -> list[SpeedPoint]:
    """Measure all scenes."""

    def report(text: str) -> None:
        stream.write(text + "\n")
        stream.flush()

    keep_freed_memory()
    configurations = usable(QUICK if arguments.quick else CONFIGURATIONS, report)
    points = []
    with tempfile.TemporaryDirectory(prefix="oneframe-chart-") as name:
        for scene in scenes(arguments, Path(name), views):
            triangles = len(scene.loaded.mesh.faces)
            report(f"{scene.name}: {scene.camera.width}x{scene.camera.height} px, {triangles:,} triangles")
            points += measure_scene(
                scene, configurations, made_folder(Path(name) / "run" / "x").parent, rounds, along, report, stream
            )
    return points


def usable(configurations: Sequence[Configuration], report: Callable[[str], None]) -> list[Configuration]:
    """The configurations whose engine works on this machine."""
    missing = set()
    for engine in dict.fromkeys(configuration.engine for configuration in configurations):
        try:
            check_engine(engine)
        except InputError as error:
            report(f"left out: {error}")
            missing.add(engine)
    return [configuration for configuration in configurations if configuration.engine not in missing]


def scenes(arguments: argparse.Namespace, folder: Path, views: int) -> list[RenderScene]:
    """Read or make the scenes."""
    cases: list[tuple[str, Path, Path | None]] = []
    if not arguments.without_sample:
        list(write_sample_case(folder / "sample", sample_surface()))
        cases.append(("sample", folder / "sample" / "case.toml", folder / "sample" / HELD_OUT))
    cases += [(case[0].resolve().parent.name, case[0], case[1] if len(case) > 1 else None) for case in arguments.case]
    if arguments.bloster:
        cases.append(("bloster", *write_bloster(arguments.bloster, folder / "bloster")))
    return [case_scene(*case, views=views, seed=arguments.seed) for case in cases]


def measure_scene(
    scene: RenderScene,
    configurations: Sequence[Configuration],
    folder: Path,
    rounds: int,
    along: int,
    report: Callable[[str], None],
    stream: TextIO,
) -> list[SpeedPoint]:
    """Measure one scene in alternating rounds."""
    try:
        peers = pyvista_peers(scene)
    except RunError as error:
        report(f"left out: {error}")
        peers = {}
    total = rounds * (len(configurations) + len(peers) + 1) + JUDGED_VIEWS
    with Progress(total, "measurements", stream=stream) as progress:
        reference = converged_reference(scene, along, progress.advance)
        with SceneTrials(scene, reference, folder, RENDER_SCRIPT) as trials:
            for number in range(rounds):
                judge = number == rounds - 1
                for name, render in peers.items():
                    trials.run_peer(name, render, judge=judge)
                    progress.advance()
                trials.run_bare()
                progress.advance()
                for configuration in configurations:
                    trials.run(configuration, judge=judge)
                    progress.advance()
            return trials.points()


def small_print(conditions: Sequence[str]) -> str:
    """Machine and versions from a table's conditions."""
    parts = dict(line.partition(": ")[::2] for line in conditions)
    versions = [part for part in parts.get("versions", "").split(", ") if part.startswith(("OneFrame", "Blender"))]
    return "; ".join(
        part for part in (parts.get("machine", ""), ", ".join(versions), parts.get("measured", "")) if part
    )


if __name__ == "__main__":
    run_script(main)
