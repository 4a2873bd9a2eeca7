"""A whole evaluation, as a folder: the views of several methods scored against real photographs, and their summary.

Methods are opened one after the other, and photographs are read one after the other, so that only one scene and one
photograph are in memory.
"""

import itertools
import math
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import cv2
import numpy as np

from ..case.case_file import read_case
from ..case.frame import PosedFrame, UnreadFrame, load_posed_frame
from ..case.loaded_case import LoadedCase, check_listed, load_case
from ..colour.lens_shading import lens_shading_of
from ..colour.ray_tracer import RayTracer
from ..colour.reference_view import reference_view, traced_surface
from ..colour.shading import ColouredSurface
from ..dataset.options import NONE, SHADOWS
from ..errors import InputError
from ..files.content import read_beginning
from ..files.keys import file_and_place
from ..files.outputs import check_outputs, check_own_folder, write_output
from ..images.contact_sheet import contact_sheet
from ..images.pixel_values import mask_box, to_uint8
from ..images.png import encode_png
from ..progress import ShareProgress
from ..projection.rendered_view import Render
from ..registration.pose_list import read_photographs
from ..transforms import camera_centre
from .conditions import current_conditions, write_table
from .distribution_distance import Inception
from .methods import ChosenMethods, Method, opened
from .summary import FRAME_COLUMNS, Row, markdown_table, summary_notes, summary_of
from .view_scores import scores_of

TABLE, MARKDOWN, FIGURE = "frames.csv", "summary.md", "figure.png"
NO_INCEPTION = "FID and KID are missing: they need InceptionV3 as an ONNX file (--inception)."

MOST_COLUMNS = 6
TILE_WH = (320, 240)
CROP_MARGIN = 0.08
"""Around the surface, as a share of its extent."""


@dataclass(frozen=True)
class EvaluationCase:
    """A case in memory and its photographs."""

    name: str
    loaded: LoadedCase
    photographs: tuple[UnreadFrame, ...]


@dataclass(frozen=True)
class ShownSurface:
    """A photograph and what it shows where its alpha is not 0.

    Attributes
    ----------
    number, real
        Its place in the case, and ``(H, W, 3)`` code values 0..1.
    surface, observed
        ``(H, W)`` bool: surface, and surface that the frame saw.
    """

    number: int
    real: np.ndarray
    surface: np.ndarray
    observed: np.ndarray


@dataclass(frozen=True)
class ScoredView:
    """A view beside its photograph.

    Attributes
    ----------
    case, method, shown
        What was rendered, how, and the photograph of its pose.
    rendered
        ``(H, W, 3)`` code values 0..1.
    scores
        See :mod:`oneframe.evaluation.view_scores`; NaN for those that it does not have.
    features
        Of the photograph and of the view, for FID and KID.
    """

    case: EvaluationCase
    method: Method
    shown: ShownSurface
    rendered: np.ndarray
    scores: dict[str, float]
    features: tuple[np.ndarray, np.ndarray] | None

    @property
    def image(self) -> str:
        """Name of the photograph."""
        return f"photograph_{self.shown.number + 1}"


def named_cases(given: Sequence[tuple[LoadedCase, Sequence[UnreadFrame]]]) -> tuple[EvaluationCase, ...]:
    """Give each case the name of its surface, and each photograph its number: names of files may name the patient."""
    cases: list[EvaluationCase] = []
    for place, (loaded, photographs) in enumerate(given, start=1):
        name = loaded.case.object_name or "case"
        if name in {case.name for case in cases}:
            name = f"{name} {place}"
        cases.append(EvaluationCase(name, loaded, tuple(photographs)))
    return tuple(cases)


