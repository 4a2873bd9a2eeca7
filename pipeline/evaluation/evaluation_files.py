"""A whole evaluation, as a folder: the scores of every photograph, their summary, and the paper's figure."""

import itertools
import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import cv2
import numpy as np

from ..case.case_file import read_case
from ..case.loaded_case import load_case
from ..errors import InputError
from ..files.outputs import check_own_folder, write_output
from ..images.contact_sheet import contact_sheet
from ..images.pixel_values import mask_box, to_uint8
from ..images.png import encode_png
from ..progress import ShareProgress
from ..registration.pose_list import read_photographs
from .conditions import current_conditions, write_table
from .evaluate import EvaluationCase, ScoredView, named_cases, scored_views
from .methods import ChosenMethods
from .scores.inception import Inception
from .summary import FRAME_COLUMNS, Row, markdown_table, summary_notes, summary_of

TABLE, MARKDOWN, FIGURE = "frames.csv", "summary.md", "figure.png"
NO_INCEPTION = "FID and KID are missing: they need InceptionV3 as an ONNX file (--inception)."

MOST_COLUMNS = 6
TILE_WH = (320, 240)
CROP_MARGIN = 0.08
"""Around the surface, as a share of its extent."""


@dataclass(frozen=True)
class EvaluationRun:
    """What to evaluate, and where to write it.

    Attributes
    ----------
    out, inputs
        The folder, and all files that are read, by what they are.
    cases, methods
        The cases and how their views are rendered.
    seed
        Of the bootstrap.
    inception
        Network for FID and KID, if there is one.
    """

    out: Path
    inputs: Mapping[str, Path]
    cases: Sequence[EvaluationCase]
    methods: ChosenMethods
    seed: int
    inception: Inception | None


def evaluation_run(
    pairs: Sequence[tuple[Path, Path]],
    out: Path,
    methods: ChosenMethods,
    *,
    seed: int = 0,
    inception: Path | None = None,
) -> EvaluationRun:
    """Read cases, lists of photographs and the network, and check that the files can be written."""
    inputs: dict[str, Path] = {}
    given = []
    for number, (case_path, list_path) in enumerate(pairs, start=1):
        loaded = load_case(read_case(case_path))
        given.append((loaded, read_photographs(list_path, loaded.case)[0]))
        files = {**loaded.case.input_files(), "list of photographs": list_path}
        inputs |= {f"{name} of case {number}": path for name, path in files.items()}
    cases = named_cases(given)
    inputs |= {
        f"photograph {number} of {case.name}": photograph.image
        for case in cases
        for number, photograph in enumerate(case.photographs, start=1)
    }
    network = None
    if inception is not None:
        inputs["network"] = inception
        network = Inception(inception)
    check_own_folder(out, "|".join(map(re.escape, (TABLE, MARKDOWN, FIGURE))), inputs)
    return EvaluationRun(out, inputs, cases, methods, seed, network)


def run_evaluation(run: EvaluationRun, *, stream: TextIO) -> Iterator[str]:
    """Evaluate, with progress on a stream, write the folder, and give lines for the user."""
    methods = [method.name for method in run.methods.running]
    notes = [f"{method.name}: skipped, {reason}." for method, reason in run.methods.skipped.items()]
    yield from notes
    notes += [] if run.inception else [NO_INCEPTION]
    figure = Figure(shown_columns([(case.name, n) for case in run.cases for n in range(len(case.photographs))]))
    rows: list[Row] = []
    features: dict[tuple[str, str], list[tuple[np.ndarray, np.ndarray]]] = {}
    for view in _views(run, stream):
        rows.append(Row(view.case.name, view.image, view.method.name, view.scores))
        if view.shows_surface and view.features is not None:
            features.setdefault((view.case.name, view.method.name), []).append(view.features)
        if not view.shows_surface and view.method.name == methods[0]:
            notes.append(f"{view.case.name}: {view.image} shows nothing of the surface and has no scores.")
        figure.add(view)
    if all(math.isnan(row.scores["ssim_whole"]) for row in rows):
        raise InputError("photographs: expected views of a surface, none of them shows any; check the poses")
    configuration = {
        "methods": " ".join(method.key for method in run.methods.running),
        "seed": run.seed,
        "inception": run.inception.name if run.inception else "none",
    }
    conditions = current_conditions(configuration, blender=run.methods.renderers.blender)
    surfaces = {case.name: str(case.loaded.case.mesh) for case in run.cases}
    peers = {method.name: method.peer for method in run.methods.running}
    rng = np.random.default_rng(run.seed)
    summary = summary_of(rows, surfaces, peers, conditions, features, rng)
    notes += summary_notes(summary)
    notes.append(f"{FIGURE}, from the top: {'; '.join(figure.rows)}.")
    write_table(run.out / TABLE, FRAME_COLUMNS, [row.cells for row in rows], conditions)
    write_output(run.out / FIGURE, figure.png())
    write_output(run.out / MARKDOWN, markdown_table(summary, notes))
    for method in methods:
        means = [summary.mean(summary.blocks[-1], method, f"ssim_{part}") for part in ("whole", "surface", "observed")]
        values = " / ".join(f"{each.mean:.3f}" if each.n else "-" for each in means)
        yield f"{method}: SSIM {values} (whole / surface / observed)"
    yield from notes[len(run.methods.skipped) :]
    yield f"summary: {run.out / MARKDOWN}, figure: {run.out / FIGURE}"


