"""The surface corrected by frames: the sample's made wrong in five ways, and its true one, over several seeds.

The seed moves place, size and sign of what is wrong, and the frames that are taken of the film. Frames are registered
to the wrong surface, which is corrected and compared with the true one: errors, what is confirmed, views beside frames
that were left out, and poses registered again. --bones: temporal bones drilled by one plan, their surface by another.
--bloster: photographs of a cushion, whose true surface is not known: views beside photographs left out. Writes, in
PATH, correction.csv, a row for each corrected surface, correction.json, means with 95 % intervals over seeds, and a
chart.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, astuple, fields, replace
from pathlib import Path

import bpy
import cv2
import numpy as np

from oneframe.blender.render.engines import keep_freed_memory
from oneframe.blender.sample.sample_case import FILM, write_sample_case, write_sample_film
from oneframe.case.case_file import read_case
from oneframe.case.frame import PosedFrame, load_posed_frame
from oneframe.case.loaded_case import load_case
from oneframe.evaluation.conditions import current_conditions
from oneframe.evaluation.scores.mean_intervals import MeanInterval, Resampling
from oneframe.files.temporary import temporary_folder
from oneframe.registration.pose_list import read_photographs
from oneframe.registration.register_frames import CaseRegistrar, small_frame
from oneframe.sample.film import disturbance, film_poses
from oneframe.sample.temporal_bone import MICROSCOPE, SPACING_MM, sample_surface
from oneframe.surface.deviation import deviation
from oneframe.surface_correction.correct_surface import LONGER_SIDE_PX

from .alignment.bone_photographs import misdrilled_bones
from .charts.correction_chart import correction_chart
from .evaluation import lit_case
from .figures import read_rows, write_figures, write_rows
from .published import CaseFiles, bloster_cases
from .sweeps.surface_correction import (
    TRUE,
    WRONG,
    CorrectionTrial,
    FilmedScene,
    correction_trial,
    wrong_surface,
)

TABLE, SUMMARY = "correction.csv", "correction.json"
QUICK = {"seeds": [0], "surfaces": [WRONG[0]], "width": 160, "spacing_mm": 0.6}
STEP, LEFT_OUT = 4, 12
"""Every fourth frame of the film is registered; every twelfth, between them, is compared with views if it is clear."""
BONE_PHOTOGRAPHS, BLOSTER_PHOTOGRAPHS = slice(2, None, 5), (slice(1, None, 6), slice(3, None, 6), slice(5, None, 6))
"""Photographs of a bone that are compared with views, and ways to choose bloster's."""
COLUMNS = {
    "changed, before": ("before", "before_95"),
    "after": ("changed", "changed_95"),
    "elsewhere": ("elsewhere", "elsewhere_95"),
    "of the changed confirmed": ("confirmed_changed",),
    "of the wrong confirmed": ("passed",),
    "said by registration": ("said",),
    "within two deviations": ("within",),
    "SSIM: wrong, corrected, true": ("ssim_before", "ssim", "ssim_true"),
    "of what is confirmed: corrected, true": ("ssim_confirmed", "ssim_confirmed_true"),
    "poses, px: before, after": ("px_before", "px"),
}
"""Of the table in Markdown, and what stands in each."""
HEAD = f"| data | surface | {' | '.join(COLUMNS)} |\n|{(2 + len(COLUMNS)) * '---|'}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    parser.add_argument("--seeds", metavar="N", nargs="+", type=int, default=[10, 11, 12], help="default 10 11 12")
    parser.add_argument("--surfaces", nargs="+", choices=(TRUE, *WRONG), default=(TRUE, *WRONG), help="of the sample")
    parser.add_argument("--width", metavar="PX", type=int, default=MICROSCOPE.width, help="of the sample's frame")
    parser.add_argument("--spacing-mm", metavar="MM", type=float, default=SPACING_MM, help="of the sample's surface")
    parser.add_argument("--no-sample", action="store_true", help="leave out the sample case")
    parser.add_argument("--bones", metavar="FOLDER", type=Path, help="CTs and labels of temporal bones")
    parser.add_argument("--bloster", metavar="FOLDER", type=Path, help="photographs of a cushion")


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Correct all surfaces; write the table after each."""
    cv2.setNumThreads(1)
    keep_freed_memory()
    conditions = current_conditions({"seeds": arguments.seeds}, blender=bpy.app.version_string)
    rows: list[CorrectionTrial] = []
    with temporary_folder() as folder:
        for trial in trials_of(arguments, folder):
            rows.append(trial)
            report(f"{trial.scene}, {trial.surface}, seed {trial.seed}: {trial.refused or f'{trial.seconds:.0f} s'}")
            write_rows(arguments.out / TABLE, rows, conditions)
    found = summary(rows)
    figures = {
        ": ".join(kind): {name: asdict(each) for name, each in own.items() if each.n} for kind, own in found.items()
    }
    write_figures(arguments.out / SUMMARY, figures)
    report("\n".join([HEAD, *(_line(*kind, own) for kind, own in found.items())]))


def draw(out: Path) -> list[Path]:
    """Draw the table."""
    rows, conditions = read_rows(out / TABLE, CorrectionTrial)
    return [correction_chart(rows, conditions, out / TABLE)]


def trials_of(arguments: argparse.Namespace, folder: Path) -> Iterator[CorrectionTrial]:
    """All trials; ``folder`` is for temporary files."""
    if not arguments.no_sample:
        film = film_scene(folder / "sample", arguments.width, arguments.spacing_mm)
        true = film.loaded.surface.mesh
        for seed in arguments.seeds:
            scene = frames_of(film, seed)
            for number, surface in enumerate((TRUE, *WRONG)):
                if surface in arguments.surfaces:
                    rng = np.random.default_rng([seed, number])
                    mesh = true if surface == TRUE else wrong_surface(surface, scene.loaded, rng)
                    off_mm = np.linalg.norm(mesh.vertices - true.vertices, axis=1)
                    yield correction_trial(scene, surface, seed, mesh, off_mm)
    if arguments.bones:
        for pair, planned in misdrilled_bones(arguments.bones, folder / "bones"):
            scene = photographed_scene(pair, BONE_PHOTOGRAPHS)
            mesh = planned.moved(-scene.loaded.surface.mesh_from_model[:3, 3])
            off_mm = deviation(mesh.vertices, scene.loaded.surface.mesh)
            yield correction_trial(scene, "drilled by another plan", 0, mesh, off_mm)
    for pair in bloster_cases(arguments.bloster, folder / "bloster") if arguments.bloster else ():
        for fold in BLOSTER_PHOTOGRAPHS:
            scene = photographed_scene(pair, fold)
            yield correction_trial(scene, "as published", fold.start, scene.loaded.surface.mesh, None)


def film_scene(folder: Path, width: int, spacing_mm: float) -> FilmedScene:
    """The sample in the light of its lamp, and all frames of its film."""
    surface = sample_surface(spacing_mm=spacing_mm)
    camera = MICROSCOPE.resized(width, width * MICROSCOPE.height // MICROSCOPE.width)
    for _ in (
        *write_sample_case(folder, surface, camera=camera, held_out=False),
        *write_sample_film(folder, surface, camera=camera),
    ):
        pass
    loaded = load_case(lit_case(folder / "case.toml"))
    registrar = CaseRegistrar(loaded)
    with registrar.frames(folder / FILM) as opened:
        frames = tuple(
            PosedFrame(
                frame.image.astype(np.float32) / 255, frame.valid, registrar.camera,
                pose @ loaded.surface.mesh_from_model,
            )
            for frame, pose in zip(opened.frames, film_poses(), strict=True)
        )  # fmt: skip
    return FilmedScene("sample", loaded, frames, (), tracked=True)


def frames_of(film: FilmedScene, seed: int) -> FilmedScene:
    """The film with the frames that a seed takes, and those that it leaves out."""
    between = range((seed + STEP // 2) % STEP, len(film.frames), LEFT_OUT)
    out = tuple(small_frame(film.frames[number], LONGER_SIDE_PX) for number in between if not disturbance(number))
    return replace(film, frames=film.frames[seed % STEP :: STEP], left_out=out)


def photographed_scene(pair: CaseFiles, compared: slice) -> FilmedScene:
    """A case and its photographs, of which some are compared with views."""
    loaded = load_case(read_case(pair[0]))
    listed, _ = read_photographs(pair[1], loaded.case)
    frames = [small_frame(load_posed_frame(each, loaded.surface.mesh_from_model, name=pair[0].stem)) for each in listed]
    out = tuple(small_frame(frame, LONGER_SIDE_PX) for frame in frames[compared])
    del frames[compared]
    return FilmedScene(pair[0].stem, loaded, tuple(frames), out, tracked=False)


def summary(rows: Sequence[CorrectionTrial]) -> dict[tuple[str, str], dict[str, MeanInterval]]:
    """By data and surface: mean and interval over seeds of each figure."""
    found = {}
    for kind in dict.fromkeys((row.scene, row.surface) for row in rows):
        own = [row for row in rows if (row.scene, row.surface) == kind]
        drawn = Resampling([(row.seed,) for row in own], np.random.default_rng(0))
        found[kind] = {
            each.name: drawn.interval(np.array([getattr(row, each.name) for row in own]))
            for each in fields(CorrectionTrial)
            if each.type is float
        }
    return found


def _line(scene: str, surface: str, own: Mapping[str, MeanInterval]) -> str:
    def said(name: str) -> str:
        mean, low, high, n = astuple(own[name])
        return f"{mean:.3f} ({low:.3f} to {high:.3f})" if n > 1 else f"{mean:.3f}"

    return f"| {scene} | {surface} | {' | '.join(' / '.join(map(said, names)) for names in COLUMNS.values())} |"
