"""Operators that open a video, and show it or the case's own frame."""

from pathlib import Path
from typing import Any

import bpy
from bpy.props import FloatProperty, IntProperty, StringProperty

from ..class_registration import prop
from ..pipeline.errors import InputError
from ..pipeline.video import SUFFIXES
from ..pipeline.video.frame_folder import film_notes
from ..state import from_scene, workbench
from ..state.scene_files import remember
from ..ui.background_operator import OpensInBackground, Work
from ..ui.operator import Available, Messages, Needs, Reporting
from . import session, shown_frame, timeline
from .session import FilmSession

VIDEOS = ";".join(f"*{suffix}" for suffix in SUFFIXES)


class NeedsFilm(Available):
    """Mixin: available once a video is scored."""

    needs: Needs = (lambda context: session.of(context.scene) is not None, "Open a video first")


class ONEFRAME_OT_open_video(OpensInBackground):
    """Open a video of the microscope: its frames are scored, and one is chosen in the Timeline"""

    bl_label = "Open Video"
    # without REGISTER: Adjust Last Operation would score again
    bl_options = {"UNDO"}
    doing = "Scoring the video"

    filter_glob: str = prop(StringProperty, default=VIDEOS, options={"HIDDEN"})
    every: int = prop(
        IntProperty, "Every", "Only every so many frames: quicker for long films", default=1, min=1, max=1000
    )
    from_s: float = prop(FloatProperty, "From (s)", "Begin here", min=0, precision=2)
    to_s: float = prop(FloatProperty, "To (s)", "End here; 0 for the end", min=0, precision=2)

    def work(self, context: bpy.types.Context) -> Work:
        path = Path(bpy.path.abspath(self.filepath)) if self.filepath else Path()
        if not path.name or path.is_dir():
            raise InputError(f"expected a video, found {self.filepath or 'none'}; choose a file")
        from_s, to_s = (from_scene.shortest(value) for value in (self.from_s, self.to_s))
        if to_s and to_s <= from_s:
            raise InputError(f"To (s): expected a time after {from_s:g} s, or 0 for the end, found {to_s:g}")
        self._key = str(path), self.every, from_s, to_s
        return session.scorer(self._key)

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        scene = workbench.enter(context)
        shown_frame.restore(scene)
        settings = scene.oneframe_video
        settings.path, settings.every, settings.from_s, settings.to_s = self._key
        remember("films", Path(settings.path))
        settings.visible = True
        film: FilmSession = result
        session.keep(scene, film)
        timeline.lay_out(scene, film)
        shown_frame.show(scene, film.shown)
        timeline.settle_soon()
        frames, info = film.scores.frames, film.scores.info
        best = f"{len(film.best)} best frames" if film.best else "no frame shows anything sharply"
        title = f"{film.path.name}: {len(frames)} frames, {info.size_wh[0]} x {info.size_wh[1]} px; {best}"
        return [title, *film_notes(film.scores)]


class ONEFRAME_OT_show_video(NeedsFilm, Reporting):
    """Show the video with its Timeline, or hide it and show the case's own frame"""

    bl_label = "Show Video"
    bl_options = {"REGISTER"}

    def run(self, context: bpy.types.Context) -> None:
        scene, film = context.scene, session.scored(context.scene)
        scene.oneframe_video.visible = not scene.oneframe_video.visible
        if scene.oneframe_video.visible:
            shown_frame.show(scene, film.shown)
        else:
            shown_frame.restore(scene)
        timeline.settle_soon()
