"""What the user does next while something is missing: one sentence for the sidebar, the tool's header and the view."""

import bpy

from . import from_scene

OPEN = "Open a case, which can also be dropped onto the view, or load frame, K and surface in any order."

MAKE_SURFACE = "Next: set the threshold in the panel CT, and press Make Surface."


def next_step(scene: bpy.types.Scene) -> str:
    """One sentence; empty once frame, camera and surface are there."""
    settings = scene.oneframe
    has_camera = from_scene.present_camera(scene) is not None
    has_surface = from_scene.present_surface(scene) is not None
    if not (settings.frame_path or has_camera or has_surface):
        return MAKE_SURFACE if scene.oneframe_ct.path else OPEN
    if not settings.frame_path:
        return "Next: load the frame, one image of the microscope."
    if not has_camera:
        return "Next: load K from a file, or type it under Camera K and press Set Camera."
    if not has_surface:
        return "Next: load the surface, or make it from the CT."
    return ""
