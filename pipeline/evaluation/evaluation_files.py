"""An evaluation as a folder: scores, summaries, the paper's figure, pairs of novel views, pictures and charts."""

import itertools
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path

import numpy as np

from ..charts.page import chart_path
from ..errors import InputError
from ..files.outputs import check_outputs, check_own_folder, made_folder, write_output, writing
from ..images.contact_sheet import downscaled
from ..images.pixel_values import to_uint8
from ..images.png import encode_png
from .conditions import Conditions, current_conditions, write_table
from .evaluate import (
    NOVEL_POSES,
    EvaluationCase,
    Findings,
    Settings,
    View,
    bounds,
    distributions,
    evaluate_case,
    shown_numbers,
    steps_px,
)
from .finished_scores import FinishedScores, identity_of
from .record.evaluation_chart import evaluation_charts
from .record.evaluation_pictures import Crop, crop_of, labelled_grid, tile
from .record.evaluation_record import (
    EVALUATION,
    EvaluatedCase,
    EvaluatedMethod,
    Evaluation,
    Pictures,
    evaluation_bytes,
    summarised,
)
from .record.evaluation_tables import (
    FRAME_COLUMNS,
    evaluation_notes,
    frame_rows,
    latex_summary,
    markdown_summary,
)

TABLE, MARKDOWN_FILE, LATEX_FILE = "frames.csv", "summary.md", "summary.tex"
FIGURE, PAIRS, PICTURES, CHART = "figure.png", "pairs.png", "pictures", "scores.png"
_FILES = (EVALUATION, TABLE, MARKDOWN_FILE, LATEX_FILE, FIGURE, PAIRS)
_NAMES = "|".join([*map(re.escape, _FILES), PICTURES, r"scores(_cases)?(-dark)?\.(svg|png)"])
NO_INCEPTION = "FID and KID are missing: they need InceptionV3 as an ONNX file (--inception)."
PICTURE_WIDTH = 960
"""Pictures are reduced to this width, px."""
MOST_COLUMNS = 6
"""Photographs of the figure if there is one case, and cases otherwise."""
PAIR_ROWS, PAIR_COLUMNS = 6, 2
"""Cases of the gallery, and pairs in a row."""


@dataclass(frozen=True)
class EvaluationRun:
    """What to evaluate, and where to write it.

    Attributes
    ----------
    cases, settings
        The cases; methods and seeds.
    pictures
        Number of photographs of each case of which pictures are written.
    """

    out: Path
    cases: Sequence[EvaluationCase]
    settings: Settings
    pictures: int


def check_evaluation(run: EvaluationRun, inputs: Mapping[str, Path]) -> None:
    """Check before any work that the files can be written.

    Raises
    ------
    InputError
        The folder holds something else, or a file must not be replaced.
    RunError
        The files cannot be written.
    """
    out = run.out
    read = dict(inputs) | {
        f"photograph {number} of {case.name}": photograph.image
        for case in run.cases
        for number, photograph in enumerate(case.photographs, start=1)
    }
    check_own_folder(out, _NAMES, read)
    kinds = ["real", "segmented"]
    kinds += [f"{method.key}{suffix}" for method in run.settings.methods.running for suffix in ("", " difference")]
    outputs = [out / name for name in _FILES]
    outputs += [out / f"{stem} {kind}.png" for stem in _stems(run).values() for kind in kinds]
    outputs += map(chart_path, _chart_files(out, len(run.cases)))
    check_outputs(outputs, read)