def _views(run: EvaluationRun, stream: TextIO) -> Iterator[ScoredView]:
    """All views; what one takes depends on the size of its photograph."""
    sizes = [
        math.prod(c.loaded.frame.camera.size_wh) for c in run.cases for _ in c.photographs for _ in run.methods.running
    ]
    shares = itertools.accumulate(sizes)
    with ShareProgress("of the evaluation", stream=stream) as progress:
        for case in run.cases:
            for view in scored_views(case, run.methods, run.inception):
                progress.reach(next(shares) / sum(sizes))
                yield view


class Figure:
    """Collects the columns of the figure, one for each photograph, while views are scored."""

    def __init__(self, columns: Collection[tuple[str, int]]) -> None:
        """``columns`` are the photographs to show, by case and number."""
        self._tiles: dict[tuple[str, int], list[np.ndarray]] = {column: [] for column in columns}
        self._rows = ["real", "segmented"]

    @property
    def rows(self) -> Sequence[str]:
        """What each row shows, from the top."""
        return self._rows

    def add(self, view: ScoredView) -> None:
        """Add a view to its photograph's column, if that is shown."""
        tiles = self._tiles.get((view.case.name, view.shown.number))
        if tiles is None:
            return
        surface, images = view.shown.surface, [view.rendered]
        if not tiles:
            images = [view.shown.real, np.where(surface[..., None], view.shown.real, np.float32(0)), *images]
        tiles += [_tile(image, surface) for image in images]
        if view.method.name not in self._rows:
            self._rows.append(view.method.name)

    def png(self) -> bytes:
        """The figure as a PNG file."""
        columns = list(self._tiles.values())
        tiles = [column[row] for row in range(len(self._rows)) for column in columns]
        return encode_png(to_uint8(contact_sheet(tiles, columns=len(columns), tile_width=TILE_WH[0])))


def shown_columns(images: Sequence[tuple[str, int]]) -> list[tuple[str, int]]:
    """Which photographs ``(case, number)`` the figure shows: evenly spread, with both ends."""
    places = np.linspace(0, len(images) - 1, min(len(images), MOST_COLUMNS))
    return [images[round(place)] for place in places]


def _tile(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """``(H, W, 3)`` -> the part around an ``(H, W)`` bool mask in a tile's size; all of the image if it is empty."""
    height, width = mask.shape
    rows, columns = mask_box(mask) if mask.any() else (slice(0, height), slice(0, width))
    wide, tall = (each.stop - each.start for each in (columns, rows))
    # in the aspect of a tile
    half = (0.5 + CROP_MARGIN) * max(wide, tall * TILE_WH[0] / TILE_WH[1])
    middle = (columns.start + columns.stop - 1) / 2, (rows.start + rows.stop - 1) / 2
    scale = 2 * half / TILE_WH[0]
    image_from_tile = np.array(
        [[scale, 0, middle[0] - half + scale / 2], [0, scale, middle[1] - half * TILE_WH[1] / TILE_WH[0] + scale / 2]]
    )
    blurred = cv2.GaussianBlur(image, (0, 0), scale / 2) if scale > 1 else image
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(blurred, image_from_tile, TILE_WH, flags=flags, borderMode=cv2.BORDER_CONSTANT)
