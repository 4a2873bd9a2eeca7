"""The steps of the work in the sidebar: one is open, the others are one line each.

Open is the step that the case needs, until the user opens another, or works on another in the view. Nothing moves under
the pointer: what a button does keeps its own step open.
"""

from collections.abc import Callable
from typing import Any

import bpy
from bpy.props import BoolProperty, StringProperty

from ..class_registration import attached, prop
from ..pipeline.errors import InputError
from ..state import from_scene, pose_evidence, workbench
from .panel import SidebarPanel

STEPS = ("ct", "setup", "view", "move", "landmarks", "refine", "colour", "dataset")
"""In the order of the work."""


def needed(scene: bpy.types.Scene) -> str:
    """The step that takes the case further."""
    if not from_scene.is_set_up(scene) or scene.oneframe.aligned_path:
        return "ct" if workbench.next_step(scene) == workbench.MAKE_SURFACE else "setup"
    try:
        # {}: given by the case, and not moved since
        if pose_evidence.is_refined(scene) or pose_evidence.remembered(scene) == {}:
            return "refine"
    except InputError:
        return "setup"  # the pose cannot be read
    return "landmarks" if len(scene.oneframe.landmarks) else "move"


def shown(scene: bpy.types.Scene) -> str:
    """The step that is open; empty if the user has closed it."""
    chosen, need = bpy.context.window_manager.oneframe_steps, needed(scene)
    return chosen.step if chosen.needed == need else need


def show(scene: bpy.types.Scene, step: str) -> None:
    """Open a step, and so close the others, until the case needs another one."""
    chosen = bpy.context.window_manager.oneframe_steps
    chosen.step, chosen.needed = step, needed(scene)


class ONEFRAME_PG_steps(bpy.types.PropertyGroup):
    """The step that was chosen, and the one that the case needed then; and whether each is open, for the panels."""

    step: str = prop(StringProperty, options={"SKIP_SAVE"})
    needed: str = prop(StringProperty, options={"SKIP_SAVE"})


def _is_open(step: str) -> Any:
    get: Callable[[object], bool] = lambda _steps: shown(bpy.context.scene) == step  # noqa: E731
    return prop(BoolProperty, get=get, set=lambda _steps, value: show(bpy.context.scene, step if value else ""))


for _step in STEPS:
    setattr(ONEFRAME_PG_steps, f"show_{_step}", _is_open(_step))


class StepPanel(SidebarPanel):
    """Mixin: a step of the work, ``bl_label`` is its line."""

    bl_parent_id = "ONEFRAME_PT_case"
    bl_options = {"HIDE_HEADER"}
    step = ""

    def draw(self, context: bpy.types.Context) -> None:
        header, body = self.layout.panel_prop(context.window_manager.oneframe_steps, f"show_{self.step}")
        header.label(text=self.bl_label)
        self.draw_line(context, header)
        if body is not None:
            self.draw_step(context, body)

    def draw_line(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        """Draw what stands at the end of the line."""

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        """Draw the step."""
        raise NotImplementedError


class PartPanel(SidebarPanel):
    """Mixin: a part of a step, its parent, there while that is open."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return shown(context.scene) == getattr(bpy.types, cls.bl_parent_id).step


PARTS = (attached(bpy.types.WindowManager, "oneframe_steps", ONEFRAME_PG_steps),)
