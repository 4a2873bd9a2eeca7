"""Operators that take frames of the film, each at the pose that is found for it: for the case, and into the queue."""

import os
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, IntProperty

from ..case_queue.operators import add_to_queue, added_text, first_case
from ..class_registration import prop
from ..pipeline.case.case_queue import NewFrame
from ..pipeline.case.pose_record import UNKNOWN, PoseRecord
from ..pipeline.errors import InputError
from ..pipeline.files.outputs import made_folder
from ..pipeline.images.image_reader import read_image
from ..pipeline.poses.view_spread import spread_views
from ..pipeline.registration.verdict import ACCEPTED
from ..pipeline.transforms import inverse_rigid
from ..pipeline.video.frame_folder import write_frame, write_frames_only
from ..setup import queued
from ..state import from_scene, pose_evidence, to_scene
from ..state.pose import set_cam_from_model
from ..state.scene_files import session_folder
from ..ui.background_operator import AsksInBackground, InBackground, Work
from ..ui.operator import Messages, NeedsAlignment, OperatorResult
from ..video import session
from ..video.operators import NeedsFilm
from . import film_poses
from .operators import NeedsFound


class _ToQueue(NeedsAlignment, NeedsFilm, InBackground):
    """Mixin: writes frames of the film beside the queue's cases, and a case for each. All of them or none."""

    bl_options = {"REGISTER"}
    doing = "Taking the frames"

    def chosen(self, scene: bpy.types.Scene) -> Collection[int]:
        """The wanted frames, by their numbers in the film; those that are in the queue are left out."""
        raise NotImplementedError

    def work(self, context: bpy.types.Context) -> Work:
        scene, film = context.scene, session.scored(context.scene)
        folder = queued.new_folder(scene)
        first_case(scene).camera.for_images(film.scores.info.size_wh, film.path.name)
        chosen = set(self.chosen(scene)) - numbers_in_queue(scene)
        if not chosen:
            raise InputError(f"{film.path.name}: expected a frame that has no case yet, found none; choose another one")
        scores = [score for score in film.scores.frames if score.index in chosen]
        poses = {score.index: _pose_of(scene, score.index) for score in scores}
        self._written: list[Path] = []

        def take(progress: Callable[[float], None]) -> list[NewFrame]:
            made_folder(folder / "frame")
            before, taken = set(folder.iterdir()), []
            with _all_or_none(self._written):
                for score, image in zip(scores, write_frames_only(film.path, folder, scores), strict=True):
                    self._written += [image] if image not in before else []
                    taken.append(NewFrame(image, (film.path.name, score.index), *poses[score.index]))
                    progress(len(taken) / len(scores))
            return taken

        return take

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        with _all_or_none(self._written):
            return added_text(context.scene, add_to_queue(context.scene, result))


class ONEFRAME_OT_queue_video_frames(_ToQueue):
    """Put the video's frame in view into the queue, or its best frames, at the poses that are found for them"""

    bl_label = "Add Video Frame"

    best: bool = prop(BoolProperty, "Best", "The best frames instead of the one in view", options={"SKIP_SAVE"})

    def chosen(self, scene: bpy.types.Scene) -> Collection[int]:
        film = session.scored(scene)
        return [film.scores.frames[at].index for at in (film.best if self.best else (film.shown,))]


class ONEFRAME_OT_queue_found(AsksInBackground, _ToQueue, NeedsFound):
    """Put found frames of the video into the queue, at their poses: those that see the surface from far apart"""

    bl_label = "Add All Found"

    count: int = prop(IntProperty, "Frames", "How many", default=10, min=1, max=10_000)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        # Blender's own dialog calls execute
        return context.window_manager.invoke_props_dialog(self)  # type: ignore[return-value]

    def chosen(self, scene: bpy.types.Scene) -> Collection[int]:
        poses, there = _found_poses(scene), numbers_in_queue(scene)
        left = [number for number in poses if number not in there]
        taken = [from_scene.cam_from_model(scene), *(poses[number] for number in there & poses.keys())]
        return [left[index] for index in spread_views([poses[number] for number in left], self.count, taken)]


def numbers_in_queue(scene: bpy.types.Scene) -> set[int]:
    """The frames of the scene's film that are in its queue, or of its case, by their numbers."""
    name = session.scored(scene).path.name
    known = (from_scene.video(scene), *(entry.video for entry in queued.queue_of(scene)))
    return {video[1] for video in known if video is not None and video[0] == name}


def _found_poses(scene: bpy.types.Scene) -> dict[int, np.ndarray]:
    """Number -> pose of the accepted frames, in the order of the film."""
    registered = film_poses.of(scene)
    frames = {} if registered is None else registered.frames
    accepted = {score.index: frames.get(score.index) for score in session.scored(scene).scores.frames}
    return {
        number: each.cam_from_model
        for number, each in accepted.items()
        if each is not None and each.cam_from_model is not None and each.verdict.state == ACCEPTED
    }


def _pose_of(scene: bpy.types.Scene, number: int) -> tuple[np.ndarray | None, PoseRecord]:
    """``cam_from_mesh`` and the record of the pose that is found for a frame; ``None`` and an empty one without."""
    registered = film_poses.of(scene)
    frame = None if registered is None else registered.frames.get(number)
    if registered is None or frame is None or frame.cam_from_model is None:
        return None, UNKNOWN
    return frame.cam_from_model @ inverse_rigid(registered.reference.mesh_from_model), film_poses.record_of(
        scene, number
    )


@contextmanager
def _all_or_none(written: Sequence[Path]) -> Iterator[None]:
    """Remove new pictures again if not all of what they are for succeeds, or the user stops it."""
    try:
        yield
    except Exception:
        for path in written:
            path.unlink(missing_ok=True)
        raise


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
        frame, record = (
            film_poses.frame_at(scene, self._at),
            film_poses.record_of(scene, film.scores.frames[self._at].index),
        )
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
            text += f", at its pose: {film_poses.text_of(frame.verdict)}"
        return text, *messages
