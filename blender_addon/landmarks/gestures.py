"""What a press of the mouse on a landmark, the surface or the frame does until the button is released.

Each gesture is one operator, lasts as long as the button is held, and is one undo step; Esc or the right button puts
everything back. Between gestures nothing of the add-on runs: navigation and undo are Blender's own.
"""

from dataclasses import dataclass
from typing import Literal

import bpy
import numpy as np
from bpy.props import EnumProperty

from ..pipeline.blender.alignment import surface_object
from ..pipeline.errors import InputError
from ..registration import class_registration, prop
from ..state import events, from_scene
from ..ui.operator import OperatorResult, redraw
from . import edit, solve
from .marks import LandmarkView, marks_of, nearest, under

FINE = 0.1
"""Part of the pointer's way that a mark goes while Shift is held."""

Moves = Literal["pixel", "point", "pin"]


@dataclass
class Gesture:
    """What is being dragged.

    Attributes
    ----------
    moves
        Image point; surface point; or image point with the pose pulled after it.
    index
        The landmark.
    at
        ``(2,)`` where its mark is, region pixels with fractions.
    pointer
        ``(2,)`` where the pointer was.
    fine_ready
        Shift has been up since the press, so that it means fine from now on.
    """

    moves: Moves
    index: int
    at: np.ndarray
    pointer: np.ndarray
    fine_ready: bool

    def follow(self, pointer: np.ndarray, *, shift: bool) -> None:
        """Move the mark with the pointer."""
        self.fine_ready |= not shift
        self.at = self.at + (pointer - self.pointer) * (FINE if shift and self.fine_ready else 1.0)
        self.pointer = pointer


@dataclass(frozen=True)
class _Before:
    """All that a gesture may change, to be put back."""

    landmarks: tuple
    active: int
    pose: np.ndarray

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> "_Before":
        return cls(edit.landmarks_model(scene), scene.oneframe.landmark_index, from_scene.cam_from_model(scene))

    def restore(self, scene: bpy.types.Scene) -> None:
        with events.untold():
            settings = scene.oneframe
            while len(settings.landmarks) > len(self.landmarks):
                settings.landmarks.remove(len(settings.landmarks) - 1)
            for entry, landmark in zip(settings.landmarks, self.landmarks, strict=True):
                entry.enabled = landmark.enabled
                entry.has_point, entry.has_pixel = landmark.point is not None, landmark.pixel is not None
                entry.point, entry.pixel = landmark.point or (0, 0, 0), landmark.pixel or (0, 0)
            settings.landmark_index = self.active
        surface_object.set_pose(from_scene.camera_object_of(scene), from_scene.surface_of(scene), self.pose)


_running: Gesture | None = None


def running() -> Gesture | None:
    """The gesture that is going on, for drawing it."""
    return _running


def pointer_of(event: bpy.types.Event) -> np.ndarray:
    """``(2,)`` where an event is in its region: the centre of the screen's pixel, not its corner."""
    return np.array([event.mouse_region_x + 0.5, event.mouse_region_y + 0.5])


