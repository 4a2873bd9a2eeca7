"""Draws the landmarks, their residuals and the uncertainty of the pose over the 3D views; changes nothing."""

import bpy
import numpy as np

from ..pipeline.alignment.manual.picking import is_unfinished
from ..pipeline.alignment.pose_uncertainty import PoseUncertainty, ellipse_outlines
from ..pipeline.blender.alignment.surface_object import visible_surface
from ..pipeline.camera.pinhole import PinholeCamera
from ..state import frame_in_view, from_scene, pose_evidence, workbench
from ..state.landmarks import landmarks_model, points_model
from ..state.properties import ONEFRAME_PG_landmark
from ..ui import frame_view
from ..ui.frame_view import FrameView
from ..ui.keymap import LANDMARK_TOOL, active_tool
from ..ui.pane import Pane, PointerPane
from ..ui.strokes import Colour, Strokes
from ..view.zoom import STATUS_PX, free_rectangle
from . import gestures, solve, tool
from .marks import LandmarkView, Mark, marks_of
from .solve import Solution

GOOD: Colour = (0.35, 0.8, 1.0, 1.0)
FAIR: Colour = (1.0, 0.78, 0.15, 1.0)
BAD: Colour = (1.0, 0.2, 0.15, 1.0)
DISABLED: Colour = (0.6, 0.6, 0.6, 0.8)
INCOMPLETE: Colour = (1.0, 1.0, 1.0, 1.0)
"""Of a landmark: residual explained by the click noise; larger residual; outlier; disabled; one point missing."""

FAIR_FROM, BAD_FROM = 2.5, 5.0
"""Residuals in standard deviations of the click noise."""

HIDDEN_OPACITY = 0.3
"""Opacity of a mark behind the surface."""

RING, CROSS = 6.0, (3.0, 10.0)
"""Radius of the ring around a surface point; inner and outer radius of the cross at an image point; px at interface
scale 1."""


def add_landmarks(strokes: Strokes, context: bpy.types.Context) -> None:
    """Add everything that is drawn of them in the context's 3D view."""
    scene, view = context.scene, LandmarkView.of(context)
    solved = solve.solution(scene)
    marks = marks_of(scene, view)
    add_uncertainty(strokes, scene, view, solved)
    if not solve.is_current(scene, solved):
        # outliers are those of the solution: at another pose they mean nothing
        solved = Solution(None, solved.refusal)
    hidden = _hidden(scene, view, marks)
    residuals = solve.residuals_px(scene)
    for mark in marks:
        _add_mark(strokes, scene, mark, solved, residuals.get(mark.index), hidden[mark.index])


def _hidden(scene: bpy.types.Scene, view: LandmarkView, marks: list[Mark]) -> list[bool]:
    shown = [mark for mark in marks if mark.surface is not None]
    points = points_model(scene)[[mark.index for mark in shown]]
    behind = [False] * len(marks)
    for mark, is_behind in zip(
        shown, view.hidden(scene, points, [mark.surface for mark in shown if mark.surface is not None]), strict=True
    ):
        behind[mark.index] = bool(is_behind)
    return behind


def _add_mark(
    strokes: Strokes,
    scene: bpy.types.Scene,
    mark: Mark,
    solved: Solution,
    residual: np.ndarray | None,
    is_hidden: bool,
) -> None:
    entry = scene.oneframe.landmarks[mark.index]
    colour = _colour(entry, residual, solved, mark.index, scene.oneframe.click_sigma_px)
    is_active = mark.index == scene.oneframe.landmark_index
    width = 2.5 if is_active else 1.5
    text = entry.name
    if mark.image is not None:
        strokes.cross(mark.image, *CROSS, colour, width=width)
        if mark.surface is not None and residual is not None:
            strokes.arrow(mark.surface, mark.image, colour, width=width)
            text += f"  {np.linalg.norm(residual):.1f} px"
            if solved.is_outlier(mark.index):
                text += ", left out: the others contradict it"
    if mark.surface is not None:
        ring = (*colour[:3], colour[3] * (HIDDEN_OPACITY if is_hidden else 1.0))
        strokes.circle(mark.surface, RING, ring, width=width)
        if is_active:
            strokes.circle(mark.surface, RING + 3.5, (*INCOMPLETE[:3], 0.9 * ring[3]), width=1.0)
    place = mark.surface if mark.image is None else mark.image
    if place is not None:
        strokes.text(place + np.array([13, 6]) * strokes.unit, text, colour)


