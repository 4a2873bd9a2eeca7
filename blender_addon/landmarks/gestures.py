"""Mouse gestures that place or drag landmarks on the surface and in the frame.

Each gesture is one operator and one undo step, and lasts as long as the mouse button is held; Esc or the right button
cancels it. Between gestures no code of the add-on runs: navigation and undo are Blender's own.
"""

from dataclasses import dataclass
from typing import Literal

import bpy
import numpy as np
from bpy.props import EnumProperty

from ..class_registration import prop
from ..pipeline.errors import InputError
from ..state import events, frame_in_view, from_scene
from ..state.events import redraw
from ..state.pose import set_cam_from_model
from ..ui.keymap import LANDMARK_TOOL, PIN_TOOL, Key, keys
from ..ui.operator import OperatorResult
from . import edit, solve
from .marks import LandmarkView, landmark_at, marks_of, nearest

FINE_FACTOR = 0.1
"""Movement of a mark relative to the pointer's while Shift is held."""

Moves = Literal["pixel", "point", "pin"]


@dataclass
class Gesture:
    """A mark that is being dragged.

    Attributes
    ----------
    moves
        Image point; surface point; or pin, an image point that pulls the surface.
    index
        The landmark.
    at
        ``(2,)`` position of its mark, region pixels with fractions.
    pointer
        ``(2,)`` latest position of the pointer, region pixels.
    fine_ready
        Whether Shift has been released since the press; only then does Shift mean a fine movement.
    """

    moves: Moves
    index: int
    at: np.ndarray
    pointer: np.ndarray
    fine_ready: bool

    def follow(self, pointer: np.ndarray, *, shift: bool) -> None:
        """Move the mark with the pointer."""
        self.fine_ready |= not shift
        self.at = self.at + (pointer - self.pointer) * (FINE_FACTOR if shift and self.fine_ready else 1.0)
        self.pointer = pointer


@dataclass(frozen=True)
class _Snapshot:
    """Everything that a gesture may change, for restoring it."""

    landmarks: tuple[dict[str, object], ...]
    active: int
    pose: np.ndarray

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> "_Snapshot":
        # as stored: landmarks that are read have the decimals of a file
        fields = "enabled", "has_point", "has_pixel"
        landmarks = tuple(
            {name: getattr(entry, name) for name in fields} | {"point": entry.point[:], "pixel": entry.pixel[:]}
            for entry in scene.oneframe.landmarks
        )
        return cls(landmarks, scene.oneframe.landmark_index, from_scene.cam_from_model(scene))

    def restore(self, scene: bpy.types.Scene) -> None:
        with events.muted():
            settings = scene.oneframe
            while len(settings.landmarks) > len(self.landmarks):
                settings.landmarks.remove(len(settings.landmarks) - 1)
            for entry, landmark in zip(settings.landmarks, self.landmarks, strict=True):
                for name, value in landmark.items():
                    setattr(entry, name, value)
            settings.landmark_index = self.active
        set_cam_from_model(scene, self.pose)


_running: list[Gesture] = []
"""The current one, if any."""
_missed: list[tuple[str, np.ndarray]] = []
"""What the latest press should have hit, and where it was (window px); if it has missed."""

MISS_PX = 60.0
"""How far from such a press the pointer goes, at interface scale 1, before it is forgotten."""


def missed_at(xy: tuple[int, int]) -> str:
    """What a press should have hit that has missed, while the pointer (window px) stays near; else empty."""
    if not _missed:
        return ""
    words, at = _missed[0]
    if np.linalg.norm(at - xy) > MISS_PX * bpy.context.preferences.system.ui_scale:
        _missed.clear()
        return ""
    return words


def running() -> Gesture | None:
    """The current gesture; ``None`` between gestures."""
    return _running[0] if _running else None


def pointer_of(event: bpy.types.Event) -> np.ndarray:
    """``(2,)`` position of an event in its region: the centre of the screen pixel, not its corner."""
    return np.array([event.mouse_region_x + 0.5, event.mouse_region_y + 0.5])


