"""Draws landmarks, residuals and the pose's uncertainty over the 3D views. Looks things up, changes nothing."""

import bpy
import numpy as np

from . import estimate, frame_view, gather, landmark_edit, landmark_gestures, landmark_loupe, landmark_tool
from .estimate import Solution
from .landmark_marks import LandmarkView, Mark, marks_of
from .pipeline.alignment.ellipse import ellipse_outlines
from .pipeline.alignment.landmark_picking import waits
from .pipeline.alignment.pose_solver import PoseEstimate
from .pipeline.alignment.twist import moved_by
from .pipeline.blender.visible_surface import visible_surface
from .pipeline.camera import PinholeCamera
from .pipeline.errors import InputError
from .pipeline.frames import inverse_rigid, transform_points
from .strokes import Colour, Strokes

GOOD: Colour = (0.35, 0.8, 1.0, 1.0)
FAIR: Colour = (1.0, 0.78, 0.15, 1.0)
BAD: Colour = (1.0, 0.2, 0.15, 1.0)
OFF: Colour = (0.6, 0.6, 0.6, 0.8)
HALF: Colour = (1.0, 1.0, 1.0, 1.0)
UNSURE: Colour = (0.87, 0.68, 1.0, 1.0)
"""Residual as clicks scatter; larger; outlier; left out; other half not picked yet; uncertainty."""
FAIR_FROM, BAD_FROM = 2.5, 5.0
"""Residuals in standard deviations of a click."""
DIMMED = 0.3
"""Opacity of a mark behind the surface."""
SAMPLES = 7
"""Surface points at which the uncertainty is shown besides the landmarks."""
MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
LONGEST_PX, SHORTEST_PX = 45.0, 6.0
"""The weakest direction is drawn as many times longer as keeps it below this on the screen; a speck is left out."""

RING, CROSS = 6.0, (3.0, 10.0)


def picture(context: bpy.types.Context) -> Strokes:
    """All that is drawn into the context's 3D view.

    Raises
    ------
    InputError
        The scene holds no alignment that can be drawn.
    """
    scene, strokes = context.scene, Strokes()
    view = LandmarkView.of(context)
    solved = estimate.solution(scene)
    marks = marks_of(scene, view)
    if solved.estimate is not None:
        _add_uncertainty(strokes, scene, view, solved.estimate)
    hidden = _hidden(scene, view, marks)
    residuals = estimate.residuals_px(scene)
    for mark in marks:
        _add_mark(strokes, scene, mark, solved, residuals.get(mark.index), hidden[mark.index])
    return strokes


def _hidden(scene: bpy.types.Scene, view: LandmarkView, marks: list[Mark]) -> list[bool]:
    shown = [mark for mark in marks if mark.surface is not None]
    points = np.array([scene.oneframe.landmarks[mark.index].point[:] for mark in shown], float).reshape(-1, 3)
    behind = [False] * len(marks)
    for mark, is_behind in zip(shown, view.hidden(scene, points, [mark.surface for mark in shown]), strict=True):
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
    if mark.surface is not None:
        ring = (*colour[:3], colour[3] * (DIMMED if is_hidden else 1.0))
        strokes.circle(mark.surface, RING, ring, width=width)
        if is_active:
            strokes.circle(mark.surface, RING + 3.5, (*HALF[:3], 0.9 * ring[3]), width=1.0)
    place = mark.surface if mark.image is None else mark.image
    if place is not None:
        strokes.text(place + np.array([13, 6]) * strokes.unit, text, colour)


def _colour(
    entry: bpy.types.PropertyGroup, residual: np.ndarray | None, solved: Solution, index: int, click_sigma_px: float
) -> Colour:
    if not entry.enabled:
        return OFF
    if residual is None:
        return HALF
    if solved.is_outlier(index):
        return BAD
    size = float(np.linalg.norm(residual)) / click_sigma_px
    if solved.estimate is not None and not size <= BAD_FROM:
        return BAD
    # as long as no pose is known, a large residual is nobody's fault
    return GOOD if size <= FAIR_FROM else FAIR


