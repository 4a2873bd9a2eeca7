"""The operator that makes the film's frame in view that of the case, at the pose that was found for it."""

import os
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty

from ..class_registration import prop
from ..pipeline.errors import InputError
from ..pipeline.images.image_reader import read_image
from ..pipeline.video.frame_folder import write_frame
from ..state import from_scene, pose_evidence, to_scene
from ..state.pose import set_cam_from_model
from ..state.scene_files import session_folder
from ..ui.background_operator import InBackground, Work
from ..ui.operator import Messages
from ..video import session
from ..video.operators import NeedsFilm
from . import found


class ONEFRAME_OT_take_frame(InBackground, NeedsFilm):
    """Use the video's frame in view, and the pose found for it, as those of the case; Save Case puts the file beside"""

    bl_label = "Take Frame"
    bl_options = {"UNDO"}
    doing = "Taking the frame"

    masked: bool = prop(
        BoolProperty,
        "Masked",
        "Leave out what is not tissue, with alpha 0: instruments, hands, glare, the black around a "
        "circle. A first draft",
        options={"SKIP_SAVE"},
    )

    def work(self, context: bpy.types.Context) -> Work:
        film, masked = session.scored(context.scene), self.masked
        self._film, self._at, score = film, film.shown, film.score
        folder = film.path.parent if os.access(film.path.parent, os.W_OK) else session_folder()
        return lambda _progress: write_frame(film.path, folder, film.scores, score, masked=masked)

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        path: Path = result
        scene, film = context.scene, self._film
        if session.of(scene) is not film:
            raise InputError("the video has changed meanwhile, nothing was taken")
        frame, record = found.frame_at(scene, self._at), found.record_of(scene, film.scores.frames[self._at].index)
        taken = film.path.name, film.scores.frames[self._at].index
        is_same = from_scene.video(scene) == taken
        messages = to_scene.set_frame(context, path, read_image(path, path.name), taken)
        scene = context.scene
        scene.oneframe_video.taken_path = scene.oneframe.frame_path
        text = f"the frame of the case is {path}"
        # the same frame keeps the pose of the case
        if frame is not None and frame.cam_from_model is not None and not is_same:
            set_cam_from_model(scene, frame.cam_from_model)
            pose_evidence.remember(scene, record, frame.cam_from_model, frame.uncertainty)
            text += f", at its pose: {found.text_of(frame.verdict)}"
        return text, *messages
