"""A loupe that shows the frame around an image point while it is dragged, at any zoom and even under the surface."""

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ..ui.frame_view import FrameView, window_region
from ..ui.strokes import Colour, Strokes
from ..view.fit import free_rectangle
from ..view.overlay import frame_image_of
from .gestures import Gesture

SIDE, DISTANCE = 170.0, 60.0
"""Size of the loupe and its distance from the point, in pixels at interface scale 1."""

MAGNIFICATION = 3.0
"""Relative to the view, and at least this many screen pixels per frame pixel."""

WHITE: Colour = (1.0, 1.0, 1.0, 1.0)


def draw(context: bpy.types.Context, gesture: Gesture) -> None:
    """Draw the loupe for the image point that is being dragged in the camera view.

    Raises
    ------
    InputError
        There is no camera.
    """
    scene, region = context.scene, window_region(context.area)
    image = frame_image_of(scene)
    if image is None:
        return
    frame = FrameView.of(scene, region, context.space_data.region_3d)
    strokes = Strokes()
    scale = MAGNIFICATION * max(1.0, frame.magnification)
    half_px = SIDE * strokes.unit / 2 / scale
    pixel = frame.px_from_region(gesture.at)
    centre = _loupe_centre(gesture.at, context.area, strokes.unit)
    _draw_image(image, frame, centre, pixel, half_px, SIDE * strokes.unit / 2)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * SIDE * strokes.unit / 2
    strokes.line(centre + corners, WHITE, width=1.5, closed=True)
    strokes.cross(centre, 4, 16, WHITE, width=1.5)
    strokes.text(
        centre - np.array([SIDE / 2 - 6, SIDE / 2 - 8]) * strokes.unit,
        f"{pixel[0]:.1f}, {pixel[1]:.1f} px",
        WHITE,
    )
    strokes.draw()


def _loupe_centre(at: np.ndarray, area: bpy.types.Area, unit: float) -> np.ndarray:
    """``(2,)`` centre of the loupe in the region: above and right of the point, or opposite if there is no room."""
    distance = (DISTANCE + SIDE / 2) * unit
    low, high = free_rectangle(area)
    half = SIDE * unit / 2
    direction = np.where(at + distance + half < high, 1.0, -1.0)
    return np.clip(np.asarray(at, float) + direction * distance, low + half, np.maximum(high - half, low + half))


def _draw_image(
    image: bpy.types.Image, frame: FrameView, centre: np.ndarray, pixel: np.ndarray, half_px: float, half: float
) -> None:
    size = np.array(frame.camera.size_wh, float)
    # only what the frame shows: beyond its border the view stays visible
    low, high = np.maximum(pixel - half_px, -0.5), np.minimum(pixel + half_px, size - 0.5)
    if (low >= high).any():
        return
    seen = np.array([[low[0], high[1]], [high[0], high[1]], [high[0], low[1]], [low[0], low[1]]])
    places = centre + (seen - pixel) / half_px * [half, -half]
    # pixel (0, 0) is the centre of the top-left pixel; texture coordinates start at the lower left corner
    texture_at = (seen + 0.5) / size
    texture_at[:, 1] = 1 - texture_at[:, 1]
    shader = gpu.shader.from_builtin("IMAGE_SCENE_LINEAR_TO_REC709_SRGB")
    fields = {"pos": np.float32(places), "texCoord": np.float32(texture_at)}
    batch = batch_for_shader(shader, "TRIS", fields, indices=((0, 1, 2), (0, 2, 3)))
    shader.bind()
    shader.uniform_sampler("image", gpu.texture.from_image(image))
    batch.draw(shader)
