"""What the views of one frame are worth: a small network that is trained on nothing else finds held-out photographs.

It learns the surface's point for each cell of an image; PnP gives the pose, and render and flow refine it. It trains on
the first --views of the default dataset, then at --compared views on datasets rendered with other options: unseen
surface filled, the paper's vertex colours, plain shading without the frame, narrower and wider cones, and colours of
further frames. All trainings take as many --steps, and one of most views takes --longest. Scenes are the built-in
sample with its film (path traced), each --case, and bloster (real), of photographs up to 60° away from the frame.

The longest training's network also sees spoilt photographs, as in the topic registration, beside registration itself.

Needs PyTorch (pip install torch). Writes a table, FILE.csv, with a row for each photograph and training, FILE_bad.csv
with the spoilt ones, and their charts; datasets go to a folder beside it, FILE/. Go on where it stopped with the same
command.
"""

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path

import bpy

from oneframe.case.case_file import read_case
from oneframe.case.loaded_case import load_case
from oneframe.errors import RunError
from oneframe.evaluation.conditions import current_conditions
from oneframe.progress import Progress

from .alignment.registration_trials import RegistrationTrial, Scene, small
from .charts.pose_charts import training_chart
from .charts.registration_charts import bad_photographs_chart
from .figures import conditions_note, read_rows, write_rows
from .learning.bad_photographs import bad_photographs
from .learning.pose_trials import PoseTrial, Training, errors, known_views, photographs_of, refined, summary
from .learning.training_scenes import DATASETS, FRAMES, NEUTRAL, PLAIN, TrainingScene, bloster_scene, sample_scene
from .learning.view_crops import ViewCrops

QUICK = {"views": [2, 4], "compared": 4, "steps": 2, "longest": 4, "datasets": [NEUTRAL, PLAIN]}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    parser.add_argument(
        "--case", metavar="FILE", nargs=2, type=Path, action="append", default=[],
        help="another scene: CASE.toml and its PHOTOGRAPHS.json, as for oneframe evaluate",
    )  # fmt: skip
    parser.add_argument("--bloster", metavar="DIR", type=Path, help="another scene: the photographs of bloster")
    parser.add_argument("--without-sample", action="store_true", help="leave the built-in sample case out")
    parser.add_argument("--views", metavar="N", type=int, nargs="+", default=[50, 200, 800, 2000])
    parser.add_argument("--compared", metavar="N", type=int, default=800, help="views at which options are compared")
    parser.add_argument("--datasets", nargs="+", choices=[*DATASETS, FRAMES], default=[*DATASETS, FRAMES])
    parser.add_argument("--steps", metavar="N", type=int, default=3000, help="of a training (default %(default)s)")
    parser.add_argument("--longest", metavar="N", type=int, default=12000, help="of the longest (default %(default)s)")
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="seed of the trainings (default 0)")


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Train and test; write the table after each training."""
    try:
        from .learning.coordinate_network import network_pose, trained_network
    except ImportError:
        raise RunError("training: expected PyTorch, it is not installed; run pip install torch and try again") from None
    finished = read_rows(arguments.out, PoseTrial)[0] if arguments.out.is_file() else []
    spoilt = read_rows(_bad(arguments.out), RegistrationTrial)[0] if _bad(arguments.out).is_file() else []
    conditions = current_conditions({"seed": arguments.seed}, blender=bpy.app.version_string)
    for scene in _scenes(arguments):
        loaded = load_case(read_case(scene.case))
        mesh = loaded.surface.mesh
        photographs, known = photographs_of(loaded, scene.photographs), known_views(loaded)
        for training in _trainings(scene, arguments):
            spoil = training.steps == arguments.longest and scene.name not in [trial.scene for trial in spoilt]
            if training in [trial.training for trial in finished] and not spoil:
                continue
            views = scene.dataset(training.dataset, training.views)
            crops = ViewCrops.of(views, training.views, mesh, plain=training.dataset == PLAIN)
            begin = time.process_time()
            with Progress(training.steps, "steps", stream=sys.stderr) as progress:
                network = trained_network(crops, training.steps, arguments.seed, progress.advance)
            seconds = time.process_time() - begin
            camera = loaded.case.camera.resized(*views.size_wh)
            pose_by, trials = partial(network_pose, network, crops, camera), []
            for photograph in photographs:
                pose = pose_by(photograph.image)
                both = (errors(each, photograph, mesh) for each in (pose, refined(known, photograph, pose)))
                trials.append(PoseTrial(*training, seconds, photograph.path.name, *chain(*both)))
            finished = [trial for trial in finished if trial.training != training] + trials
            write_rows(arguments.out, finished, conditions)
            report(summary(trials))
            if spoil:
                own = Scene(scene.name, scene.real, replace(loaded, frames=(small(loaded.frame),)), tuple(photographs))
                spoilt += bad_photographs(own, known, pose_by, arguments.seed, quick=arguments.quick)
                write_rows(_bad(arguments.out), spoilt, conditions, "right")


def draw(out: Path) -> list[Path]:
    """Draw the table."""
    trials, conditions = read_rows(out, PoseTrial)
    bad = read_rows(_bad(out), RegistrationTrial)
    return [training_chart(trials, conditions_note(conditions), out), bad_photographs_chart(*bad, _bad(out))]


def _bad(out: Path) -> Path:
    return out.with_name(f"{out.stem}_bad.csv")


def _scenes(arguments: argparse.Namespace) -> Iterator[TrainingScene]:
    data = arguments.out.with_suffix("")
    if not arguments.without_sample:
        yield sample_scene(data / "sample")
    for case, photographs in arguments.case:
        name = case.resolve().parent.name
        yield TrainingScene(name, case, photographs, data / name)
    if arguments.bloster:
        yield bloster_scene(arguments.bloster, data / "bloster")


def _trainings(scene: TrainingScene, arguments: argparse.Namespace) -> Iterator[Training]:
    for count in sorted({*arguments.views, arguments.compared}):
        yield Training(scene.name, NEUTRAL, count, arguments.steps)
    yield Training(scene.name, NEUTRAL, max(arguments.views), arguments.longest)
    for dataset in arguments.datasets:
        if dataset != NEUTRAL and (dataset != FRAMES or FRAMES in scene.more):
            yield Training(scene.name, dataset, arguments.compared, arguments.steps)
