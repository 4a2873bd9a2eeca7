"""An evaluation as a folder: scores, summaries, the paper's figure, pairs of novel views, pictures and charts."""

import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path

import bpy
import numpy as np

from ...charts.evaluation_chart import evaluation_charts
from ...charts.page import chart_outputs
from ...errors import InputError
from ...evaluation.conditions import Conditions, current_conditions, write_table
from ...evaluation.record.evaluation_notes import evaluation_notes
from ...evaluation.record.evaluation_pictures import Crop, crop_of, labelled_grid, tile
from ...evaluation.record.evaluation_record import (
    EvaluatedCase,
    EvaluatedMethod,
    Evaluation,
    Pictures,
    evaluation_bytes,
    summarised,
)
from ...evaluation.record.evaluation_tables import (
    FRAME_COLUMNS,
    frame_rows,
    latex_summary,
    markdown_summary,
)
from ...files.content import write_bytes_atomically
from ...files.outputs import check_outputs, check_own_folder, made_folder, writing
from ...images.contact_sheet import downscaled
from ...images.pixel_values import to_uint8
from ...images.png import encode_png
from .evaluate import Findings, NovelView, Settings, View, bounds, distributions, evaluate_case, shown_numbers, steps_px
from .evaluation_case import EvaluationCase
from .methods import Method

RECORD, TABLE, MARKDOWN_FILE, LATEX_FILE = "evaluation.json", "frames.csv", "summary.md", "summary.tex"
FIGURE, PAIRS, PICTURES, CHART = "figure.png", "pairs.png", "pictures", "scores.svg"
_FILES = (RECORD, TABLE, MARKDOWN_FILE, LATEX_FILE, FIGURE, PAIRS)
_NAMES = "|".join([*map(re.escape, _FILES), PICTURES, r"scores(_cases)?(-dark)?\.(svg|png)"])
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
    skipped
        Methods that cannot run, and why.
    pictures
        Number of photographs of each case of which pictures are written.
    missing
        Why there are no FID and KID; empty if there are.
    configuration
        For the record.
    """

    out: Path
    cases: Sequence[EvaluationCase]
    settings: Settings
    skipped: Mapping[Method, str]
    pictures: int
    missing: str
    configuration: Mapping[str, object]


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
    check_own_folder(out, _NAMES)
    outputs = [out / name for name in (*_FILES, *_PictureNames(run).all())]
    for data in _chart_files(out, len(run.cases)):
        outputs += chart_outputs(data)
    photographs = {
        f"photograph {number} of {case.name}": photograph.image
        for case in run.cases
        for number, photograph in enumerate(case.photographs, start=1)
    }
    check_outputs(outputs, {**inputs, **photographs})


def write_evaluation(run: EvaluationRun, reach: Callable[[float], None]) -> tuple[Evaluation, list[str]]:
    """Evaluate all cases and write the folder; pictures as they are made, the record last.

    Parameters
    ----------
    run
        Checked by :func:`check_evaluation`.
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
    findings, gallery = Findings(), _Gallery(run)
    # what a step takes depends on the size of the photograph
    steps = [steps_px(case, len(run.settings.methods)) for case in run.cases]
    shares = itertools.accumulate(itertools.chain.from_iterable(steps))
    total = sum(map(sum, steps))

    def advance() -> None:
        reach(next(shares) / total)

    for case in run.cases:
        evaluate_case(case, run.settings, findings, advance=advance, show=gallery.add, show_novel=gallery.add_novel)
    if all(np.isnan(row.scores["ssim_whole"]) for row in findings.rows):
        raise InputError("photographs: expected views of a surface, none of them shows any; check the poses")
    rng = np.random.default_rng(run.settings.seed)
    evaluation = Evaluation(
        conditions=_conditions(run),
        cases=tuple(EvaluatedCase(case.name, case.images) for case in run.cases),
        methods=(
            *(EvaluatedMethod(method.name, method.peer) for method in run.settings.methods),
            *(EvaluatedMethod(method.name, method.peer, reason) for method, reason in run.skipped.items()),
        ),
        rows=tuple(findings.rows),
        summary=summarised(findings.rows, rng),
        distribution=tuple(distributions(findings)),
        bound=tuple(bounds(findings, rng)),
        missing=run.missing,
        pictures=tuple(gallery.pictures),
    )
    gallery.write_sheets()
    evaluation = draw_charts(evaluation, run.out)
    notes = evaluation_notes(evaluation, findings.without_overlap)
    with writing(made_folder(run.out / TABLE)):
        write_table(run.out / TABLE, FRAME_COLUMNS, frame_rows(evaluation), evaluation.conditions)
    for name, data in (
        (MARKDOWN_FILE, markdown_summary(evaluation, notes)),
        (LATEX_FILE, latex_summary(evaluation)),
        (RECORD, evaluation_bytes(evaluation)),
    ):
        with writing(run.out / name):
            write_bytes_atomically(run.out / name, data)
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
    return current_conditions(run.configuration, blender=bpy.app.version_string)


class _PictureNames:
    """Names of the pictures of an evaluation, relative to its folder."""

    def __init__(self, run: EvaluationRun) -> None:
        self.shown = {case.name: set(shown_numbers(len(case.images), run.pictures)) for case in run.cases}
        self._stems = {
            (case.name, number): f"case_{place} {case.images[number]}"
            for place, case in enumerate(run.cases, start=1)
            for number in sorted(self.shown[case.name])
        }
        self._methods = run.settings.methods

    def of(self, case: str, number: int, what: str) -> str:
        """A picture of a photograph: ``what`` is shown."""
        return f"{PICTURES}/{self._stems[case, number]} {what}.png"

    def all(self) -> list[str]:
        """All names."""
        kinds = ["real", "segmented"]
        kinds += [f"{method.key}{suffix}" for method in self._methods for suffix in ("", " difference")]
        return [self.of(case, number, kind) for case, number in self._stems for kind in kinds]