def write_evaluation(
    run: EvaluationRun, inputs: Mapping[str, Path], reach: Callable[[float], None]
) -> tuple[Evaluation, list[str]]:
    """Evaluate all cases and write the folder; pictures as they are made, the record last.

    What a killed run of the same has scored is taken from its folder, see :mod:`oneframe.evaluation.finished_scores`.

    Parameters
    ----------
    run
        Checked by :func:`check_evaluation`.
    inputs
        All files that were read but the photographs.
    reach
        Gets the share of the work, 0..1, that is finished.

    Returns
    -------
    The evaluation, and notes for the user.

    Raises
    ------
    InputError
        A photograph cannot be used, or none of them shows a surface.
    RunError
        A file cannot be written.
    """
    began, gallery, conditions = time.perf_counter(), _Gallery(run), _conditions(run)
    images = [photograph.image for case in run.cases for photograph in case.photographs]
    known = {"versions": conditions.versions, "machine": conditions.machine, "configuration": conditions.configuration}
    finished = FinishedScores(made_folder(run.out / EVALUATION).parent, identity_of(known, [*inputs.values(), *images]))
    findings = Findings(finished)
    # what a step takes depends on the size of the photograph
    methods = run.settings.methods
    steps = [steps_px(case, len(methods.running)) for case in run.cases]
    shares = itertools.accumulate(itertools.chain.from_iterable(steps))
    total = sum(map(sum, steps))

    def advance() -> None:
        reach(next(shares) / total)

    for place, case in enumerate(run.cases):
        novel = NOVEL_POSES if len(run.cases) == 1 else PAIR_COLUMNS if place < PAIR_ROWS else 0
        pictured = gallery.pictured(case)
        for view in evaluate_case(case, run.settings, findings, novel=novel, pictured=pictured, advance=advance):
            gallery.add(view)
    if all(np.isnan(row.scores["ssim_whole"]) for row in findings.rows):
        raise InputError("photographs: expected views of a surface, none of them shows any; check the poses")
    rng = np.random.default_rng(run.settings.seed)
    surfaces = {case.loaded.case.mesh: case.name for case in reversed(run.cases)}
    cases = tuple(EvaluatedCase(case.name, case.images, surfaces[case.loaded.case.mesh]) for case in run.cases)
    evaluation = Evaluation(
        conditions=conditions,
        cases=cases,
        methods=(
            *(EvaluatedMethod(method.name, method.peer) for method in run.settings.methods.running),
            *(
                EvaluatedMethod(method.name, method.peer, reason)
                for method, reason in run.settings.methods.skipped.items()
            ),
        ),
        rows=tuple(findings.rows),
        summary=summarised(findings.rows, cases, rng),
        distribution=tuple(distributions(findings)),
        bound=tuple(bounds(findings, cases, rng)),
        missing="" if run.settings.inception else NO_INCEPTION,
        pictures=tuple(gallery.pictures),
        seconds={"all": time.perf_counter() - began, "preparation": findings.preparation_seconds},
    )
    gallery.write_sheets()
    evaluation = draw_charts(evaluation, run.out)
    notes = evaluation_notes(evaluation, findings.without_overlap)
    with writing(made_folder(run.out / TABLE)):
        write_table(run.out / TABLE, FRAME_COLUMNS, frame_rows(evaluation), evaluation.conditions)
    for name, data in (
        (MARKDOWN_FILE, markdown_summary(evaluation, notes)),
        (LATEX_FILE, latex_summary(evaluation)),
        (EVALUATION, evaluation_bytes(evaluation)),
    ):
        write_output(run.out / name, data)
    finished.remove()
    return evaluation, notes


def draw_charts(evaluation: Evaluation, out: Path) -> Evaluation:
    """Draw the charts, if matplotlib is installed, and add them to the evaluation.

    Raises
    ------
    RunError
        A file cannot be written.
    """
    try:
        import_module("matplotlib")
    except ImportError:
        return evaluation
    made_folder(out / CHART)
    written = evaluation_charts(evaluation, out / CHART)
    return replace(evaluation, charts=tuple(path.relative_to(out).as_posix() for path in written))


def _chart_files(out: Path, cases: int) -> list[Path]:
    data = out / CHART
    return [data, data.with_stem(f"{data.stem}_cases")] if cases > 1 else [data]


def _conditions(run: EvaluationRun) -> Conditions:
    settings = run.settings
    configuration = {
        "methods": " ".join(method.key for method in settings.methods.running),
        "seed": settings.seed,
        "pose error": "measured" if settings.pose_error_px is None else f"{settings.pose_error_px:g} px",
        "inception": settings.inception.name if settings.inception else "none",
    }
    return current_conditions(configuration, blender=settings.methods.renderers.blender)


