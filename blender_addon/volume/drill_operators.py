"""Operators that begin and end the use of the drill, and open and save plans."""

from pathlib import Path
from typing import Any

import bpy
from bpy.props import StringProperty

from ..class_registration import prop
from ..pipeline.errors import InputError
from ..pipeline.volume.bone.structures import structure_meshes, without_bone
from ..pipeline.volume.drill.drill_guard import check_margins
from ..pipeline.volume.drill.drill_plan import DrillPlan, check_strokes, read_drill_plan, unprotected, write_drill_plan
from ..state import from_scene
from ..state.camera_view import views
from ..state.events import redraw
from ..state.scene_files import input_files
from ..ui.background_operator import InBackground, Work
from ..ui.keymap import DRILL_TOOL
from ..ui.operator import Messages, OpensFile, Reporting, SavesFile
from . import drill_session, drill_strokes
from .loaded import key_of, loaded_ct
from .margins import margins_of, structures_of
from .operators import NeedsCT
from .surface import is_from_ct


class ONEFRAME_OT_drill(InBackground, NeedsCT):
    """Drill the bone: the burr removes it under the pointer, and stops at the margins of structures"""

    bl_label = "Drill"
    doing = "Preparing the drill"

    needs = (lambda context: is_from_ct(context.scene), "Make the surface of this CT first")

    def work(self, context: bpy.types.Context) -> Work:
        scene = context.scene
        ct, level = loaded_ct(scene), from_scene.shortest(scene.oneframe_ct.threshold_hu)
        plan = DrillPlan(drill_strokes.strokes_of(scene), margins_of(scene, ct))
        check_margins(plan.margins_mm, structures_of(ct))
        self._key = key_of(scene), scene.oneframe_ct.threshold_hu

        def prepare(progress: Any) -> drill_session.DrillSession:
            structures = {} if ct.labels is None else structure_meshes(without_bone(ct.labels))
            progress(0.1)
            return drill_session.prepared(ct, level, plan, structures, lambda share: progress(0.1 + 0.9 * share))

        return prepare

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        scene = context.scene
        if (key_of(scene), scene.oneframe_ct.threshold_hu) != self._key:
            raise InputError("the CT or its threshold has changed meanwhile; start again")
        drill_strokes.set_margins(scene, margins_of(scene, result.ct))
        scene.oneframe_ct.drilling = True
        drill_session.keep(scene, result)
        drill_session.surface_hidden(scene, True)
        for area in views(context):
            # from where the camera is, but free to orbit
            area.spaces.active.region_3d.view_perspective = "PERSP"
        if not bpy.app.background:
            _activate_tool(context)
        return "drag over the bone to drill; Make Surface applies it", *unprotected(drill_strokes.margins_in(scene))


def _activate_tool(context: bpy.types.Context) -> None:
    areas = [area for area in (context.area, *context.screen.areas) if area is not None and area.type == "VIEW_3D"]
    if areas:
        with context.temp_override(area=areas[0]):
            bpy.ops.wm.tool_set_by_id(name=DRILL_TOOL)


class ONEFRAME_OT_stop_drill(Reporting):
    """Show the surface again; what was drilled stays, and Make Surface applies it"""

    bl_label = "End Drilling"

    needs = (lambda context: context.scene.oneframe_ct.drilling, "The drill is not in use")

    def run(self, context: bpy.types.Context) -> None:
        drill_session.end(context.scene)


class ONEFRAME_OT_open_plan(NeedsCT, OpensFile):
    """Open a plan of the drill: its strokes and margins replace the present ones"""

    bl_label = "Open Plan"

    filter_glob: str = prop(StringProperty, default="*.toml", options={"HIDDEN"})

    def run(self, context: bpy.types.Context) -> Messages:
        scene, path = context.scene, self.chosen_file()
        plan = read_drill_plan(path)
        messages = check_strokes(plan, loaded_ct(scene).volume.grid, path.name)
        drill_strokes.set_margins(scene, plan.margins_mm)
        drill_strokes.set_strokes(scene, plan.strokes)
        if (session := drill_session.of(scene)) is not None:
            session.follow(plan.strokes)
        return *messages, f"{path.name}: {len(plan.strokes)} strokes"


class ONEFRAME_OT_save_plan(SavesFile):
    """Save strokes and margins as a plan, for oneframe surface --drill"""

    bl_label = "Save Plan"
    bl_options = {"REGISTER"}

    filename_ext = ".toml"
    usual_name = "drill.toml"
    filter_glob: str = prop(StringProperty, default="*.toml", options={"HIDDEN"})

    needs = (lambda context: context.scene.oneframe_ct.strokes_text, "Nothing is drilled yet")

    def run(self, context: bpy.types.Context) -> Messages:
        path: Path = self.chosen_file()
        write_drill_plan(path, drill_strokes.plan_of(context.scene), input_files(context.scene))
        redraw()
        return (f"saved {path}",)
