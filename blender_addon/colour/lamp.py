"""The lamp at the lens: found, typed, forgotten, and as the panel shows it; it is part of the case."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import bpy
import numpy as np
from bpy.props import FloatProperty, FloatVectorProperty

from ..class_registration import prop
from ..frames import found as found_frames
from ..pipeline.colour.lens_shading import lens_shading_of
from ..pipeline.errors import InputError
from ..pipeline.light.find_lamp import FoundLamp, find_lamp
from ..pipeline.light.lens_light import PHYSICAL, LensLight
from ..pipeline.registration.pose_list import AcceptedFrames, small_frames
from ..pipeline.registration.register import accepted_poses
from ..setup.alignment_record import tool_and_date
from ..state import from_scene
from ..state.known_case import UNNAMED, keep_known, known_case, lamp_of
from ..ui.background_operator import InBackground, Work, check_inputs, inputs_of
from ..ui.operator import Messages, NeedsAlignment, OperatorResult, Reporting
from ..video import session

TYPED = "typed"
"""The method of a lamp that was typed in."""


class ONEFRAME_OT_set_lamp(NeedsAlignment, Reporting):
    """Type in where the lamp at the lens is and how much light comes from everywhere; Save Case keeps it"""

    bl_label = "Set Lamp"

    lamp_cam_mm: Sequence[float] = prop(
        FloatVectorProperty,
        "Place, mm",
        "The lamp in the camera's axes: x to the right, y down, z forward from the lens",
        size=3,
        precision=2,
        options={"SKIP_SAVE"},
    )
    ambient: float = prop(
        FloatProperty,
        "Ambient",
        "Light from everywhere, relative to the lamp's on a surface that faces it, 0 to 1",
        default=0.05,
        precision=3,
        step=1,
        options={"SKIP_SAVE"},
    )
    falloff: float = prop(
        FloatProperty,
        "Falloff",
        "Exponent of the distance, 2 for a small lamp",
        default=PHYSICAL,
        precision=2,
        options={"SKIP_SAVE"},
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        if (light := lamp_of(context.scene)) is not None:
            self.lamp_cam_mm, self.ambient, self.falloff = light.lamp_cam_mm, light.ambient, light.falloff
        return context.window_manager.invoke_props_dialog(self)  # type: ignore[return-value]

    def run(self, context: bpy.types.Context) -> Messages:
        known = lamp_of(context.scene)
        typed = np.array([*self.lamp_cam_mm, self.ambient, self.falloff], np.float32)
        if known is not None and np.array_equal(
            typed, np.array([*known.lamp_cam_mm, known.ambient, known.falloff], np.float32)
        ):
            return ()  # with its origin and every digit
        x, y, z, ambient, falloff = map(from_scene.shortest, typed.tolist())
        tool, date = tool_and_date()
        origin = {"method": TYPED, "tool": tool, "date": date}
        light = LensLight((x, y, z), ambient, falloff, origin, known.transfer if known else "srgb")
        loaded = from_scene.loaded_case(context.scene, aligned=False)
        lens_shading_of(replace(loaded, case=replace(loaded.case, light=light)))
        keep_lamp(context.scene, light)
        return ()


class ONEFRAME_OT_clear_lamp(Reporting):
    """Forget the lamp at the lens; Save Case forgets it in the file too"""

    bl_label = "Clear Lamp"

    needs = (lambda context: lamp_of(context.scene), "No lamp is known")

    def run(self, context: bpy.types.Context) -> None:
        keep_lamp(context.scene, None)


class ONEFRAME_OT_find_lamp(NeedsAlignment, InBackground):
    """Find the lamp at the lens from the shading of the frame and of the film's frames that are found. Esc stops it"""

    bl_label = "Find Lamp"
    # without REGISTER: Adjust Last Operation would do it all again
    bl_options = {"UNDO"}
    doing = "Finding the lamp at the lens"

    def work(self, context: bpy.types.Context) -> Work:
        scene = context.scene
        loaded, accepted, known = from_scene.loaded_case(scene), _accepted(scene), lamp_of(scene)
        self._inputs, self._is_alone = inputs_of(scene), accepted is None and len(loaded.frames) == 1

        def find(progress: Callable[[float], None]) -> FoundLamp:
            frames = small_frames(loaded, accepted)
            progress(0.3)
            return find_lamp(loaded.surface.mesh, frames, known.transfer if known else "srgb")

        return find

    def finish(self, context: bpy.types.Context, result: FoundLamp) -> Messages:
        check_inputs(context.scene, self._inputs)
        if result.objection:
            more = "; open its film and press Register Frames first" if self._is_alone else ""
            raise InputError(f"{result.objection}{more}")
        keep_lamp(context.scene, result.recorded(*tool_and_date()))
        return (f"{result.figures}; Save Case keeps it",)


def _accepted(scene: bpy.types.Scene) -> AcceptedFrames | None:
    """The frames of the scene's film that are found."""
    film, registered = session.of(scene), found_frames.of(scene)
    poses = {} if registered is None else accepted_poses(registered.frames)
    return AcceptedFrames(poses, film.path) if film is not None and poses else None


def keep_lamp(scene: bpy.types.Scene, light: LensLight | None) -> None:
    """Let the scene's case have a lamp at the lens, or none.

    Raises
    ------
    InputError
        Something that a case needs is missing.
    """
    keep_known(scene, replace(known_case(scene) or from_scene.case(scene, UNNAMED), light=light))


def rows(light: LensLight) -> list[tuple[str, str]]:
    """What the panel shows of a lamp: names and values."""
    origin, unsure = light.origin, ""
    place = ", ".join(f"{at:.4g}" for at in light.lamp_cam_mm)
    found = [("Lamp, mm", place)]
    if isinstance(deviation := origin.get("standard_deviation_mm"), Sequence):
        found.append(("", "± " + ", ".join(f"{each:.2g}" for each in deviation)))
    if "ambient_standard_deviation" in origin:
        unsure = f" ± {origin['ambient_standard_deviation']:.2g}"
    found.append(("Ambient Part", f"{light.ambient:.3g}{unsure}"))
    if light.falloff != PHYSICAL:
        found.append(("Falloff", f"{light.falloff:.3g}"))
    if method := origin.get("method"):
        found.append(("Method", f"{method}"))
    if "frames" in origin:
        found.append(("Frames", f"{origin['frames']:g}"))
    if "explained" in origin:
        found.append(("Shading Explained", f"{origin['explained']:.0%}"))
    return found