def scored_views(case: EvaluationCase, methods: ChosenMethods, inception: Inception | None) -> Iterator[ScoredView]:
    """Render and score every photograph's view by every method, method by method.

    A photograph that cannot be used is an ``InputError``, as is a case without surface in view, or without the light at
    the lens that a method needs.
    """
    reference = reference_view(case.loaded, traced_surface)
    references = {NONE: reference}
    for light in {method.light for method in methods.running} - {NONE}:
        shading = lens_shading_of(case.loaded, shadows=light == SHADOWS)
        references[light] = reference_view(case.loaded, traced_surface, shading)
    surface, mesh_from_model = ColouredSurface(reference.mesh, reference.views), case.loaded.surface.mesh_from_model
    poses = [photograph.cam_from_mesh @ mesh_from_model for photograph in case.photographs]
    cameras = dict.fromkeys(photograph.camera for photograph in case.photographs)
    for method, camera in itertools.product(methods.running, cameras):
        trace = RayTracer(surface, camera).render
        numbers = [number for number, photograph in enumerate(case.photographs) if photograph.camera == camera]
        with opened(method, methods.renderers, references[method.light], camera, poses) as render:
            for shown in _shown_surfaces(case, trace, numbers):
                pose = poses[shown.number]
                rendered = render(pose)
                scores = scores_of(shown.real, rendered, shown.surface, shown.observed)
                scores["angle_deg"] = _angle_deg(case.loaded.frames, pose, reference.pivot_model)
                features = None
                if inception is not None and shown.surface.any():
                    cut = (np.where(shown.surface[..., None], each, np.float32(0)) for each in (shown.real, rendered))
                    features = inception(next(cut)), inception(next(cut))
                yield ScoredView(case, method, shown, rendered, scores, features)


def _angle_deg(frames: Sequence[PosedFrame], pose: np.ndarray, pivot_model: np.ndarray) -> float:
    """How far the lens of a pose (4x4, mm) has gone around a surface point from the nearest of the frames' lenses."""
    towards = np.array([camera_centre(each) - pivot_model for each in (pose, *(f.cam_from_model for f in frames))])
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    return float(np.degrees(np.arccos(np.clip((towards[1:] @ towards[0]).max(), -1, 1))))


def _shown_surfaces(case: EvaluationCase, trace: Render, numbers: Iterable[int]) -> Iterator[ShownSurface]:
    for number in numbers:
        photograph = case.photographs[number]
        mesh_from_model, name = case.loaded.surface.mesh_from_model, f"photograph_{number + 1}"
        frame = load_posed_frame(photograph, mesh_from_model, name=name)
        view = trace(frame.cam_from_model)
        yield ShownSurface(number, frame.image, view.mask & frame.valid, view.observed & frame.valid)


@dataclass(frozen=True)
class EvaluationRun:
    """What to evaluate, and where to write it.

    Attributes
    ----------
    out
        The folder.
    cases, methods
        The cases and how their views are rendered.
    seed
        Of the bootstrap.
    inception
        Network for FID and KID, if there is one.
    """

    out: Path
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
    given = []
    for case_path, list_path in pairs:
        loaded = load_case(read_case(case_path))
        listed, _ = read_photographs(list_path, loaded.case)
        to_model = loaded.surface.mesh_from_model
        check_listed(loaded, (each.cam_from_mesh @ to_model for each in listed), file_and_place(list_path)[0].name)
        given.append((loaded, listed))
    cases = named_cases(given)
    network = None if inception is None else Inception(inception)
    for photograph in (photograph for case in cases for photograph in case.photographs):
        read_beginning(photograph.image, "a photograph", 1)
    check_own_folder(out, "|".join(map(re.escape, (TABLE, MARKDOWN, FIGURE))), {})
    check_outputs([out / name for name in (TABLE, MARKDOWN, FIGURE)], {})
    return EvaluationRun(out, cases, methods, seed, network)


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
        if view.features is not None:
            features.setdefault((view.case.name, view.method.name), []).append(view.features)
        if math.isnan(view.scores["ssim_whole"]) and view.method.name == methods[0]:
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
    """Collects the columns of the figure, one for each photograph, while views are scored; ``rows``: what they show."""

    def __init__(self, columns: Collection[tuple[str, int]]) -> None:
        """``columns`` are the photographs to show, by case and number."""
        self._tiles: dict[tuple[str, int], list[np.ndarray]] = {column: [] for column in columns}
        self.rows = ["real", "segmented"]

    def add(self, view: ScoredView) -> None:
        """Add a view to its photograph's column, if that is shown."""
        tiles = self._tiles.get((view.case.name, view.shown.number))
        if tiles is None:
            return
        surface, images = view.shown.surface, [view.rendered]
        if not tiles:
            images = [view.shown.real, np.where(surface[..., None], view.shown.real, np.float32(0)), *images]
        tiles += [_tile(image, surface) for image in images]
        if view.method.name not in self.rows:
            self.rows.append(view.method.name)

    def png(self) -> bytes:
        """The figure as a PNG file."""
        columns = list(self._tiles.values())
        tiles = [column[row] for row in range(len(self.rows)) for column in columns]
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
