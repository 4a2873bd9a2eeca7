"""The workspace in which the add-on works: a tab of its own, which always shows the workbench's scene.

Blender's pinned scenes do the work: entering the tab shows the workbench's scene, leaving it brings back the scene that
was there before, also in a Blender without this add-on. The user's workspaces, scenes and views stay as they are.

Blender switches workspaces between two events, so this happens in steps of a timer. In background there is none.
"""

from collections.abc import Callable

import bpy
from bpy.app.handlers import persistent

from ..class_registration import at_end, listening, start_timer, timers
from ..state import camera_view, workbench
from ..state.camera_view import WORKSPACE
from ..state.events import areas
from ..ui.frame_view import window_region
from ..ui.keymap import PIN_TOOL
from . import zoom

NAME = "OneFrame"
TAB = "OneFrame"
"""The tab of the sidebar."""

DRAWN_S = 0.05
"""Time after which a new workspace has been drawn once."""

_entering: dict[int, str] = {}
"""Window -> name of the workbench's scene, while the window changes to the workspace."""


arrived_handlers: list[Callable[[], object]] = []
"""Called when a window has arrived in the workspace."""

_opened: list[str] = []
"""The file that was opened, until the timer has seen to it."""


def is_own(workspace: bpy.types.WorkSpace) -> bool:
    """Whether a workspace is the add-on's."""
    return WORKSPACE in workspace


def _entered(window: bpy.types.Window, left: bpy.types.Scene) -> None:
    if bpy.app.background or is_own(window.workspace):
        return
    window.workspace[_LEFT] = left.name
    start_timer(_settle, 0.0)


_LEFT = "oneframe_left_scene"
"""Custom property of the user's workspace, while the window leaves it: the scene to come back to."""


def _settle() -> float | None:
    """Timer: bring each window's workspace in line with its scene."""
    for window in bpy.context.window_manager.windows:
        key, at_home = window.as_pointer(), is_own(window.workspace)
        if key in _entering:
            if at_home:
                _arrive(window, _entering.pop(key))
        elif workbench.is_workbench(window.scene) and not at_home:
            _go(window)
        elif at_home and not workbench.is_workbench(window.scene):
            # undo has removed the workbench's scene, or a file without one was opened
            _leave(window)
    if _opened and workbench.existing() is None:
        # a file opened with the interface as it was
        remove()
    _opened.clear()
    return DRAWN_S if _entering else None


def _go(window: bpy.types.Window) -> None:
    """Begin to change to the workspace; Blender remembers the scene that the window shows at this moment."""
    scene, before = window.scene, window.workspace
    name = before.pop(_LEFT, "")
    left = bpy.data.scenes.get(name) or next((some for some in bpy.data.scenes if some != scene), None)
    workspace = next(filter(is_own, bpy.data.workspaces), None) or _new_workspace(window)
    workspace[WORKSPACE] = before.name
    _entering[window.as_pointer()] = scene.name
    if left is not None:
        window.scene = left
    window.workspace = workspace


def _arrive(window: bpy.types.Window, name: str) -> None:
    """Show the workbench's scene, which pins it, and lay out a workspace that is new."""
    scene = bpy.data.scenes.get(name)
    if scene is None:
        return
    window.scene = scene
    area = max(
        (area for area in window.screen.areas if area.type == "VIEW_3D"), key=lambda area: area.width, default=None
    )
    if area is None:
        return
    with bpy.context.temp_override(window=window, area=area, region=window_region(area)):
        bpy.ops.wm.tool_set_by_id(name=PIN_TOOL)
        camera_view.show_shape(bpy.context)
        camera_view.look_through_camera(bpy.context)
    show_tab(area)
    for handler in arrived_handlers:
        handler()


def _leave(window: bpy.types.Window) -> None:
    before = bpy.data.workspaces.get(window.workspace[WORKSPACE])
    others = [workspace for workspace in bpy.data.workspaces if not is_own(workspace)]
    if before is None and others:
        before = others[0]
    if before is not None:
        window.workspace = before


