"""The operator that makes the surface of the bone, drilled if it was, and the structures of the labels."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty

from ..class_registration import prop
from ..pipeline.case.surface_doubts import extents_of, size_text
from ..pipeline.case.surface_folder import write_meshes
from ..pipeline.errors import InputError
from ..pipeline.surface.mesh import Ball, TriangleMesh, ball_around
from ..pipeline.surface.mesh_reader import read_mesh
from ..pipeline.surface.structure_colour import structure_colour
from ..pipeline.volume.bone.bone import bone_voxels
from ..pipeline.volume.bone.bone_surface import STAGES
from ..pipeline.volume.bone.structures import without_bone
from ..pipeline.volume.bone.threshold import check_threshold
from ..pipeline.volume.drill.drill_guard import check_margins
from ..pipeline.volume.drill.drill_plan import DrillPlan, unprotected
from ..pipeline.volume.make_surface import STRUCTURES_STAGE, SurfaceSettings, make_surface
from ..state import from_scene, to_scene
from ..state.initial_pose import renew_initial_pose
from ..state.scene_files import session_folder
from ..state.to_scene import put_structures
from ..ui.background_operator import InBackground, Work
from ..ui.operator import Messages, OperatorResult
from ..ui.question import ask_first
from ..ui.step_panel import show
from . import drill_session, drill_strokes
from .loaded import LoadedCT, key_of, loaded_ct
from .margins import structures_of
from .operators import NeedsCT

MADE_FROM = "oneframe_ct"
"""Custom property of a surface: the CT that it was made from."""

MADE_BY, STROKES = "oneframe_made_by", "oneframe_strokes"
"""Custom properties of a surface: how it was made (JSON, without names of files), and the strokes then."""

_BONE_SHARE = 0.1
"""Of the time, roughly."""


def is_from_ct(scene: bpy.types.Scene) -> bool:
    """Whether the present surface was made from the scene's CT: another version of it keeps pose and landmarks."""
    surface, key = from_scene.present_surface(scene), key_of(scene)
    return surface is not None and key is not None and surface.get(MADE_FROM) == _mark(key)


def made_by(scene: bpy.types.Scene) -> dict[str, Any] | None:
    """How the present surface was made from the scene's CT; ``newer_strokes``: others were drilled since."""
    surface = from_scene.present_surface(scene)
    if surface is None or not is_from_ct(scene) or MADE_BY not in surface:
        return None
    newer = surface.get(STROKES) != scene.oneframe_ct.strokes_text
    return {**json.loads(surface[MADE_BY]), "newer_strokes": newer}


def _record(ct: LoadedCT, series: int, level: float, plan: DrillPlan, removed_mm3: float) -> dict[str, Any]:
    grid = ct.volume.grid
    command = ["oneframe surface CT", *([f"--series {series}"] if series else []), f"--threshold {level!r}"]
    command += ["--labels LABELS"] if ct.labels is not None else []
    command += ["--drill drill.toml"] if plan.strokes else []
    return {
        "command": " ".join([*command, "--out surface"]),
        "volume": {"size": list(grid.size), "mesh_from_index": grid.mesh_from_index.tolist()},
        "threshold_hu": level,
        "labels": list(structures_of(ct)),
        "strokes": len(plan.strokes),
        "margins_mm": dict(plan.margins_mm),
        "removed_mm3": round(removed_mm3, 1),
    }


def _mark(key: tuple[str, int, str]) -> str:
    return f"{key[0]}:{key[1]}"


class ONEFRAME_OT_make_surface(InBackground, NeedsCT):
    """Make the surface of the bone above the threshold, without what was drilled, and the structures of the labels"""

    bl_label = "Make Surface"
    doing = "Making the surface"

    replace: bool = prop(
        BoolProperty, "Replace", "Replace a surface that was not made from this CT", options={"SKIP_SAVE", "HIDDEN"}
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        scene = context.scene
        if not self.replace and from_scene.present_surface(scene) is not None and not is_from_ct(scene):
            question = "The present surface was not made from this CT. Its pose, landmarks and structures go with it."
            ask_first(("Replace the Surface?", question, "Replace"), "make_surface", replace=True)
            return {"CANCELLED"}
        return self.start(context)

    def work(self, context: bpy.types.Context) -> Work:
        scene = context.scene
        ct, level = loaded_ct(scene), from_scene.shortest(scene.oneframe_ct.threshold_hu)
        series = scene.oneframe_ct.series
        plan, self._inputs = drill_strokes.plan_of(scene), _inputs(scene)
        check_margins(plan.margins_mm, structures_of(ct))
        if not self.replace and from_scene.present_surface(scene) is not None and not is_from_ct(scene):
            raise InputError("expected no surface, found one that was not made from this CT; replace it by choice")

        def make(
            progress: Any,
        ) -> tuple[Ball | None, Mapping[str, TriangleMesh], dict[str, Path], dict[str, Any]]:
            check_threshold(ct.volume, level)
            solid = bone_voxels(ct.volume, level)
            progress(_BONE_SHARE)
            stages = (STRUCTURES_STAGE, *STAGES)

            def report(stage: str, share: float) -> None:
                progress(_BONE_SHARE + (1 - _BONE_SHARE) * (stages.index(stage) + share) / len(stages))

            labels = None if ct.labels is None else without_bone(ct.labels)
            made = make_surface(ct.volume, level, solid, labels, SurfaceSettings(plan), report=report)
            paths = write_meshes(session_folder(), made.bone.surface.mesh, made.structures)
            record = _record(ct, series, level, plan, made.removed_mm3)
            return made.finish.focus, made.structures, paths, record

        return make

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        scene = context.scene
        if _inputs(scene) != self._inputs:
            raise InputError("the CT, its threshold or what was drilled has changed meanwhile; start again")
        focus, structures, paths, record = result
        # as every other tool reads it: the file has single precision
        mesh, _ = read_mesh(paths[""])
        focus = focus or ball_around(mesh)
        key = key_of(scene)
        if scene.oneframe_ct.drilling:
            drill_session.end(scene)
        if is_from_ct(scene) and scene.oneframe.units == "mm":
            to_scene.exchange_surface(context, paths[""], mesh)
            renew_initial_pose(context, focus)
        else:
            to_scene.set_surface(context, paths[""], mesh, "mm", focus)
        surface = from_scene.surface_of(context.scene)
        surface[MADE_FROM] = "" if key is None else _mark(key)
        surface[MADE_BY], surface[STROKES] = json.dumps(record), scene.oneframe_ct.strokes_text
        put_structures(surface, {name: (paths[name], structure_colour(name)) for name in structures})
        applied = f", {strokes_text(record)}" if record["strokes"] else ""
        named = f", structures {', '.join(structures)}" if structures else ""
        drilled = unprotected(drill_strokes.margins_in(scene)) if drill_strokes.strokes_of(scene) else ()
        show(context.scene, "ct")
        # the status bar shows the last
        return f"surface: {len(mesh.faces):,} triangles, {size_text(extents_of(mesh))}{applied}{named}", *drilled


def strokes_text(record: Mapping[str, Any]) -> str:
    """What a record says of the strokes in the surface."""
    count = "1 stroke" if record["strokes"] == 1 else f"{record['strokes']} strokes"
    return f"{count} applied, {record['removed_mm3']:.0f} mm³; triangles are fine there, coarser elsewhere"


def _inputs(scene: bpy.types.Scene) -> tuple[object, ...]:
    settings = scene.oneframe_ct
    return key_of(scene), settings.threshold_hu, settings.strokes_text, settings.margins_text
