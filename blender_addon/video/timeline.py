"""The film in Blender's own Timeline: its frames are those of the film, by the number that the decoder gives them.

Blender's own movie images give other pictures than the decoder in films of variable rate, so the scene's frame is a
number alone, and the picture comes from the decoder. The best frames are markers; a band says which are registered.
"""

from bisect import bisect_left, bisect_right

import bpy
import numpy as np

from ..state import camera_view
from ..ui.frame_view import window_region
from ..ui.keymap import Key, Place, keys
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


def timelines(screen: bpy.types.Screen) -> list[bpy.types.Area]:
    """The Timelines of a screen."""
    return [area for area in screen.areas if area.type == EDITOR]


def open_timeline(context: bpy.types.Context) -> None:
    """Open a Timeline below the largest 3D view of the add-on's workspace, unless there is one."""
    views = camera_view.views(context)
    if bpy.app.background or not views or timelines(context.screen):
        return
    view, before = max(views, key=lambda area: area.width * area.height), set(context.screen.areas)
    with context.temp_override(area=view, region=window_region(view)):
        bpy.ops.screen.area_split(direction="HORIZONTAL", factor=SHARE)
    (new,) = set(context.screen.areas) - before
    lower = min(view, new, key=lambda area: area.y)
    lower.ui_type = "TIMELINE"
    lower.spaces.active.show_seconds = False
    with context.temp_override(area=lower, region=window_region(lower)):
        bpy.ops.action.view_all()


def close_timeline(context: bpy.types.Context) -> None:
    """Close the Timeline again."""
    if bpy.app.background or not camera_view.views(context):
        return
    for area in timelines(context.screen):
        with context.temp_override(area=area, region=window_region(area)):
            bpy.ops.screen.area_close()


def position(film: FilmSession, number: int) -> int:
    """Position of a frame of the film among the scored ones: of the next one, as seen from that in view."""
    numbers = [score.index for score in film.scores.frames]
    at = bisect_left(numbers, number) if number > film.score.index else bisect_right(numbers, number) - 1
    return min(max(at, 0), len(numbers) - 1)


PARTS = (keys(Key("oneframe.take_frame", "RET", tools=(), places=(Place("Dopesheet", EDITOR),))),)
