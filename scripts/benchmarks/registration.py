"""Registration of further frames: found, refused and wrong, and where it ends.

The images of the sample and of --bones are rendered; bloster's and LM-O's are photographs. Writes, in PATH,
registration_PART.csv, a row for each frame, and their charts. Wrong: accepted, and off by more than 2 degrees, 2 % of
the distance, or 5 px at the size of registration. It takes the arguments of the topic evaluation, of which --light,
--methods and --inception say nothing here.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from oneframe.blender.sample.sample_case import FILM_POSES, write_sample_film
from oneframe.case.case_file import read_case
from oneframe.case.frame import load_posed_frame
from oneframe.case.loaded_case import load_case
from oneframe.evaluation.conditions import current_conditions
from oneframe.files.temporary import temporary_folder
from oneframe.registration.further_frames import small_frame
from oneframe.registration.pose_list import read_photographs
from oneframe.registration.verdict import ACCEPTED
from oneframe.sample.temporal_bone import sample_surface

from . import evaluation
from .alignment.registration_trials import RegistrationTrial, Scene, share
from .charts.registration_charts import registration_charts
from .figures import read_rows, write_rows
from .published import CaseFiles
from .sweeps import registration as sweeps

PARTS = ("photographs", "zoom", "film", "grid", "limits")
TABLE = "registration_{}.csv"
HEAD = "| part | data | kind | frames | found (95 %) | wrong | median | worst | seconds |\n|" + 9 * "---|"
SAMPLE, BONES = "sample", "bones"
QUICK = {"width": 160, "spacing_mm": 0.6, "sources": 1, "frames": 1, "photographs": 2}
OBJECT_FRAMES, MOST_SOURCES = 8, 5
"""Photographs of a small object, and sources of a data set to which all photographs are registered."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    evaluation.add_arguments(parser)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, metavar="PART", help=" ".join(PARTS))
    parser.add_argument(
        "--sources", metavar="N", type=int, default=4, help="of a data set, for bad frames; half as many for limits"
    )
    parser.add_argument(
        "--frames", metavar="N", type=int, default=1, help="of a source, for bad frames; twice as many for limits"
    )


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Measure all parts, and write the table of each."""
    chosen = {name: getattr(arguments, name) for name in ("seed", "sources", "frames", "quick")}
    conditions = current_conditions(chosen, blender=bpy.app.version_string)
    report(HEAD)
    with temporary_folder() as folder:
        scenes = [scene_of(pair, folder) for pair in evaluation.case_files(arguments, folder)]
        for part in arguments.only:
            rows = list(trials_of(part, scenes, arguments, folder))
            if rows:
                write_rows(arguments.out / TABLE.format(part), rows, conditions, "right")
                report("\n".join(summary(rows)))


def draw(out: Path) -> list[Path]:
    """Draw the tables that are there."""
    tables = [read_rows(path, RegistrationTrial) for part in PARTS if (path := out / TABLE.format(part)).exists()]
    return registration_charts([row for rows, _ in tables for row in rows], tables[-1][1], out)


def trials_of(part: str, scenes: Sequence[Scene], arguments: argparse.Namespace, folder: Path) -> sweeps.Trials:
    """The measurements of a part; ``folder`` is for temporary files."""
    quick, seed, few = arguments.quick, arguments.seed, (arguments.sources, arguments.frames)
    half = -(-arguments.sources // 2), 2 * arguments.frames
    objects = [scene for scene in scenes if scene.name == "lmo"]
    # bloster's other case has the same photographs
    whole = [each for each in scenes if each.name in (SAMPLE, BONES) or each.loaded.case.path.stem == "bloster_0"]
    sample = [scene for scene in whole if scene.name == SAMPLE]
    if part == "photographs":
        yield from sweeps.photographs(whole, 1 if quick else MOST_SOURCES)
    elif part == "zoom":
        yield from sweeps.zooms(whole, 1 if quick else MOST_SOURCES)
        yield from () if quick else film_trials(sample, folder, sweeps.FILM_ZOOM)
    elif part == "grid":
        yield from sweeps.grid(whole, [*whole, *objects], seed, few, quick=quick)
    elif part == "limits":
        yield from sweeps.texture_and_size([each for each in whole if each.name != BONES], seed, half, quick=quick)
        yield from sweeps.small_objects(objects, OBJECT_FRAMES)
        for scene in sample:
            yield from sweeps.overlap(sweeps.around(scene, folder / "around", quick=quick))
    elif not quick:
        yield from film_trials(sample, folder, 1.0)


def film_trials(sample: Sequence[Scene], folder: Path, zoom: float) -> sweeps.Trials:
    """Trials of the sample's film, which is made once."""
    for scene in sample:
        if not (folder / FILM_POSES).exists():
            for _ in write_sample_film(folder, sample_surface()):
                pass
        yield from sweeps.film(scene, folder, zoom)


def scene_of(pair: CaseFiles, folder: Path) -> Scene:
    """A case and its photographs; the data set is the name of its place in the folder."""
    loaded = load_case(read_case(pair[0]))
    listed, _ = read_photographs(pair[1], loaded.case)
    name, mesh_from_model = pair[0].relative_to(folder).parts[0], loaded.surface.mesh_from_model
    frames = (small_frame(load_posed_frame(each, mesh_from_model, name=name)) for each in listed)
    return Scene(name, name not in (SAMPLE, BONES), replace(loaded, frames=(small_frame(loaded.frame),)), tuple(frames))


def summary(rows: Sequence[RegistrationTrial]) -> list[str]:
    """A line a kind of the table below :data:`HEAD`, in Markdown; errors are those of all poses that are accepted."""
    lines, groups = [], dict[tuple[str, ...], list[RegistrationTrial]]()
    for row in rows:
        kind = f"{row.kind} {row.amount:g}" if row.part == "limits" else row.kind
        groups.setdefault((row.part, row.scene, kind), []).append(row)
    for names, own in groups.items():
        found, low, high = share(own, lambda row: row.found)
        errors = np.array([(row.error_deg, row.error_percent, row.error_px) for row in own if row.state == ACCEPTED])
        said = [f"{part(errors, axis=0)[0]:.2f}°, {part(errors, axis=0)[1]:.2f} %, {part(errors, axis=0)[2]:.2f} px"
                for part in (np.median, np.max)] if len(errors) else ["-", "-"]  # fmt: skip
        seconds = f"{np.median([row.seconds for row in own]):.2f}"
        counts = f"{sum(row.found for row in own)}: {found:.0%} ({low:.0%} to {high:.0%})"
        cells = (*names, str(len(own)), counts, str(sum(row.wrong for row in own)), *said, seconds)
        lines.append(f"| {' | '.join(cells)} |")
    return lines