def _stems(run: EvaluationRun) -> dict[tuple[str, int], str]:
    """Case and number of the photographs of which pictures are written -> how the names of these begin."""
    return {
        (case.name, number): f"{PICTURES}/case_{place} {case.images[number]}"
        for place, case in enumerate(run.cases, start=1)
        for number in shown_numbers(len(case.images), run.pictures)
    }


@dataclass
class _Gallery:
    """Collects what the pictures show, and writes them; tiles are in the order of the methods."""

    run: EvaluationRun
    pictures: list[Pictures] = field(default_factory=list)
    _columns: dict[tuple[str, int], list[np.ndarray]] = field(default_factory=dict)
    _pairs: dict[tuple[str, int], list[np.ndarray]] = field(default_factory=dict)
    _crops: dict[tuple[str, int], Crop] = field(default_factory=dict)
    _first: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._stems = _stems(self.run)
        self._compared = self.run.settings.compared

    def add(self, view: View) -> None:
        """Write the pictures of a view, if it is one of those that are shown."""
        key = case, number = view.case.name, view.number
        if view.shown is None:
            crop = self._crops.setdefault(key, crop_of(view.rendered.any(axis=2)))
            self._pairs.setdefault(key, []).append(tile(view.rendered, crop))
            return
        real, surface = view.shown.real, view.shown.surface
        segmented, rendered = (np.where(surface[..., None], each, np.float32(0)) for each in (real, view.rendered))
        leads = view.method == self._compared[0]
        if view.method in self._compared and self._has_column(view):
            shown = [real, segmented, rendered] if leads else [rendered]
            self._columns.setdefault(key, []).extend(tile(image, crop_of(surface)) for image in shown)
        if key not in self._stems:
            return
        kinds = {"real": real, "segmented": segmented} if leads else {}
        kinds |= {view.method.key: rendered, f"{view.method.key} difference": np.abs(rendered - segmented)}
        for kind, image in kinds.items():
            self._write(f"{self._stems[key]} {kind}.png", downscaled(image, PICTURE_WIDTH))
        named = (f"{self._stems[key]} {kind}.png" for kind in ("real", "segmented", *list(kinds)[-2:]))
        self.pictures.append(Pictures(case, view.case.images[number], view.method.name, *named))

    def write_sheets(self) -> None:
        """Write the paper's figure, and the gallery: pairs in rows of two, of several cases a row each."""
        engines = [method.name for method in self._compared]
        if self._columns:
            images = {case.name: case.images for case in self.run.cases}
            several = len(images) > 1
            labels = [f"{case}: " * several + images[case][number] for case, number in self._columns]
            rows = zip(["real", "segmented", *engines], zip(*self._columns.values(), strict=True), strict=True)
            self._write(FIGURE, labelled_grid(list(rows), labels))
        lines = []
        for case in dict.fromkeys(case for case, _ in self._pairs):
            pairs = [pair for (of, _), pair in self._pairs.items() if of == case]
            for first in range(0, len(pairs), PAIR_COLUMNS):
                chunk = pairs[first : first + PAIR_COLUMNS]
                label = f"{case}: novel poses {first + 1} to {first + len(chunk)}"
                lines.append((label, list(itertools.chain.from_iterable(chunk))))
        if lines:
            self._write(PAIRS, labelled_grid(lines, engines * PAIR_COLUMNS))

    def pictured(self, case: EvaluationCase) -> set[int]:
        """Numbers of a case's photographs of which a picture is shown; of several cases, the first view is, too."""
        columns = shown_numbers(len(case.images), MOST_COLUMNS) if len(self.run.cases) == 1 else ()
        return {number for name, number in self._stems if name == case.name}.union(columns)

    def _has_column(self, view: View) -> bool:
        """Whether the figure shows a view: of several cases the first photograph that shows the surface."""
        cases = [case.name for case in self.run.cases[:MOST_COLUMNS]]
        if len(self.run.cases) == 1:
            return view.number in shown_numbers(len(view.case.images), MOST_COLUMNS)
        return view.case.name in cases and self._first.setdefault(view.case.name, view.number) == view.number

    def _write(self, name: str, image: np.ndarray) -> None:
        path = made_folder(self.run.out / name)
        write_output(path, encode_png(to_uint8(image)))
