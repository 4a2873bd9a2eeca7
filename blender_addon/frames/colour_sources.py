"""Operators that take registered frames as further colour sources of the case, and give them up."""

from dataclasses import replace
from typing import Any

import bpy
from bpy.props import IntProperty

from ..class_registration import prop
from ..pipeline.case.frame import UnreadFrame
from ..pipeline.errors import InputError
from ..pipeline.files.outputs import check_own_folder, made_folder
from ..pipeline.registration.colour_sources import chosen_sources
from ..pipeline.registration.register_frames import FRAME, FRAME_NAMES, CaseRegistrar
from ..state import from_scene
from ..state.known_case import further_frames, keep_known, known_case
from ..ui.background_operator import InBackground, Work, check_inputs, inputs_of
from ..ui.operator import Messages, Reporting
from ..video import session
from . import found
from .operators import NeedsFound


class ONEFRAME_OT_use_colour_sources(NeedsFound, InBackground):
    """Let found frames colour what the case's frame did not see; Save Case keeps that"""

    bl_label = "Use as Colour Sources"
    # without REGISTER: Adjust Last Operation would do it all again, and cover the strip
    bl_options = {"UNDO"}
    doing = "Choosing frames that colour the surface"

    count: int = prop(IntProperty, "Frames", "How many frames at most", default=3, min=1, max=100)

    def work(self, context: bpy.types.Context) -> Work:
        scene = context.scene
        registered, path = found.of(scene), scene.oneframe.case_path
        candidates = [] if registered is None else registered.colouring()
        if registered is None or not candidates:
            raise InputError("expected frames that were found in this session, there are none; press Register Frames")
        if not path:
            raise InputError("expected a case with a file, beside which the frames go; press Save Case first")
        film, case = session.scored(scene).path, from_scene.absolute_path(path)
        folder = self._folder = case.with_name(f"{case.stem}_{film.stem}_frames")
        check_own_folder(folder, FRAME_NAMES, {"film": film, "case": case})
        loaded, count = from_scene.loaded_case(scene), self.count
        registrar, mesh_from_model = CaseRegistrar(loaded), loaded.surface.mesh_from_model
        self._inputs = inputs_of(scene)

        def choose(progress: Any) -> tuple[UnreadFrame, ...]:
            choice = self._choice = chosen_sources(registrar.mesh, registrar.source, candidates, count)
            progress(0.5)
            made_folder(folder / FRAME)
            return registrar.full_frames(film, folder, [each.candidate for each in choice.frames], mesh_from_model)

        return choose

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        scene = context.scene
        check_inputs(scene, self._inputs)
        if not result:
            raise InputError(self._choice.lines()[-1])
        # those of this film before are replaced
        others = [each for each in further_frames(scene) if each.image.parent != self._folder]
        _set_further_frames(scene, (*others, *result))
        names = ", ".join(each.image.name for each in result)
        said = f"{names} colour the surface too; press Vertex Colours to see it, and Save Case to keep it"
        return (*self._choice.lines(), said)


class ONEFRAME_OT_clear_colour_sources(Reporting):
    """Colour the surface from the case's own frame alone; the files stay"""

    bl_label = "Clear Colour Sources"

    needs = (lambda context: further_frames(context.scene), "The case's own frame alone colours the surface")

    def run(self, context: bpy.types.Context) -> None:
        _set_further_frames(context.scene, ())


def _set_further_frames(scene: bpy.types.Scene, frames: tuple[UnreadFrame, ...]) -> None:
    if (known := known_case(scene)) is not None:
        keep_known(scene, replace(known, frames=frames))
