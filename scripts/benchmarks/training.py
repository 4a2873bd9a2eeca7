"""What the views of one frame are worth: a small network that is trained on nothing else finds held-out photographs.

It learns the surface's point for each cell of an image; PnP gives the pose. It trains on --views of the default
dataset, of datasets with other options (the light at the lens, unseen surface filled, the paper's vertex colours,
narrower and wider cones, colours of further frames), and on path-traced photographs at the poses of the default views,
the best that any view could teach. Scenes are the built-in sample with its film (path traced; photographs to train on
can be had of it alone), each --case, and bloster (real), of photographs up to 60° away from the frame. Trainings with
other --views, --steps or --seeds join the table; the chart shows errors relative to those on photographs.

With --spoilt a network also sees spoilt photographs, as in the topic registration, beside registration itself.

Needs PyTorch and onnx (pip install torch onnx). Writes a table, FILE.csv, with a row for each photograph and training,
FILE_bad.csv with the spoilt ones, and their charts; datasets go to a folder beside it, FILE/. Go on where it stopped
with the same command.
"""

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product
from operator import attrgetter
from pathlib import Path

import bpy
import numpy as np

from oneframe.case.case_file import read_case
from oneframe.case.loaded_case import load_case
from oneframe.errors import RunError
from oneframe.evaluation.conditions import current_conditions
from oneframe.images.pixel_values import to_uint8
from oneframe.learning.pose_network import PoseNetwork
from oneframe.learning.view_crops import ViewCrops
from oneframe.progress import Progress
from oneframe.reader import View
from oneframe.registration.further_frames import small_frame

from .alignment.registration_trials import RegistrationTrial, Scene
from .charts.pose_charts import training_chart
from .charts.registration_charts import bad_photographs_chart
from .figures import conditions_note, read_rows, write_rows
from .learning.bad_photographs import bad_photographs
from .learning.pose_trials import PoseTrial, Training, errors, known_views, photographs_of, summary
from .learning.training_scenes import (
    DATASETS,
    FRAMES,
    NEUTRAL,
    PHOTOGRAPHS,
    TrainingScene,
    bloster_scene,
    sample_scene,
)

ALL = [*DATASETS, FRAMES, PHOTOGRAPHS]
QUICK = {"views": 4, "steps": 2, "seeds": [0, 1], "spoilt": True, "datasets": [NEUTRAL]}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    parser.add_argument(
        "--case", metavar="FILE", nargs=2, type=Path, action="append", default=[],
        help="another scene: CASE.toml and its PHOTOGRAPHS.json, as for oneframe evaluate",
    )  # fmt: skip
    parser.add_argument("--bloster", metavar="DIR", type=Path, help="another scene: the photographs of bloster")
    parser.add_argument("--without-sample", action="store_true", help="leave the built-in sample case out")
    parser.add_argument("--views", metavar="N", type=int, default=800, help="to train on (default %(default)s)")
    parser.add_argument("--datasets", nargs="+", choices=ALL, default=ALL, metavar="NAME", help=" ".join(ALL))
    parser.add_argument("--steps", metavar="N", type=int, default=3000, help="of a training (default %(default)s)")
    parser.add_argument("--seeds", metavar="N", type=int, nargs="+", default=[0], help="of the trainings (default 0)")
    parser.add_argument("--spoilt", action="store_true", help="show spoilt photographs to the first network, too")


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Train and test; write the table after each training."""
    try:
        from oneframe.learning.coordinate_network import onnx_file, trained_network
    except ImportError:
        raise RunError("training: expected PyTorch and onnx; run pip install torch onnx and try again") from None
    finished = read_rows(arguments.out, PoseTrial)[0] if arguments.out.is_file() else []
    spoilt = read_rows(_bad(arguments.out), RegistrationTrial)[0] if _bad(arguments.out).is_file() else []
    conditions = current_conditions({"seeds": " ".join(map(str, arguments.seeds))}, blender=bpy.app.version_string)
    for scene in _scenes(arguments):
        loaded = load_case(read_case(scene.case))
        mesh = loaded.surface.mesh
        photographs = photographs_of(loaded, scene.photographs)
        for place, training in enumerate(_trainings(scene, arguments)):
            spoil = arguments.spoilt and not place and scene.name not in [trial.scene for trial in spoilt]
            if training in [trial.training for trial in finished] and not spoil:
                continue
            views = scene.dataset(training.dataset, training.views)[: training.views]
            rgb: Callable[[View], np.ndarray] = attrgetter("rgb")
            if training.dataset == PHOTOGRAPHS:
                rgb = scene.photographed(views, loaded.surface.mesh_from_model)
            crops = ViewCrops.of(views, rgb)
            begin = time.process_time()
            with Progress(training.steps, "steps", stream=sys.stderr) as progress:
                network = trained_network(crops, training.steps, training.seed, progress.advance)
            seconds = time.process_time() - begin
            record = crops.record(views, training.steps, training.seed)
            codes, trials = to_uint8(loaded.frame.image[loaded.frame.valid]), []
            found = PoseNetwork(onnx_file(network, record), str(training), codes)
            for photograph in photographs:
                pose = found.pose(to_uint8(photograph.image), photograph.camera)
                trials.append(PoseTrial(*training, seconds, photograph.path.name, *errors(pose, photograph, mesh)))
            finished = [trial for trial in finished if trial.training != training] + trials
            write_rows(arguments.out, finished, conditions)
            report(summary(trials))
            if spoil:
                own = Scene(
                    scene.name, scene.real, replace(loaded, frames=(small_frame(loaded.frame),)), tuple(photographs)
                )
                spoilt += bad_photographs(own, known_views(loaded), found, training.seed, quick=arguments.quick)
                write_rows(_bad(arguments.out), spoilt, conditions, "right")


def draw(out: Path) -> list[Path]:
    """Draw the table."""
    trials, conditions = read_rows(out, PoseTrial)
    charts = [training_chart(trials, conditions_note(conditions), out)]
    if _bad(out).is_file():
        charts.append(bad_photographs_chart(*read_rows(_bad(out), RegistrationTrial), _bad(out)))
    return charts


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
    for seed, dataset in product(arguments.seeds, filter(scene.offers, arguments.datasets)):
        yield Training(scene.name, dataset, arguments.views, arguments.steps, seed)
