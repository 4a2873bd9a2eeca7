"""The frame in the view as long as there is no K: then no camera shows it."""

from functools import lru_cache
from pathlib import Path

import bpy
import cv2
import gpu
import numpy as np
from gpu_extras.presets import draw_texture_2d

from ..class_registration import at_end
from ..state import from_scene, workbench
from ..state.scene_files import Stamp, known_stamp
from ..ui.pane import Pane
from ..ui.strokes import Strokes
from ..view.zoom import free_rectangle
from . import session


class FrameAlone(Pane):
    """The film's frame, or else the case's, in the free part of a 3D view."""

    order = -1

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return workbench.is_workbench(context.scene) and from_scene.present_camera(context.scene) is None

    @classmethod
    def draw(cls, context: bpy.types.Context, strokes: Strokes) -> None:
        scene = context.scene
        film, picture, size_wh = session.of(scene), None, (0, 0)
        if film is not None and scene.oneframe_video.visible:
            picture, size_wh = film.picture, film.scores.info.size_wh
        elif scene.oneframe.frame_path:
            path = from_scene.absolute_path(scene.oneframe.frame_path)
            picture = _frame(path, known_stamp(path))
            size_wh = (0, 0) if picture is None else (picture.shape[1], picture.shape[0])
        if picture is None:
            return
        low, high = free_rectangle(context.area)
        size = np.array(size_wh) * float(np.min((high - low) / size_wh))
        left, below = (low + high - size) / 2
        draw_texture_2d(_texture(picture, tuple(np.rint(size).astype(int).tolist())), (left, below), *size)


_latest: list[tuple[np.ndarray, gpu.types.GPUTexture]] = []
"""The picture that was drawn last, and its texture: a view is drawn again for every move of the pointer."""


def _texture(picture: np.ndarray, size_wh: tuple[int, int]) -> gpu.types.GPUTexture:
    """A picture ``(H, W, 3)`` uint8 RGB on the GPU, at its size on the screen, so that it is sharp there."""
    if _latest and _latest[0][0] is picture and (_latest[0][1].width, _latest[0][1].height) == size_wh:
        return _latest[0][1]
    shrinks = size_wh[0] < picture.shape[1]
    sized = cv2.resize(picture, size_wh, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    rgba = np.ones((size_wh[1], size_wh[0], 4), np.float32)
    # Blender's shader for images takes code values
    rgba[..., :3] = sized[::-1].astype(np.float32) / 255
    texture = gpu.types.GPUTexture(size_wh, format="RGBA8", data=gpu.types.Buffer("FLOAT", rgba.size, rgba))
    _latest[:] = [(picture, texture)]
    return texture


@lru_cache(maxsize=1)
def _frame(path: Path, stamp: Stamp) -> np.ndarray | None:
    """``(H, W, 3)`` uint8 RGB of the case's frame; ``None`` if it is gone, or OpenCV cannot read it."""
    image = cv2.imread(str(path), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION) if any(stamp) else None
    return None if image is None else cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


PARTS = (at_end(_frame.cache_clear, _latest.clear),)
