"""The operator that corrects the surface by the found frames, for research: into a folder beside the case."""

from pathlib import Path
from typing import Any

import bpy

from ..pipeline.errors import InputError
from ..pipeline.surface_correction import CASE, NOT_FOR_SURGERY
from ..state import from_scene
from ..state.scene_files import forget_stamps, known_stamp
from ..ui.background_operator import InBackground, Work, check_inputs, inputs_of
from ..ui.operator import Messages
from ..video import session
from . import found
from .operators import NeedsFound


class ONEFRAME_OT_correct_surface(NeedsFound, InBackground):
    """Correct the surface by the found frames, for research: a corrected copy beside the case, which stays as it is"""

    bl_label = "Correct Surface"
    bl_options = {"REGISTER"}
    doing = "Correcting the surface"

    def work(self, context: bpy.types.Context) -> Work:
        # SciPy, which it needs, takes long to import
        from ..pipeline.registration.accepted_frames import accepted_frames
        from ..pipeline.registration.correct_case import CaseCorrection

        scene = context.scene
        film, registered, folder = session.scored(scene).path, found.of(scene), corrected_folder(scene)
        if folder is None or registered is None or registered.file is None:
            raise InputError("expected a case with a file, beside which the surface goes; press Save Case first")
        loaded = from_scene.loaded_case(scene)
        self._correction: CaseCorrection = CaseCorrection(
            loaded, accepted_frames(registered.file, film, loaded), folder
        )
        self._correction.check()
        self._inputs = inputs_of(scene)
        return self._correction.correct

    def worded(self, message: str) -> str:
        return message.replace("choose another folder", "rename that folder")

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        from ..pipeline.blender.render.lettering import text_mask
        from ..pipeline.report.deviation_page import deviation_page

        check_inputs(context.scene, self._inputs)
        places = self._correction.write(result, text_mask, deviation_page)
        forget_stamps()
        return *self._correction.notes, *places, f"{'; '.join(result.lines)}; {NOT_FOR_SURGERY}"


def corrected_folder(scene: bpy.types.Scene, *, written: bool = False) -> Path | None:
    """The folder for the scene's case and film, or only one that was written; ``None`` without."""
    film = session.of(scene)
    if film is None or not scene.oneframe.case_path:
        return None
    case = from_scene.absolute_path(scene.oneframe.case_path)
    folder = case.with_name(f"{case.stem}_{film.path.stem}_corrected")
    return None if written and known_stamp(folder / CASE) == (0, 0) else folder