def _colour(
    entry: ONEFRAME_PG_landmark, residual: np.ndarray | None, solved: Solution, index: int, click_sigma_px: float
) -> Colour:
    if not entry.enabled:
        return DISABLED
    if residual is None:
        return INCOMPLETE
    if solved.is_outlier(index):
        return BAD
    size = float(np.linalg.norm(residual)) / click_sigma_px
    if solved.estimate is not None and not size <= BAD_FROM:
        return BAD
    # without a solution, a large residual says nothing about this landmark
    return GOOD if size <= FAIR_FROM else FAIR


class NextStep(Pane):
    """What comes next, in the middle of a view that shows nothing yet."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return workbench.is_workbench(context.scene) and not from_scene.is_set_up(context.scene)

    @classmethod
    def draw(cls, context: bpy.types.Context, strokes: Strokes) -> None:
        low, high = free_rectangle(context.area)
        at = (low + high) / 2
        for line in strokes.wrapped(workbench.next_step(context.scene), 0.9 * float(high[0] - low[0])):
            strokes.text(at - [strokes.width_of(line) / 2, 0.0], line, INCOMPLETE)
            at = at - [0.0, STATUS_PX * strokes.unit]


class Landmarks(Pane):
    """Landmarks, residuals and uncertainty, unless they are of another frame."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        scene = context.scene
        is_used = bool(scene.oneframe.landmarks) or active_tool(context) == LANDMARK_TOOL
        is_own = frame_in_view.other(scene) is None
        return scene.oneframe.show_landmarks and is_used and from_scene.is_set_up(scene) and is_own

    @classmethod
    def draw(cls, context: bpy.types.Context, strokes: Strokes) -> None:
        add_landmarks(strokes, context)


class Instruction(PointerPane):
    """Next to the pointer, what a press has missed, or the instruction while picking is unfinished."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return tool.is_waiting(context) and from_scene.is_set_up(context.scene)

    @classmethod
    def draw(cls, context: bpy.types.Context, strokes: Strokes, pointer: tuple[int, int]) -> None:
        text, region = gestures.missed_at(pointer), frame_view.window_region(context.area)
        if not text:
            # of pins, the header of the tool says it
            is_asked = active_tool(context) == LANDMARK_TOOL and is_unfinished(landmarks_model(context.scene))
            if gestures.running() is not None or not is_asked:
                return
            text = tool.instruction(context)
        low, high = free_rectangle(context.area)
        at, margin = np.array(pointer) + np.array([18, -26]) * strokes.unit, 6 * strokes.unit
        row = STATUS_PX * strokes.unit
        lines = strokes.wrapped(text, float(high[0] - low[0]) - 2 * margin)
        # not under the sidebar, nor below the view
        right = region.x + high[0] - max(map(strokes.width_of, lines)) - margin
        at = np.array([min(at[0], right), max(at[1], region.y + low[1] + margin + row * (len(lines) - 1))])
        for number, line in enumerate(lines):
            strokes.text(at - [0.0, number * row], line, INCOMPLETE)


UNCERTAIN: Colour = (0.87, 0.68, 1.0, 1.0)
SAMPLES = 7
"""Points of the visible surface at which the uncertainty is drawn, in addition to the landmarks and the pivot."""

EDGE_MARGIN = 0.08
"""Least distance of these from the edges of the frame, as a fraction of its size."""

LEGEND, LINE = (70.0, 34.0), 20.0
"""Lower left corner of the legend, and height of a line, in pixels at interface scale 1."""


def add_uncertainty(strokes: Strokes, scene: bpy.types.Scene, view: LandmarkView, solved: Solution) -> None:
    """Add a legend and, in the camera view, the ellipses, if the current pose's uncertainty is known."""
    found = current_uncertainty(scene, solved)
    if found is None:
        return
    uncertainty, points = found
    legend = [f"Least certain: {uncertainty.weakest}"]
    if view.frame is not None:
        samples = _samples(scene, view.cam_from_model)
        _add_ellipses(strokes, scene, view, view.frame, uncertainty, samples, width=1.0)
        _add_ellipses(strokes, scene, view, view.frame, uncertainty, points, width=1.5)
        legend.append("Ellipses: 95 % confidence regions of surface points")
    corner = np.array(LEGEND) * strokes.unit
    if bpy.context.area is not None:
        # above what else is drawn at the bottom
        corner[1] = max(corner[1], free_rectangle(bpy.context.area)[0][1] + LINE / 2 * strokes.unit)
    for number, text in enumerate(legend):
        strokes.text(corner + np.array([0, LINE * number]) * strokes.unit, text, UNCERTAIN)


