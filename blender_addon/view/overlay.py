"""Draws over the views that look through the frame's camera: opacity, contour, blink, swipe, difference; structures.

It draws after Blender's objects and before gizmos, texts and the marks of other tools, which therefore stay on top.
"""

from dataclasses import dataclass, replace

import bpy
import gpu
import numpy as np
from mathutils import Matrix

from ..class_registration import at_end, drawing, start_timer, timers
from ..pipeline.blender.bridge.camera import cam_from_model_of
from ..pipeline.errors import InputError
from ..pipeline.transforms import inverse_rigid
from ..state import another_frame, from_scene
from ..state.events import areas
from ..ui.frame_view import FrameView, shows_frame
from .operators import ONEFRAME_PG_view
from .overlay_passes import Projection, SurfacePicture, placed_rectangle, shown_structures
from .overlay_shaders import MODES, composite_shader

BLINK_S = 0.25
"""Half the period of 2 Hz."""

_pictures: dict[tuple[int, int], SurfacePicture] = {}
_blink_shows_frame = True


@dataclass(frozen=True)
class Composite:
    """The picture drawn over the frame's rectangle.

    Attributes
    ----------
    mode
        One of ``MODES`` of the shaders.
    frame_view
        The mapping of the frame's pixels to the target; ``None`` if the target does not show the frame.
    image
        The frame; ``None`` only for modes that do not show it.
    picture
        The picture of the surface, with its lower left corner at ``origin`` of the target.
    contour
        Whether to draw the picture's lines.
    target_encodes
        Whether the target encodes linear values as sRGB, as the overlays of a 3D view do.
    """

    mode: str
    frame_view: FrameView | None
    image: bpy.types.Image | None
    picture: SurfacePicture
    contour: bool
    origin: tuple[float, float] = (0.0, 0.0)
    target_encodes: bool = True

    def draw(self, view: ONEFRAME_PG_view, low: tuple[float, float], high: tuple[float, float]) -> None:
        """Draw the rectangle between two corners (px of the active viewport) with the scene's settings ``view``."""
        shader = composite_shader()
        shader.bind()
        frame = self.picture.picture if self.image is None else gpu.texture.from_image(self.image)
        shader.uniform_sampler("frame", frame)
        shader.uniform_sampler("picture", self.picture.picture)
        shader.uniform_sampler("structures", self.picture.structures)
        shader.uniform_sampler("lines", self.picture.lines)
        size, scale, offset = (1.0, 1.0), (1.0, 1.0), (0.0, 0.0)
        if self.frame_view is not None:
            size = self.frame_view.camera.size_wh
            scale, offset = self.frame_view.scale.tolist(), self.frame_view.offset.tolist()
        shader.uniform_float("frame_size", size)
        shader.uniform_float("frame_scale", scale)
        shader.uniform_float("frame_offset", offset)
        shader.uniform_float("picture_origin", self.origin)
        shader.uniform_float("line_colour", (*view.contour_color, 1.0))
        shader.uniform_float("line_px", max(1.0, bpy.context.preferences.system.pixel_size))
        shader.uniform_float("split_px", view.split * size[0] - 0.5)
        shader.uniform_float("gain", view.gain)
        shader.uniform_float("opacity", view.opacity)
        shader.uniform_float("white", self.picture.white)
        shader.uniform_int("mode", MODES.index(self.mode))
        shader.uniform_bool("contour", (self.contour,))
        shader.uniform_bool("target_encodes", (self.target_encodes,))
        shader.uniform_bool("coloured", (self.picture.coloured,))
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("ALPHA")
        placed_rectangle(shader, low, high, gpu.state.viewport_get()[2:]).draw(shader)
        gpu.state.blend_set("NONE")


def frame_image_of(scene: bpy.types.Scene) -> bpy.types.Image | None:
    """The frame's image behind the camera; ``None`` if there is none or its file does not exist."""
    backgrounds = from_scene.camera_object_of(scene).data.background_images
    image = backgrounds[0].image if backgrounds else None
    return image if image is not None and image.size[0] else None


def projection_of(
    scene: bpy.types.Scene, region: bpy.types.Region, region_3d: bpy.types.RegionView3D, *, frame: bool
) -> Projection:
    """The projection of a region; ``frame`` says whether it looks through the frame's camera."""
    mm_per_px = 1 / from_scene.camera(scene).fx if frame else 0.0
    return Projection(
        region.width, region.height, region_3d.view_matrix.copy(), region_3d.window_matrix.copy(), mm_per_px
    )