@dataclass
class _Gallery:
    """Collects what the pictures show, and writes them."""

    run: EvaluationRun
    pictures: list[Pictures] = field(default_factory=list)
    _tiles: dict[tuple[str, int, str], np.ndarray] = field(default_factory=dict)
    _crops: dict[tuple[str, int], Crop] = field(default_factory=dict)
    _novel: dict[tuple[str, int, str], np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._names = _PictureNames(self.run)
        methods = list(self.run.settings.methods)
        leading, others = methods[0], methods[1:]
        # an engine of ours and, if there is one, a peer
        second = next((method for method in others if method.peer), others[0] if others else None)
        self._engines = [leading] if second is None else [leading, second]
        most = 1 if len(self.run.cases) > 1 else MOST_COLUMNS
        self._columns = {
            case.name: set(shown_numbers(len(case.images), most)) for case in self.run.cases[:MOST_COLUMNS]
        }

    def add(self, view: View) -> None:
        """Write the pictures of a view, if it is one of those that are shown."""
        case, number = view.case.name, view.number
        surface = view.shown.surface[..., None]
        segmented = np.where(surface, view.real, np.float32(0))
        rendered = np.where(surface, view.rendered, np.float32(0))
        if view.method in self._engines:
            self._keep_tiles(view, segmented, rendered)
        if number not in self._names.shown[case]:
            return
        kinds = {"real": view.real, "segmented": segmented}
        entry = {kind: self._names.of(case, number, kind) for kind in kinds}
        if view.method == self.run.settings.methods[0]:
            for kind, image in kinds.items():
                self._write(entry[kind], image)
        entry["rendered"] = self._names.of(case, number, view.method.key)
        entry["difference"] = self._names.of(case, number, f"{view.method.key} difference")
        self._write(entry["rendered"], rendered)
        self._write(entry["difference"], np.abs(rendered - segmented))
        self.pictures.append(Pictures(case=case, image=view.case.images[number], method=view.method.name, **entry))

    def add_novel(self, view: NovelView) -> None:
        """Keep a view of a novel pose for the gallery."""
        few = len(self.run.cases) == 1 or view.number < PAIR_COLUMNS
        if view.method in self._engines and few and view.case.name in {c.name for c in self.run.cases[:PAIR_ROWS]}:
            key = view.case.name, view.number
            if key not in self._crops:
                self._crops[key] = crop_of(view.rendered.any(axis=2))
            self._novel[*key, view.method.key] = tile(view.rendered, self._crops[key])

    def write_sheets(self) -> None:
        """Write the paper's figure and the gallery of pairs."""
        places = [place for place in self._tile_places() if (*place, "real") in self._tiles]
        rows = [("real", "real"), ("segmented", "segmented")]
        rows += [(engine.name, engine.key) for engine in self._engines]
        if places:
            labels = [self._label(*place) for place in places]
            lines = [(name, [self._tiles[*place, kind] for place in places]) for name, kind in rows]
            self._write(FIGURE, labelled_grid(lines, labels), width=None)
        self._write_pairs()

    def _write_pairs(self) -> None:
        """Six pairs of one case in three rows of two; of several cases a row each."""
        cases = self.run.cases[:PAIR_ROWS]
        pairs = [
            [self._novel[case.name, number, engine.key] for engine in self._engines]
            for case in cases
            for number in range(len({key[1] for key in self._novel if key[0] == case.name}))
        ]
        columns = PAIR_COLUMNS
        labels = [engine.name for _ in range(columns) for engine in self._engines]
        per_case = len(pairs) // max(len(cases), 1)
        lines = []
        for start in range(0, len(pairs), columns):
            chunk = [image for pair in pairs[start : start + columns] for image in pair]
            case = cases[min(start // per_case, len(cases) - 1)].name
            first = start % per_case + 1
            last = first + len(chunk) // len(self._engines) - 1
            lines.append((f"{case}: novel poses {first} to {last}", chunk))
        if lines:
            self._write(PAIRS, labelled_grid(lines, labels), width=None)

    def _keep_tiles(self, view: View, segmented: np.ndarray, rendered: np.ndarray) -> None:
        case, number = view.case.name, view.number
        columns = self._columns.get(case, set())
        # of several cases the first photograph that shows the surface
        wanted = (
            number in columns if len(self.run.cases) == 1 else case in self._columns and self._is_first(case, number)
        )
        if not wanted:
            return
        crop = crop_of(view.shown.surface)
        self._tiles[case, number, view.method.key] = tile(rendered, crop)
        if view.method == self._engines[0]:
            self._tiles[case, number, "real"] = tile(view.real, crop)
            self._tiles[case, number, "segmented"] = tile(segmented, crop)

    def _is_first(self, case: str, number: int) -> bool:
        kept = [key[1] for key in self._tiles if key[0] == case]
        return not kept or number == min(kept)

    def _tile_places(self) -> list[tuple[str, int]]:
        return list(dict.fromkeys((case, number) for case, number, _ in self._tiles))

    def _label(self, case: str, number: int) -> str:
        image = next(each for each in self.run.cases if each.name == case).images[number]
        return image if len(self.run.cases) == 1 else f"{case}: {image}"

    def _write(self, name: str, image: np.ndarray, width: int | None = PICTURE_WIDTH) -> None:
        path = made_folder(self.run.out / name)
        shown = image if width is None else downscaled(image, width)
        with writing(path):
            write_bytes_atomically(path, encode_png(to_uint8(shown)))
