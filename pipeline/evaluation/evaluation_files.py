"""A whole evaluation, as a folder: scores, summaries, the paper's figure, pairs of novel views, pictures and charts."""

import itertools
import re
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TextIO

import numpy as np

from ..case.case_file import read_case
from ..case.loaded_case import load_case
from ..errors import InputError
from ..files.outputs import check_outputs, check_own_folder, write_output
from ..progress import ShareProgress
from ..registration.pose_list import read_photographs
from .conditions import Conditions, current_conditions, write_table
from .evaluate import (
    NOVEL_POSES,
    EvaluationRun,
    Settings,
    evaluate_case,
    named_cases,
    steps_px,
)
from .findings import Findings, bounds, distributions
from .finished_scores import FinishedScores, identity_of
from .gallery import FIGURE, PAIR_COLUMNS, PAIR_ROWS, PAIRS, PICTURES, Gallery, picture_stems
from .methods import ChosenMethods
from .record.evaluation_chart import chart_files, evaluation_charts
from .record.evaluation_record import (
    ALL,
    EVALUATION,
    EvaluatedCase,
    EvaluatedMethod,
    Evaluation,
    by_angle,
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
from .scores.inception import Inception

TABLE, MARKDOWN_FILE, LATEX_FILE = "frames.csv", "summary.md", "summary.tex"
CHART = "scores.png"
_FILES = (EVALUATION, TABLE, MARKDOWN_FILE, LATEX_FILE, FIGURE, PAIRS)
_NAMES = "|".join([*map(re.escape, _FILES), PICTURES, r"scores(_cases)?(-dark)?\.(svg|png)"])
NO_INCEPTION = "FID and KID are missing: they need InceptionV3 as an ONNX file (--inception)."


def evaluation_run(
    pairs: Sequence[tuple[Path, Path]],
    out: Path,
    methods: ChosenMethods,
    *,
    seed: int = 0,
    pose_error_px: float | None = None,
    inception: Path | None = None,
    pictures: int = 0,
) -> EvaluationRun:
    """Read cases, lists of photographs and the network.

    Raises
    ------
    InputError
        A file cannot be used.
    """
    inputs: dict[str, Path] = {}
    given = []
    for number, (case_path, list_path) in enumerate(pairs, start=1):
        loaded = load_case(read_case(case_path))
        given.append((loaded, read_photographs(list_path, loaded.case)[0]))
        files = {**loaded.case.input_files(), "list of photographs": list_path}
        inputs |= {f"{name} of case {number}": path for name, path in files.items()}
    network = None
    if inception is not None:
        inputs["network"] = inception
        network = Inception(inception)
    settings = Settings(methods, seed, pose_error_px, network)
    return EvaluationRun(out, inputs, named_cases(given), settings, pictures)


def run_evaluation(run: EvaluationRun, *, stream: TextIO) -> Iterator[str]:
    """Evaluate, with progress on a stream.

    Yields
    ------
    Lines for the user.

    Raises
    ------
    InputError
        The folder holds something else, or a file must not be replaced; or as :func:`write_evaluation`.
    RunError
        The files cannot be written.
    """
    _check(run)
    for method, reason in run.settings.methods.skipped.items():
        yield f"{method.name}: skipped, {reason}"
    with ShareProgress("of the evaluation", stream=stream) as progress:
        evaluation, notes = write_evaluation(run, progress.reach)
    case = ALL if len(run.cases) > 1 else run.cases[0].name
    for ran in evaluation.ran:
        means = [evaluation.mean(case, ran.name, f"ssim_{part}") for part in ("whole", "surface", "observed")]
        values = " / ".join(f"{each.mean:.3f}" if each.n else "-" for each in means)
        yield f"{ran.name}: SSIM {values} (whole / surface / observed)"
    limits = [evaluation.bound_of(case, f"ssim_{part}") for part in ("whole", "surface", "observed")]
    yield "limit: SSIM " + " / ".join("-" if each is None else f"{each.mean:.3f}" for each in limits)
    already = {f"{method.name}: skipped, {reason}." for method, reason in run.settings.methods.skipped.items()}
    yield from (text for text in notes if text not in already)
    yield f"summary: {run.out / MARKDOWN_FILE}, figure: {run.out / FIGURE}"


def _check(run: EvaluationRun) -> None:
    """Check before any work that the files can be written."""
    out = run.out
    read = dict(run.inputs) | {
        f"photograph {number} of {case.name}": photograph.image
        for case in run.cases
        for number, photograph in enumerate(case.photographs, start=1)
    }
    check_own_folder(out, _NAMES, read)
    kinds = ["real", "segmented"]
    kinds += [f"{method.key}{suffix}" for method in run.settings.methods.running for suffix in ("", " difference")]
    outputs = [out / name for name in _FILES]
    outputs += [out / f"{stem} {kind}.png" for stem in picture_stems(run).values() for kind in kinds]
    outputs += chart_files(out / CHART, len(run.cases))
    check_outputs(outputs, read)


def write_evaluation(run: EvaluationRun, reach: Callable[[float], None]) -> tuple[Evaluation, list[str]]:
    """Evaluate all cases and write the folder; pictures as they are made, the record last.

    What a killed run of the same has scored is taken from its folder, see :mod:`oneframe.evaluation.finished_scores`.

    ``reach`` gets the share of the work, 0..1, that is finished. It gives notes for the user, too.

    Raises
    ------
    InputError
        A photograph cannot be used, or none of them shows a surface.
    RunError
        A file cannot be written.
    """
    began, gallery, conditions = time.perf_counter(), Gallery(run), _conditions(run)
    read = [*run.inputs.values(), *(photograph.image for case in run.cases for photograph in case.photographs)]
    known = {"versions": conditions.versions, "machine": conditions.machine, "configuration": conditions.configuration}
    finished = FinishedScores(run.out, identity_of(known, read))
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
        angles=tuple(by_angle(findings.rows, cases, rng)),
        seconds={"all": time.perf_counter() - began, "preparation": findings.preparation_seconds},
    )
    gallery.write_sheets()
    evaluation = draw_charts(evaluation, run.out)
    notes = evaluation_notes(evaluation, findings.without_overlap)
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
    written = evaluation_charts(evaluation, out / CHART)
    return replace(evaluation, charts=tuple(path.relative_to(out).as_posix() for path in written))


def _conditions(run: EvaluationRun) -> Conditions:
    settings = run.settings
    configuration = {
        "methods": " ".join(method.key for method in settings.methods.running),
        "seed": settings.seed,
        "pose error": "measured" if settings.pose_error_px is None else f"{settings.pose_error_px:g} px",
        "inception": settings.inception.name if settings.inception else "none",
    }
    return current_conditions(configuration, blender=settings.methods.renderers.blender)
