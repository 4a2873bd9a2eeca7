"""A whole evaluation from the files that the user names, for ``oneframe evaluate``."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TextIO

from ..case.case_file import read_case
from ..case.loaded_case import load_case
from ..progress import ShareProgress
from ..registration.pose_list import read_photographs
from .evaluate import Settings, named_cases
from .evaluation_files import FIGURE, MARKDOWN_FILE, EvaluationRun, check_evaluation, write_evaluation
from .methods import ChosenMethods
from .record.evaluation_record import ALL
from .scores.inception import Inception


def evaluation_run(
    pairs: Sequence[tuple[Path, Path]],
    out: Path,
    methods: ChosenMethods,
    *,
    seed: int = 0,
    pose_error_px: float | None = None,
    inception: Path | None = None,
    pictures: int = 0,
) -> tuple[EvaluationRun, dict[str, Path]]:
    """Read cases, lists of photographs and the network.

    Returns
    -------
    What to evaluate, and all files that it reads but the photographs, by what they are.

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
    return EvaluationRun(out, named_cases(given), settings, pictures), inputs


def run_evaluation(run: EvaluationRun, inputs: Mapping[str, Path], *, stream: TextIO) -> Iterator[str]:
    """Evaluate, with progress on a stream.

    Yields
    ------
    Lines for the user.

    Raises
    ------
    InputError, RunError
        As :func:`.check_evaluation` and :func:`.write_evaluation`.
    """
    check_evaluation(run, inputs)
    for method, reason in run.settings.methods.skipped.items():
        yield f"{method.name}: skipped, {reason}"
    with ShareProgress("of the evaluation", stream=stream) as progress:
        evaluation, notes = write_evaluation(run, inputs, progress.reach)
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