def _add_uncertainty(strokes: Strokes, scene: bpy.types.Scene, view: LandmarkView, found: PoseEstimate) -> None:
    camera, pose, uncertainty = gather.camera(scene), gather.cam_from_model(scene), found.uncertainty
    seen = visible_surface(gather.surface_of(scene), camera, pose)
    inner = seen.points_model[_is_inner(seen.pixels, camera)]
    points = np.concatenate(
        [inner[_spread(camera.project(transform_points(pose, inner)), SAMPLES)], uncertainty.pivot_model[None]]
    )
    if view.frame is not None:
        own = estimate.LandmarkPairs.of(scene).points_model
        for group, width in ((points[:-1], 1.0), (own, 1.5)):
            covariances = uncertainty.pixel_covariances(group, camera, pose)
            outlines = ellipse_outlines(covariances, uncertainty.ellipse_scale())
            for centre, outline in zip(view.region_from_model(scene, group), outlines, strict=True):
                strokes.line(centre + outline * view.frame.scale, UNSURE, width=width, closed=True)
    ends = []
    for sign in (1, -1):
        # moved as seen from the camera, in the axes of the surface as it stands now
        model_from_model = inverse_rigid(pose) @ moved_by(
            sign * uncertainty.weakest_twist, pose, uncertainty.pivot_model
        )
        ends.append(transform_points(model_from_model, points) - points)
    factor = _magnification(strokes, view, scene, points, ends[0])
    plus, minus = (view.region_from_model(scene, points + factor * way) for way in ends)
    for high, low in zip(plus, minus, strict=True):
        if np.linalg.norm(high - low) < SHORTEST_PX * strokes.unit:
            continue
        middle = (high + low) / 2
        strokes.arrow(middle, high, UNSURE, width=1.5, head=7)
        strokes.arrow(middle, low, UNSURE, width=1.5, head=7)
    times = "" if factor == 1 else f", drawn {factor} x"
    ellipses = "Ellipses: 95 % of where the surface may lie.  " if view.frame is not None else ""
    strokes.text(
        np.array([70, 34]) * strokes.unit, f"{ellipses}Arrows: weakest direction, {uncertainty.weakest}{times}", UNSURE
    )


def _magnification(
    strokes: Strokes, view: LandmarkView, scene: bpy.types.Scene, points: np.ndarray, ways: np.ndarray
) -> int:
    lengths = view.region_from_model(scene, points + ways) - view.region_from_model(scene, points)
    longest = float(np.nanmax(np.linalg.norm(lengths, axis=1), initial=0.0))
    fitting = [factor for factor in MAGNIFICATIONS if factor * longest <= LONGEST_PX * strokes.unit]
    return fitting[-1] if fitting else 1


def _is_inner(pixels: np.ndarray, camera: PinholeCamera) -> np.ndarray:
    """``(N,)`` bool: not at the edge of the frame, where what is drawn would be cut."""
    margin = 0.08 * max(camera.size_wh)
    return ((pixels > margin) & (pixels < np.array(camera.size_wh) - margin)).all(axis=1)


def _spread(pixels: np.ndarray, count: int) -> list[int]:
    """Indices of points far from each other: each next one is the farthest from those chosen (Gonzalez 1985)."""
    if len(pixels) == 0:
        return []
    chosen = [int(np.argmax(((pixels - pixels.mean(axis=0)) ** 2).sum(axis=1)))]
    nearest = np.full(len(pixels), np.inf)
    while len(chosen) < min(count, len(pixels)):
        nearest = np.minimum(nearest, ((pixels - pixels[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(np.argmax(nearest)))
    return chosen


def _draw_view() -> None:
    context = bpy.context
    scene = context.scene
    if not scene.oneframe.show_landmarks or not scene.oneframe.landmarks or not gather.is_set_up(scene):
        return
    try:
        picture(context).draw()
        gesture = landmark_gestures.running()
        if gesture is not None and gesture.moves != "point" and frame_view.shows_frame(context):
            landmark_loupe.draw(context, gesture)
    except InputError:
        # the panel says what is wrong
        return


def _draw_pointer(xy: tuple[int, int]) -> None:
    """What a click does next, beside the pointer while the tool is in hand."""
    context = bpy.context
    if context.space_data is None or not landmark_tool.is_active(context) or not gather.is_set_up(context.scene):
        return
    landmarks = landmark_edit.landmarks_model(context.scene)
    if landmark_gestures.running() is not None or not waits(landmarks):
        return
    strokes = Strokes()
    strokes.text(np.array(xy) + np.array([18, -26]) * strokes.unit, landmark_tool.step_sentence(context), HALF)
    strokes.draw()


_handles: list = []


def register() -> None:
    """Draw from now on."""
    _handles.append(bpy.types.SpaceView3D.draw_handler_add(_draw_view, (), "WINDOW", "POST_PIXEL"))
    _handles.append(bpy.types.WindowManager.draw_cursor_add(_draw_pointer, (), "VIEW_3D", "WINDOW"))


def unregister() -> None:
    """Draw no more."""
    bpy.types.WindowManager.draw_cursor_remove(_handles.pop())
    bpy.types.SpaceView3D.draw_handler_remove(_handles.pop(), "WINDOW")
