"""The panel Video, in Set up: the frame in view with its figures, the best frames, and what takes it."""

import bpy

from ..state import frame_in_view, from_scene
from ..ui.panel import SidebarPanel, draw_text
from . import session, shown_frame
from .session import FilmSession


class ONEFRAME_PT_video(SidebarPanel):
    """Choose the frame from a video"""

    bl_parent_id = "ONEFRAME_PT_setup"
    bl_label = "Video"
    bl_order = 0

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return session.key_of(context.scene) is not None

    def draw(self, context: bpy.types.Context) -> None:
        layout, scene = self.layout, context.scene
        layout.operator_context = "INVOKE_DEFAULT"
        layout.label(text=bpy.path.basename(scene.oneframe_video.path), icon="FILE_MOVIE")
        film = session.of(scene)
        if film is None:
            draw_text(layout, "Its scores are not in memory.", icon="INFO")
            again = layout.operator("oneframe.open_video", text="Score Again", icon="FILE_REFRESH")
            again.filepath, again.every, again.from_s, again.to_s = session.key_of(scene) or ("", 1, 0.0, 0.0)
            return
        visible = scene.oneframe_video.visible
        layout.operator("oneframe.show_video", icon="TIME", depress=visible)
        if visible:
            _draw_film(layout, scene, film)


def _draw_film(layout: bpy.types.UILayout, scene: bpy.types.Scene, film: FilmSession) -> None:
    column = layout.column(align=True)
    row = column.row(align=True)
    row.operator("screen.marker_jump", text="Best", icon="PREV_KEYFRAME").next = False
    row.operator("screen.frame_offset", text="", icon="TRIA_LEFT").delta = -1
    row.operator("screen.frame_offset", text="", icon="TRIA_RIGHT").delta = 1
    row.operator("screen.marker_jump", text="Best", icon="NEXT_KEYFRAME").next = True
    texts = figures(film, film.shown)
    for part in ("   ".join(texts[:2]), "   ".join(texts[2:4]), "   ".join(texts[4:])):
        column.label(text=part)
    failure = film.fetcher.failure(film.shown)
    if failure:
        draw_text(layout, failure, icon="ERROR")
    row = layout.row(align=True)
    row.operator("oneframe.take_frame", icon="CHECKMARK")
    row.operator("oneframe.take_frame", text="Masked", icon="MOD_MASK").masked = True
    if shown_frame.is_shown(scene):
        other = frame_in_view.other(scene)
        alone = "" if other is None or other.cam_from_model is not None else f" without the surface: {other.text}"
        draw_text(layout, f"The view shows the video{alone}. Show Video brings back the case's frame.", icon="INFO")
    elif from_scene.present_camera(scene) is None and from_scene.present_surface(scene) is not None:
        draw_text(layout, "The video covers the view until K is loaded. Show Video hides it.", icon="INFO")


def figures(film: FilmSession, at: int) -> list[str]:
    """A frame's number, time and scores, the most important first."""
    score = film.scores.frames[at]
    rank = film.rank(at)
    minutes, seconds = divmod(score.time_s, 60)
    return [
        f"Frame {score.index}",
        f"{int(minutes)}:{seconds:05.2f}",
        f"score {score.total:.2f}" + (f" (best {rank})" if rank else ""),
        f"sharp {score.sharpness:.2f}",
        f"glare {score.glare:.1%}",
        f"covered {score.obstructed:.1%}",
    ]
