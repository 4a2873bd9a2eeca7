"""The film in Blender's own Timeline: its frames are those of the film, by the number that the decoder gives them.

Blender's own movie images give other pictures than the decoder in films of variable rate, so the scene's frame is a
number alone, and the picture comes from the decoder. The best frames are markers; a band says which are registered.
"""

from bisect import bisect_left, bisect_right

import bpy
import numpy as np

from ..class_registration import listening, start_timer, timers
from ..state import workbench
from ..state.camera_view import WORKSPACE
from ..ui.frame_view import window_region
from ..ui.keymap import Key, Place, keys
from ..view import workspace
from ..view.zoom import fit_soon
from . import session
from .session import FilmSession

EDITOR = "DOPESHEET_EDITOR"
SHARE = 0.13
"""Of a 3D view's height."""

_MARKER = "Best"


def lay_out(scene: bpy.types.Scene, film: FilmSession) -> None:
    """Give the scene the film's frames, and a marker for each of the best ones."""
    remove_markers(scene)
    frames = film.scores.frames
    scene.frame_start, scene.frame_end = frames[0].index, max(frames[-1].index, frames[0].index + 1)
    step_s = float(np.median(np.diff(film.times_s))) if len(frames) > 1 else 0.04
    fps = (frames[1].index - frames[0].index) / step_s if len(frames) > 1 else 25.0
    scene.render.fps = max(1, round(fps))
    scene.render.fps_base = scene.render.fps / max(fps, 0.1)
    for rank, at in enumerate(film.best, start=1):
        scene.timeline_markers.new(f"{_MARKER} {rank}", frame=frames[at].index)


def remove_markers(scene: bpy.types.Scene) -> None:
    """Remove the markers of the best frames."""
    for marker in [marker for marker in scene.timeline_markers if marker.name.startswith(_MARKER)]:
        scene.timeline_markers.remove(marker)


def settle_soon() -> None:
    """Open or close the Timeline once the add-on's workspace is there: Blender changes to it between two events."""
    if not bpy.app.background:
        start_timer(_settle, 0.0)


def _settle() -> None:
    """Timer: a Timeline below the 3D view of each of the add-on's workspaces that shows a film, and none elsewhere."""
    for window in bpy.context.window_manager.windows:
        if WORKSPACE not in window.workspace or not workbench.is_workbench(window.scene):
            continue
        is_wanted = session.of(window.scene) is not None and window.scene.oneframe_video.visible
        opened = [area for area in window.screen.areas if area.type == EDITOR]
        with bpy.context.temp_override(window=window):
            if is_wanted and not opened:
                _open(window.screen)
            for area in () if is_wanted else opened:
                with bpy.context.temp_override(area=area, region=window_region(area)):
                    bpy.ops.screen.area_close()


def _open(screen: bpy.types.Screen) -> None:
    views, before = [area for area in screen.areas if area.type == "VIEW_3D"], set(screen.areas)
    view = max(views, key=lambda area: area.width * area.height)
    with bpy.context.temp_override(area=view, region=window_region(view)):
        bpy.ops.screen.area_split(direction="HORIZONTAL", factor=SHARE)
    (new,) = set(screen.areas) - before
    lower = min(view, new, key=lambda area: area.y)
    lower.ui_type = "TIMELINE"
    with bpy.context.temp_override(area=lower, region=window_region(lower)):
        bpy.ops.action.view_all()
    for area in (view, new):
        if area != lower:
            fit_soon(area)


def position(film: FilmSession, number: int) -> int:
    """Position of a frame of the film among the scored ones: of the next one, as seen from that in view."""
    numbers = [score.index for score in film.scores.frames]
    at = bisect_left(numbers, number) if number > film.score.index else bisect_right(numbers, number) - 1
    return min(max(at, 0), len(numbers) - 1)


PARTS = (
    timers(_settle),
    listening(workspace.arrived_handlers, settle_soon),
    # over the markers, Blender looks at their keys alone
    keys(Key("oneframe.take_frame", "RET", tools=(), places=(Place("Dopesheet", EDITOR), Place("Markers", "EMPTY")))),
)