class ONEFRAME_OT_landmark_gesture(bpy.types.Operator):
    """Pick or drag a landmark: its point in the frame, its point on the surface, or as a pin that pulls the surface"""

    bl_idname = "oneframe.landmark_gesture"
    bl_label = "Pick Landmark"
    bl_options = {"UNDO", "BLOCKING"}

    kind: str = prop(
        EnumProperty(
            name="Kind",
            items=[
                ("IMAGE", "Image point", "Place or move a point in the frame"),
                ("SURFACE", "Surface point", "Place or move a point on the surface"),
                ("PIN", "Pin", "Pull the surface by the point under the pointer"),
            ],
            options={"SKIP_SAVE"},
        )
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return is_alignment_view(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        global _running
        scene = context.scene
        try:
            self._before = _Before.of(scene)
            view = LandmarkView.of(context)
            gesture = self._begin(scene, view, pointer_of(event))
            gesture.fine_ready = not event.shift
            _running = gesture
            scene.oneframe.landmark_index = gesture.index
        except InputError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        context.workspace.status_text_set("Hold Shift to move ten times finer     Esc or right button: put it back")
        context.window_manager.modal_handler_add(self)
        redraw(context)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        gesture = _running
        if gesture is None or context.area is None or event.type == "WINDOW_DEACTIVATE":
            return self._end(context, put_back=True)
        if event.type in ("ESC", "RIGHTMOUSE") and event.value == "PRESS":
            return self._end(context, put_back=True)
        if event.type == "LEFTMOUSE" and event.value == "RELEASE":
            return self._end(context, put_back=False)
        if event.type == "MOUSEMOVE":
            gesture.follow(pointer_of(event), shift=event.shift)
            try:
                _apply(context.scene, LandmarkView.of(context), gesture, self._before)
            except InputError as error:
                self.report({"ERROR"}, str(error))
                return self._end(context, put_back=True)
            redraw(context)
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when something else ends the gesture (a file is opened, the window closed)."""
        global _running
        _running = None
        context.workspace.status_text_set(None)

    def _begin(self, scene: bpy.types.Scene, view: LandmarkView, pointer: np.ndarray) -> Gesture:
        marks = marks_of(scene, view)
        if self.kind == "PIN":
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
        if found is not None and not _waits_for_pixel(scene):
            return Gesture("point", *found, pointer, False)
        pixel = edit.check_pixel(scene, view.frame.px_from_region(pointer))
        gesture = Gesture("pixel", edit.target(scene, "pixel"), pointer, pointer, False)
        edit.set_halves(scene, gesture.index, pixel=pixel)
        return gesture

    def _end(self, context: bpy.types.Context, *, put_back: bool) -> OperatorResult:
        global _running
        moved, _running = _running, None
        context.workspace.status_text_set(None)
        scene = context.scene
        if put_back:
            self._before.restore(scene)
        elif moved is not None and moved.moves != "pixel":
            # surface points and pins are solved for when they are where they shall be
            events.landmarks_changed(scene)
        redraw(context)
        return {"CANCELLED"} if put_back else {"FINISHED"}


def _waits_for_pixel(scene: bpy.types.Scene) -> bool:
    settings = scene.oneframe
    if not 0 <= settings.landmark_index < len(settings.landmarks):
        return False
    entry = settings.landmarks[settings.landmark_index]
    return entry.has_point and not entry.has_pixel


def _place_point(scene: bpy.types.Scene, view: LandmarkView, pointer: np.ndarray) -> Gesture:
    point = view.surface_point(scene, pointer)
    if point is None:
        raise InputError("expected the surface under the pointer, found none; click on the surface")
    index = edit.target(scene, "point")
    with events.untold():
        edit.set_halves(scene, index, point_model=point)
    return Gesture("point", index, pointer, pointer, False)


def _begin_pin(scene: bpy.types.Scene, view: LandmarkView, marks: list, pointer: np.ndarray) -> Gesture:
    if view.frame is None:
        raise InputError("pins pull the surface in the frame: look through the camera (numpad 0), then drag with Ctrl")
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
        with events.untold():
            edit.set_halves(scene, index, point_model=point)
    with events.untold():
        scene.oneframe.landmarks[index].enabled = True
        edit.set_halves(scene, index, pixel=_in_frame(view, at))
    return Gesture("pin", index, at, pointer, False)


def _apply(scene: bpy.types.Scene, view: LandmarkView, gesture: Gesture, before: _Before) -> None:
    """Put the mark, and what follows it, where the gesture says."""
    if gesture.moves == "point":
        # the surface rests meanwhile: it would run away from under the pointer
        point = view.surface_point(scene, gesture.at)
        if point is not None:
            with events.untold():
                edit.set_halves(scene, gesture.index, point_model=point)
        return
    pixel = _in_frame(view, gesture.at)
    if gesture.moves == "pixel":
        edit.set_halves(scene, gesture.index, pixel=pixel)
        return
    with events.untold():
        edit.set_halves(scene, gesture.index, pixel=pixel)
    # always from where the gesture began: the pointer's way there and back leaves no trace
    solve.pull(scene, before.pose)


def _in_frame(view: LandmarkView, at: np.ndarray) -> np.ndarray:
    if view.frame is None:
        raise InputError("expected the view of the frame; look through the camera (numpad 0), then drag in the frame")
    return np.clip(view.frame.px_from_region(at), -0.5, np.array(view.frame.camera.size_wh) - 0.5)


def landmark_under(context: bpy.types.Context, event: bpy.types.Event) -> int | None:
    """Index of the landmark with a mark under the pointer."""
    return under(marks_of(context.scene, LandmarkView.of(context)), pointer_of(event))


def is_alignment_view(context: bpy.types.Context) -> bool:
    """Whether the context is a 3D view with something to align."""
    return context.area is not None and context.area.type == "VIEW_3D" and from_scene.is_set_up(context.scene)


register, unregister = class_registration((ONEFRAME_OT_landmark_gesture,))