def _new_workspace(window: bpy.types.Window) -> bpy.types.WorkSpace:
    """A copy of the window's workspace, reduced to one 3D view."""
    known = set(bpy.data.workspaces)
    with bpy.context.temp_override(window=window):
        bpy.ops.workspace.duplicate()
    (workspace,) = set(bpy.data.workspaces) - known
    workspace.name, workspace.use_pin_scene, workspace.object_mode = NAME, True, "OBJECT"
    screen = workspace.screens[0]
    views = [area for area in screen.areas if area.type == "VIEW_3D"] or list(screen.areas)
    kept = max(views, key=lambda area: area.width * area.height)
    closed = True
    while closed:
        closed = False
        for area in [area for area in screen.areas if area != kept]:
            with bpy.context.temp_override(window=window, workspace=workspace, screen=screen, area=area):
                possible = bpy.ops.screen.area_close.poll()  # type: ignore[call-arg]  # needs none
                closed = possible and bpy.ops.screen.area_close() == {"FINISHED"}
            if closed:
                break
    kept.type = "VIEW_3D"
    _prepare(kept.spaces.active)
    return workspace


def _prepare(space: bpy.types.SpaceView3D) -> None:
    """A view without what does not belong to the frame: floor, axes, cursor, texts."""
    overlay = space.overlay
    space.show_gizmo = overlay.show_overlays = True
    for name in ("show_floor", "show_axis_x", "show_axis_y", "show_axis_z", "show_cursor", "show_text", "show_stats"):
        setattr(overlay, name, False)
    for name in ("show_object_origins", "show_relationship_lines", "show_outline_selected", "show_bones"):
        setattr(overlay, name, False)
    space.show_region_ui = space.show_region_toolbar = space.show_region_tool_header = True
    space.region_3d.view_perspective = "PERSP"
    shading = space.shading
    shading.show_xray = shading.show_shadows = shading.show_cavity = False
    shading.background_type = "THEME"


def show_tab(area: bpy.types.Area) -> None:
    """Show the add-on's tab in the sidebar, once that has been drawn and knows its tabs."""
    key = area.as_pointer()

    def show() -> float | None:
        for _window, found in areas("VIEW_3D"):
            if found.as_pointer() != key:
                continue
            found.tag_redraw()
            sidebar = next(region for region in found.regions if region.type == "UI")
            try:
                sidebar.active_panel_category = TAB  # type: ignore[assignment]  # any tab's name
            except (AttributeError, TypeError):  # read-only before the sidebar is drawn; no such tab yet
                return DRAWN_S
        return None

    bpy.app.timers.register(show, first_interval=DRAWN_S)


@persistent
def _after_change(*_: object) -> None:
    """After undo, redo or opening a file, scenes and workspaces may no longer belong together."""
    _entering.clear()
    if not bpy.app.background:
        start_timer(_settle, 0.0)


@persistent
def _after_load(path: str, *_: object) -> None:
    _opened.append(path)
    _after_change()


def remove() -> None:
    """Return to the user's workspaces, and remove the add-on's; the workbench's scene stays in the file."""
    own = [workspace for workspace in bpy.data.workspaces if is_own(workspace)]
    for window in bpy.context.window_manager.windows:
        if is_own(window.workspace):
            _leave(window)
    for workspace in own:
        if bpy.app.background:
            bpy.data.batch_remove([workspace])
            continue
        with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], workspace=workspace):
            bpy.ops.workspace.delete()


PARTS = (
    at_end(_entering.clear, _opened.clear, remove),
    timers(_settle, zoom.fit_waiting),
    listening(workbench.entered_handlers, _entered),
    listening(camera_view.through_camera_handlers, zoom.fit_soon),
    listening(bpy.app.handlers.undo_post, _after_change),
    listening(bpy.app.handlers.redo_post, _after_change),
    listening(bpy.app.handlers.load_post, _after_load),
)