def _at_pose(projection: Projection, scene: bpy.types.Scene, cam_from_model: np.ndarray) -> Projection:
    """The projection that shows the surface, which stays where it is, at another pose."""
    world_from_cam = inverse_rigid(cam_from_model_of(from_scene.camera_object_of(scene)))
    moved = Matrix(world_from_cam @ cam_from_model) @ from_scene.surface_of(scene).matrix_world.inverted()
    return replace(projection, view_from_world=projection.view_from_world @ moved)


def draw_view() -> None:
    """Draw over the view that Blender is drawing now (a POST_VIEW draw handler)."""
    context = bpy.context
    scene, space = context.scene, context.space_data
    if not from_scene.is_set_up(scene) or space is None or space.type != "VIEW_3D":
        return
    if shows_frame(context):
        _draw_over_frame(context, scene)
    elif shown_structures(from_scene.surface_of(scene)):
        region = context.region
        picture = picture_of(region.as_pointer(), region.width, region.height)
        projection = projection_of(scene, region, context.region_data, frame=False)
        picture.draw(projection, from_scene.surface_of(scene), None)
        composite = Composite("NONE", None, None, picture, contour=False)
        composite.draw(scene.oneframe_view, (0, 0), (region.width, region.height))


def _draw_over_frame(context: bpy.types.Context, scene: bpy.types.Scene) -> None:
    view, region = scene.oneframe_view, context.region
    mode, contour, other = view.comparison, view.contour, another_frame.seen(scene)
    # of another frame, Blender's own surface, at the pose of the case's, is covered
    if mode == "NONE" and (other is not None or (not view.wireframe and view.opacity < 1)):
        mode = "FADE"
    if other is not None and other.cam_from_model is None:
        mode, contour = "FRAME", False
    if mode == "NONE" and not contour and not shown_structures(from_scene.surface_of(scene)):
        return
    try:
        frame_view = FrameView.of(scene, region, context.region_data)
        image = frame_image_of(scene)
        projection = projection_of(scene, region, context.region_data, frame=True)
        if other is not None and other.cam_from_model is not None:
            projection = _at_pose(projection, scene, other.cam_from_model)
    except InputError:
        # the panel reports it
        return
    if image is None:
        mode = "NONE"
    if mode == "BLINK":
        start_timer(_blink, BLINK_S)
        mode = "FRAME" if _blink_shows_frame else "SURFACE"
    picture = picture_of(region.as_pointer(), region.width, region.height)
    picture.draw(projection, from_scene.surface_of(scene), view.crease_deg if contour else None)
    low, high = frame_rectangle(frame_view, region)
    if (low < high).all():
        Composite(mode, frame_view, image, picture, contour).draw(view, tuple(low), tuple(high))


def picture_of(key: int, width: int, height: int) -> SurfacePicture:
    """The picture of a region or a loupe, created again when its size has changed."""
    window = bpy.context.window
    # windows share textures, but not framebuffers
    place = (0 if window is None else window.as_pointer(), key)
    kept = _pictures.get(place)
    if kept is None or kept.size != (width, height):
        if len(_pictures) > 8:
            _pictures.clear()
        kept = _pictures[place] = SurfacePicture(width, height)
    return kept


def frame_rectangle(frame_view: FrameView, region: bpy.types.Region) -> tuple[np.ndarray, np.ndarray]:
    """Lower left and upper right corner (region px) of the visible rectangle of the frame."""
    width, height = frame_view.camera.size_wh
    corners = frame_view.region_from_px([[-0.5, height - 0.5], [width - 0.5, -0.5]])
    low, high = np.clip(corners, 0, [region.width, region.height])
    return low, high


def _blink() -> float | None:
    """Timer: switch between frame and surface in all blinking views; stops when there are none."""
    global _blink_shows_frame
    # toggled rather than read off a clock: slow redraws would sample a clock at random
    _blink_shows_frame = not _blink_shows_frame
    blinking = False
    for window, area in areas("VIEW_3D"):
        in_camera = area.spaces.active.region_3d.view_perspective == "CAMERA"
        if window.scene.oneframe_view.comparison == "BLINK" and in_camera:
            area.tag_redraw()
            blinking = True
    return BLINK_S if blinking else None


PARTS = (at_end(_pictures.clear), timers(_blink), drawing(bpy.types.SpaceView3D, draw_view, "POST_VIEW"))
