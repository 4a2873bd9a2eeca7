"""Speed against accuracy: every configuration renders the same views with the whole command.

Scenes are the built-in sample case, each --case and bloster's photographs. PyVista and Cycles alone run in between.
Writes a table, FILE.csv, with a row for each point, and its chart. --light measures the light at the lens instead, on
the sample alone: processor time of its views without files, and how far they are off its photographs.
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import bpy

from oneframe.blender.render.engines import engine_named, keep_freed_memory
from oneframe.blender.sample.sample_case import HELD_OUT, write_sample_case
from oneframe.case.case_writer import write_case
from oneframe.errors import InputError, RunError
from oneframe.evaluation.conditions import current_conditions
from oneframe.files.temporary import temporary_folder
from oneframe.progress import Progress
from oneframe.sample.temporal_bone import sample_surface

from .charts.speed_accuracy_chart import speed_accuracy_chart
from .evaluation import lit_case
from .figures import conditions_note, read_rows, write_rows
from .published import bloster_cases
from .rendering.render_accuracy import JUDGED_VIEWS, converged_reference, measure_lights, measure_scene, scene_peers
from .rendering.render_scenes import RenderScene, case_scene
from .rendering.speed_accuracy import Configuration, SpeedPoint

CONFIGURATIONS = (
    Configuration(),
    Configuration("raster"),
    Configuration(samples=8),
    Configuration(colour="vertex"),
    Configuration(samples=4),
    Configuration(samples=16),
    Configuration(samples=8, colour="vertex"),
    Configuration(more={"unseen": "fill"}),
    Configuration("raster", more={"unseen": "fill"}),
    Configuration("eevee"),
    Configuration(mesh_px=0.1),
    Configuration(mesh_px=0.5),
    Configuration("raster", mesh_px=0.1),
    Configuration("raster", mesh_px=0.5),
    Configuration("raster", samples=8),
    Configuration(processes=1),
    Configuration("raster", processes=1),
)
FEW = CONFIGURATIONS[-2:]
"""What --quick measures."""
QUICK = {"rounds": 1, "views": 12, "along": 5}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    parser.add_argument(
        "--case", metavar="FILE", nargs="+", type=Path, action="append", default=[],
        help="another scene: CASE.toml and optionally its PHOTOGRAPHS.json, as for oneframe evaluate",
    )  # fmt: skip
    parser.add_argument("--bloster", metavar="DIR", type=Path, help="another scene: the photographs of bloster")
    parser.add_argument("--light", action="store_true", help="what the light at the lens costs and gives")
    parser.add_argument("--without-sample", action="store_true", help="leave the built-in sample case out")
    parser.add_argument("--rounds", metavar="N", type=int, default=2, help="alternating rounds (default %(default)s)")
    parser.add_argument("--views", metavar="N", type=int, default=96, help="of a scene (default %(default)s)")
    parser.add_argument(
        "--along", metavar="N", type=int, default=11,
        help="rays along a pixel's side of the reference, odd (default %(default)s)",
    )  # fmt: skip
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="seed of the poses (default 0)")


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Measure all scenes."""
    keep_freed_memory()
    configurations = usable(FEW if arguments.quick else CONFIGURATIONS, report)
    points = []
    with temporary_folder() as folder:
        for number, scene in enumerate(scenes(arguments, folder)):
            triangles = len(scene.loaded.surface.mesh.faces)
            report(f"{scene.name}: {scene.camera.width}x{scene.camera.height} px, {triangles:,} triangles")
            if arguments.light:
                with Progress(8 * arguments.rounds * len(scene.photographs), "views", stream=sys.stderr) as progress:
                    points += measure_lights(scene, arguments.rounds, progress.advance)
                continue
            run = folder / f"run-{number}"
            run.mkdir()
            try:
                peers = scene_peers(scene)
            except RunError as error:
                report(f"left out: {error}")
                peers = {}
            total = arguments.rounds * (len(configurations) + len(peers) + 1) + JUDGED_VIEWS
            with Progress(total, "measurements", stream=sys.stderr) as progress:
                reference = converged_reference(scene, arguments.along, progress.advance)
                points += measure_scene(
                    scene, reference, configurations, peers, run, arguments.rounds, progress.advance
                )
    measured = {"seed": arguments.seed, "rounds": arguments.rounds, "views": arguments.views}
    conditions = current_conditions({**measured, "reference rays": arguments.along**2}, blender=bpy.app.version_string)
    write_rows(arguments.out, points, conditions)


def draw(out: Path) -> list[Path]:
    """Draw the table."""
    points, conditions = read_rows(out, SpeedPoint)
    return [speed_accuracy_chart(points, conditions_note(conditions), out)]


def usable(configurations: Sequence[Configuration], report: Callable[[str], None]) -> list[Configuration]:
    """The configurations whose engine works on this machine."""
    missing = set()
    for engine in dict.fromkeys(configuration.engine for configuration in configurations):
        try:
            engine_named(engine).check()
        except InputError as error:
            report(f"left out: {error}")
            missing.add(engine)
    return [configuration for configuration in configurations if configuration.engine not in missing]


def scenes(arguments: argparse.Namespace, folder: Path) -> Iterator[RenderScene]:
    """Read or make the scenes."""
    cases: list[tuple[str, Path, Path | None]] = []
    if not arguments.without_sample:
        for _ in write_sample_case(folder / "sample", sample_surface()):
            pass
        path = folder / "sample" / "case.toml"
        write_case(path, lit_case(path))
        cases.append(("sample", path, folder / "sample" / HELD_OUT))
    for case, *photographs in arguments.case:
        cases.append((case.resolve().parent.name, case, photographs[0] if photographs else None))
    if arguments.bloster:
        # the finer mesh, as such views are made of surfaces from CT
        cases.append(("bloster", *bloster_cases(arguments.bloster, folder / "bloster", mesh="mesh_70k.ply")[0]))
    for case in cases:
        yield case_scene(*case, views=arguments.views, seed=arguments.seed)