def current_uncertainty(scene: bpy.types.Scene, solved: Solution) -> tuple[PoseUncertainty, np.ndarray] | None:
    """The uncertainty of the current pose, and ``(N, 3)`` landmarks that it rests on; ``None`` if it is not known.

    It is that of the landmarks, or of the refinement, and holds for the pose that these have found alone.
    """
    refined = pose_evidence.remembered_uncertainty(scene)
    if refined is not None:
        return refined, np.empty((0, 3))
    if solved.alignment is not None and solve.is_current(scene, solved):
        return solved.alignment.estimate.uncertainty, solved.alignment.points
    return None


def _add_ellipses(
    strokes: Strokes,
    scene: bpy.types.Scene,
    view: LandmarkView,
    frame: FrameView,
    uncertainty: PoseUncertainty,
    points_model: np.ndarray,
    *,
    width: float,
) -> None:
    covariances = uncertainty.pixel_covariances(points_model, frame.camera, view.cam_from_model)
    outlines = ellipse_outlines(covariances, uncertainty.ellipse_scale())
    for centre, outline in zip(view.region_from_model(scene, points_model), outlines, strict=True):
        strokes.line(centre + outline * frame.scale, UNCERTAIN, width=width, closed=True)


def _samples(scene: bpy.types.Scene, cam_from_model: np.ndarray) -> np.ndarray:
    """``(N, 3)`` visible surface points (model frame, mm), far from each other and from the edges of the frame."""
    camera = from_scene.camera(scene)
    seen = visible_surface(from_scene.surface_of(scene), camera, cam_from_model)
    inner = np.flatnonzero(is_inner(seen.pixels, camera))
    return seen.points_model[inner[_spread(seen.pixels[inner], SAMPLES)]]


def is_inner(pixels: np.ndarray, camera: PinholeCamera) -> np.ndarray:
    """``(N,)`` bool: which of ``(N, 2)`` pixels are not near the edges of the frame."""
    margin = EDGE_MARGIN * max(camera.size_wh)
    return ((pixels > margin) & (pixels < np.array(camera.size_wh) - margin)).all(axis=1)


def _spread(pixels: np.ndarray, count: int) -> list[int]:
    """Indices of points far from each other: each is the farthest from those already chosen (Gonzalez 1985)."""
    if len(pixels) == 0:
        return []
    chosen = [int(np.argmax(((pixels - pixels.mean(axis=0)) ** 2).sum(axis=1)))]
    nearest = np.full(len(pixels), np.inf)
    while len(chosen) < min(count, len(pixels)):
        nearest = np.minimum(nearest, ((pixels - pixels[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(np.argmax(nearest)))
    return chosen
