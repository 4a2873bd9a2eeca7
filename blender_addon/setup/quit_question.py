"""Blender's question before it quits, which speaks of the .blend file: left out while the case's history has it all.

It is a preference of the user's, which is as before as soon as anything else could be lost, and for the next session.
"""

import bpy
from bpy.app.handlers import persistent

from ..class_registration import at_end, listening, ticking
from ..dataset import background_job
from ..pipeline.blender.colour.surface_colour import colour_record
from ..state import from_scene, workbench
from . import history

TICK_S = 0.3

_left_out: list[bool] = []
"""What the preference was, while it is switched off."""


def is_needed() -> bool:
    """Whether something could be lost that is in no history: in other scenes, another file, colours, a run."""
    scene, windows = workbench.existing(), bpy.context.window_manager.windows
    job = background_job.current()
    if scene is None or bpy.data.filepath or (job is not None and job.running):
        return True
    if any(window.scene != scene for window in windows) or any(image.is_dirty for image in bpy.data.images):
        return True
    surface = from_scene.present_surface(scene)
    return surface is None or colour_record(surface) is not None or not history.is_kept(scene)


def _switch(*, off: bool) -> None:
    preferences = bpy.context.preferences
    if off == bool(_left_out):
        return
    was_changed = preferences.is_dirty
    if off:
        _left_out.append(preferences.view.use_save_prompt)
        preferences.view.use_save_prompt = False
    else:
        preferences.view.use_save_prompt = _left_out.pop()
    # it is for this session: what the user changes is saved by Blender as ever
    preferences.is_dirty = was_changed


def _tick() -> float:
    # with changes of the user's own, Blender saves the preferences when it quits
    _switch(off=not bpy.app.background and not bpy.context.preferences.is_dirty and not is_needed())
    return TICK_S


@persistent
def _ask_again(*_arguments: object) -> None:
    _switch(off=False)


PARTS = (
    at_end(_ask_again),
    listening(bpy.app.handlers.load_pre, _ask_again),
    ticking(_tick, TICK_S),
)
