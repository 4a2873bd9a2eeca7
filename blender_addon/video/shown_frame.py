"""The film's frame in the view: behind the camera in place of the case's own, which stays that of the case.

As long as there is no K, no camera shows it: then it is drawn in the free part of the view.
"""

import time
from contextlib import suppress
from pathlib import Path

import bpy
import cv2
import gpu
import numpy as np
from bpy.app.handlers import persistent
from gpu_extras.presets import draw_texture_2d

from ..class_registration import at_end, listening, start_timer, timers
from ..pipeline.blender.alignment import alignment_scene
from ..pipeline.camera.distortion import undistort
from ..pipeline.errors import InputError
from ..pipeline.images.pixel_values import to_uint8
from ..state import from_scene, to_scene, workbench
from ..state.events import redraw
from ..ui.pane import Pane
from ..ui.strokes import Strokes
from ..view.zoom import free_rectangle
from . import session, timeline
from .session import AHEAD, FilmSession

IMAGE = "OneFrame film"
_FILE = "oneframe_film.bmp"

REST_S, POLL_S = 0.15, 0.05
"""So long a frame is in view before its full picture is decoded; how often that is asked for."""

_restored: list[str] = []
"""Scenes whose own frame is back while their file is being saved."""


def show(scene: bpy.types.Scene, at: int) -> None:
    """Bring a frame of the scene's film into view: a thumbnail at once, its full picture once it is decoded."""
    film = session.scored(scene)
    film.show(at)
    if scene.frame_current != film.score.index:
        scene.frame_current = film.score.index
    if bpy.app.background and not film.is_full:
        film.fetcher.wait(film.shown)
        film.show(film.shown)
    put(scene, film)
    if not film.is_full:
        start_timer(_poll, POLL_S)


def put(scene: bpy.types.Scene, film: FilmSession) -> None:
    """Put the film's picture behind the frame's camera; without a camera, the view draws it."""
    redraw()
    if not scene.oneframe_video.visible:
        return
    camera_object = from_scene.present_camera(scene)
    if camera_object is None:
        _image(film.picture)
    else:
        alignment_scene.show_frame(camera_object, _image(_undistorted(scene, film)), outside=1.0)


def restore(scene: bpy.types.Scene) -> None:
    """Show the case's own frame again."""
    redraw()
    camera_object = from_scene.present_camera(scene)
    if camera_object is None or not is_shown(scene):
        return
    with suppress(InputError, RuntimeError):  # its file has moved: the panel View reports it
        if scene.oneframe.frame_path:
            to_scene.show_frame(scene)
            return
    camera_object.data.background_images[0].image = None


def is_shown(scene: bpy.types.Scene) -> bool:
    """Whether the view shows a frame of the film behind the camera."""
    camera_object = from_scene.present_camera(scene)
    if camera_object is None or not camera_object.data.background_images:
        return False
    image = camera_object.data.background_images[0].image
    return image is not None and image.name == IMAGE


def _undistorted(scene: bpy.types.Scene, film: FilmSession) -> np.ndarray:
    lens, camera = from_scene.distortion(scene), from_scene.camera(scene)
    if lens is None or film.scores.info.size_wh != camera.size_wh:
        return film.picture
    height, width = film.picture.shape[:2]
    values = np.asarray(film.picture, np.float32) / 255
    return to_uint8(undistort(values, camera.resized(width, height), lens)[0])


def _image(picture: np.ndarray) -> bpy.types.Image:
    """The picture as a Blender image: of a file, since Blender would ask to save an image that only memory holds."""
    path = Path(bpy.app.tempdir) / _FILE
    _, data = cv2.imencode(".bmp", np.ascontiguousarray(picture[..., ::-1]))
    path.write_bytes(data.tobytes())
    image = bpy.data.images.get(IMAGE)
    if image is None:
        image = bpy.data.images.load(str(path))
        image.name = IMAGE
    else:
        image.filepath = str(path)
        image.reload()
    return image


def _poll() -> float | None:
    """Timer: show the full picture once it is decoded; stops when nothing is missing."""
    waiting = False
    for scene in bpy.data.scenes:
        film = session.of(scene)
        if film is None or film.is_full or not scene.oneframe_video.visible:
            continue
        if from_scene.present_camera(scene) is not None and not is_shown(scene):
            # the case's frame is in view again
            continue
        if film.fetcher.failure(film.shown):
            # the panel reports it
            redraw()
            continue
        if film.fetcher.frame(film.shown) is not None:
            film.show(film.shown)
            put(scene, film)
            continue
        waiting = True
        if time.monotonic() - film.shown_since > REST_S:
            film.fetcher.want(film.shown)
    return POLL_S if waiting else None


@persistent
def _after_frame_change(scene: bpy.types.Scene, *_: object) -> None:
    """The user has gone to another frame, in the Timeline or by keys."""
    film = session.of(scene)
    if film is not None and scene.oneframe_video.visible:
        at = timeline.position(film, scene.frame_current)
        if at != film.shown or not is_shown(scene):
            show(scene, at)
        screen = bpy.context.screen
        if screen is not None and screen.is_animation_playing:
            film.fetcher.want(min(at + AHEAD, len(film.times_s) - 1))


@persistent
def _before_saving(*_: object) -> None:
    _restored[:] = [scene.name for scene in bpy.data.scenes if is_shown(scene)]
    for name in _restored:
        restore(bpy.data.scenes[name])


@persistent
def _after_saving(*_: object) -> None:
    for name in _restored:
        scene = bpy.data.scenes.get(name)
        film = None if scene is None else session.of(scene)
        if scene is not None and film is not None:
            put(scene, film)
    _restored.clear()


@persistent
def _after_undo(*_: object) -> None:
    scene = workbench.existing()
    film = None if scene is None else session.return_to(scene)
    if scene is not None and film is not None:
        timeline.lay_out(scene, film)
        timeline.settle_soon()
        put(scene, film)


def _remove() -> None:
    for scene in bpy.data.scenes:
        restore(scene)
    image = bpy.data.images.get(IMAGE)
    if image is not None:
        bpy.data.images.remove(image)


class FrameAlone(Pane):
    """The film's frame, or else the case's, in the free part of a 3D view."""

    order = -1

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return workbench.is_workbench(context.scene) and from_scene.present_camera(context.scene) is None

    @classmethod
    def draw(cls, context: bpy.types.Context, strokes: Strokes) -> None:
        scene, image = context.scene, bpy.data.images.get(IMAGE)
        if session.of(scene) is None or not scene.oneframe_video.visible:
            path = from_scene.absolute_path(scene.oneframe.frame_path) if scene.oneframe.frame_path else None
            files = ((from_scene.absolute_path(each.filepath), each) for each in bpy.data.images if each.filepath)
            image = next((each for file, each in files if file == path), None)
        if image is None or not image.size[0]:
            return
        low, high = free_rectangle(context.area)
        size = np.array(image.size) * float(np.min((high - low) / image.size))
        left, below = (low + high - size) / 2
        draw_texture_2d(
            gpu.texture.from_image(image), (left, below), *size, is_scene_linear_with_rec709_srgb_target=True
        )


PARTS = (
    at_end(_remove),
    timers(_poll),
    listening(bpy.app.handlers.frame_change_post, _after_frame_change),
    listening(bpy.app.handlers.undo_post, _after_undo),
    listening(bpy.app.handlers.redo_post, _after_undo),
    listening(bpy.app.handlers.save_pre, _before_saving),
    listening(bpy.app.handlers.save_post, _after_saving),
    listening(bpy.app.handlers.save_post_fail, _after_saving),
)