class ONEFRAME_OT_landmark_gesture(bpy.types.Operator):
    """Pick or drag a landmark: its point in the frame, its point on the surface, or a pin that pulls the surface"""

    bl_label = "Pick Landmark"
    bl_options = {"UNDO", "BLOCKING"}

    kind: str = prop(
        EnumProperty,
        "Kind",
        items=[
            ("IMAGE", "Image point", "Place or move a point in the frame"),
            ("SURFACE", "Surface point", "Place or move a point on the surface"),
            ("PIN", "Pin", "Pull the surface by the point under the pointer"),
        ],
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return is_alignment_view(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        scene = context.scene
        _missed.clear()
        try:
            frame_in_view.check_own(scene)
            self._before = _Snapshot.of(scene)
            view = LandmarkView.of(context)
            gesture = self._begin(scene, view, pointer_of(event))
            gesture.fine_ready = not event.shift
            _running[:] = [gesture]
            scene.oneframe.landmark_index = gesture.index
        except InputError as error:
            return self._say_missed(error, event)
        context.workspace.status_text_set("Shift: 10 Times Finer      Esc or Right Click: Cancel")
        context.window_manager.modal_handler_add(self)
        redraw()
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        gesture = running()
        if gesture is None or context.area is None or event.type == "WINDOW_DEACTIVATE":
            return self._end(context, restore=True)
        if event.type in ("ESC", "RIGHTMOUSE") and event.value == "PRESS":
            return self._end(context, restore=True)
        try:
            if event.type == "LEFTMOUSE" and event.value == "RELEASE":
                view = LandmarkView.of(context)
                if gesture.moves != "point" and view.frame is not None:
                    # while it moves, a mark stops at the frame's edge, where nobody has seen its point
                    edit.check_pixel(context.scene, view.frame.px_from_region(gesture.at))
                return self._end(context, restore=False)
            if event.type == "MOUSEMOVE":
                gesture.follow(pointer_of(event), shift=event.shift)
                _apply(context.scene, LandmarkView.of(context), gesture, self._before)
                redraw()
        except InputError as error:
            self._end(context, restore=True)
            return self._say_missed(error, event)
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when something else ends the gesture: a file was opened, or the window closed."""
        _running.clear()
        context.workspace.status_text_set(None)

    def _say_missed(self, error: InputError, event: bpy.types.Event) -> OperatorResult:
        """Say what is wrong, and at the pointer what to do: an ERROR would open a popup, which takes the next keys."""
        self.report({"WARNING"}, str(error))
        advice = str(error).rpartition("; ")[2]
        _missed[:] = [(advice[:1].upper() + advice[1:], np.array([event.mouse_x, event.mouse_y]))]
        redraw()
        return {"CANCELLED"}

    def _begin(self, scene: bpy.types.Scene, view: LandmarkView, pointer: np.ndarray) -> Gesture:
        marks = marks_of(scene, view)
        if self.kind == "PIN" and view.frame is not None:
            return _begin_pin(scene, view, marks, pointer)
        if self.kind == "SURFACE" or view.frame is None:
            found = nearest(marks, "surface", pointer)
            if found is not None:
                return Gesture("point", *found, pointer, False)
            return _place_point(scene, view, pointer)
        found = nearest(marks, "image", pointer)
        if found is not None:
            return Gesture("pixel", *found, pointer, False)
        found = nearest(marks, "surface", pointer)
        if found is not None and not _lacks_pixel(scene):
            return Gesture("point", *found, pointer, False)
        pixel = edit.check_pixel(scene, view.frame.px_from_region(pointer))
        gesture = Gesture("pixel", edit.landmark_for_pick(scene, "pixel"), pointer, pointer, False)
        edit.set_halves(scene, gesture.index, pixel=pixel)
        return gesture

    def _end(self, context: bpy.types.Context, *, restore: bool) -> OperatorResult:
        ended = running()
        _running.clear()
        context.workspace.status_text_set(None)
        scene = context.scene
        if restore:
            self._before.restore(scene)
        elif ended is not None and ended.moves != "pixel":
            # surface points and pins do not solve while they move
            events.landmarks_changed(scene)
        redraw()
        return {"CANCELLED"} if restore else {"FINISHED"}


def _lacks_pixel(scene: bpy.types.Scene) -> bool:
    """Whether the active landmark has a surface point but no image point yet."""
    settings = scene.oneframe
    if not 0 <= settings.landmark_index < len(settings.landmarks):
        return False
    entry = settings.landmarks[settings.landmark_index]
    return entry.has_point and not entry.has_pixel


def _place_point(scene: bpy.types.Scene, view: LandmarkView, pointer: np.ndarray) -> Gesture:
    point = view.surface_point(scene, pointer)
    if point is None:
        raise InputError("expected the surface under the pointer, found none; click on the surface")
    index = edit.landmark_for_pick(scene, "point")
    with events.muted():
        edit.set_halves(scene, index, point_model=point)
    return Gesture("point", index, pointer, pointer, False)


def _begin_pin(scene: bpy.types.Scene, view: LandmarkView, marks: list, pointer: np.ndarray) -> Gesture:
    if view.frame is None:
        raise InputError("expected the camera view; look through the camera (numpad 0), then drag the pin with Ctrl")
    found = nearest(marks, "image", pointer)
    if found is None or not scene.oneframe.landmarks[found[0]].has_point:
        found = nearest(marks, "surface", pointer)
    if found is not None:
        index, at = found
    else:
        point = view.surface_point(scene, pointer)
        if point is None:
            raise InputError("expected the surface under the pointer, found none; start the pin on the surface")
        index, at = edit.add(scene), pointer
        with events.muted():
            edit.set_halves(scene, index, point_model=point)
    with events.muted():
        scene.oneframe.landmarks[index].enabled = True
        edit.set_halves(scene, index, pixel=_in_frame(view, at))
    return Gesture("pin", index, at, pointer, False)


def _apply(scene: bpy.types.Scene, view: LandmarkView, gesture: Gesture, before: _Snapshot) -> None:
    """Move the landmark's point to the mark of the gesture; image points and pins move the surface too."""
    if gesture.moves == "point":
        # do not solve yet: the surface would move away from under the pointer
        point = view.surface_point(scene, gesture.at)
        if point is not None:
            with events.muted():
                edit.set_halves(scene, gesture.index, point_model=point)
        return
    pixel = _in_frame(view, gesture.at)
    if gesture.moves == "pixel":
        edit.set_halves(scene, gesture.index, pixel=pixel)
        return
    with events.muted():
        edit.set_halves(scene, gesture.index, pixel=pixel)
    # always from the pose before the gesture, so that the result depends on the pointer's position only
    solve.pull(scene, before.pose, gesture.index)


def _in_frame(view: LandmarkView, at: np.ndarray) -> np.ndarray:
    if view.frame is None:
        raise InputError("expected the camera view; look through the camera (numpad 0), then drag in the frame")
    return np.clip(view.frame.px_from_region(at), -0.5, np.array(view.frame.camera.size_wh) - 0.5)


def landmark_under(context: bpy.types.Context, event: bpy.types.Event) -> int | None:
    """Index of the landmark with a mark under the pointer; ``None`` if there is none."""
    return landmark_at(marks_of(context.scene, LandmarkView.of(context)), pointer_of(event))


def is_alignment_view(context: bpy.types.Context) -> bool:
    """Whether the context is a 3D view, and camera and surface are set up."""
    return context.area is not None and context.area.type == "VIEW_3D" and from_scene.is_set_up(context.scene)


def _gesture(kind: str, tool: str, *, shift: bool = False, ctrl: bool = False, alt: bool = False) -> Key:
    settings = (("kind", kind),)
    return Key("oneframe.landmark_gesture", "LEFTMOUSE", "PRESS", shift, ctrl, alt, properties=settings, tools=(tool,))


PARTS = (
    keys(
        _gesture("IMAGE", LANDMARK_TOOL),
        _gesture("SURFACE", LANDMARK_TOOL, shift=True),
        _gesture("PIN", LANDMARK_TOOL, ctrl=True),
        _gesture("PIN", PIN_TOOL),
        # the same gesture, so that neither a habit nor a held key selects Blender's objects
        _gesture("PIN", PIN_TOOL, ctrl=True),
        _gesture("PIN", PIN_TOOL, shift=True),
    ),
)
