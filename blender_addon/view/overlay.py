"""Draws over the views that look through the frame's camera: the frame over the surface, contour, structures.

It draws after Blender's objects and before gizmos, texts and the marks of other tools, which therefore stay on top.
"""

from dataclasses import dataclass, replace

import bpy
import gpu
import numpy as np
from mathutils import Matrix

from ..class_registration import at_end
from ..pipeline.blender.bridge.camera import cam_from_model_of
from ..pipeline.transforms import inverse_rigid
from ..state import frame_in_view, from_scene
from ..ui.frame_view import FrameView, shows_frame
from ..ui.pane import Pane
from ..ui.strokes import Strokes
from .operators import ONEFRAME_PG_view
from .overlay_passes import Projection, SurfacePicture, placed_rectangle, shown_structures
from .overlay_shaders import composite_shader

_pictures: dict[tuple[int, int], SurfacePicture] = {}


@dataclass(frozen=True)
class Composite:
    """The picture drawn over the frame's rectangle.

    Attributes
    ----------
    picture
        The textures of the view.
    frame_view
        The mapping of the frame's pixels to the target; ``None`` if the target does not show the frame.
    image, frame_alpha
        The frame, and how much of it lies over the surface, 0 to 1.
    everywhere
        Whether the frame lies over all of its rectangle, and not over the surface alone.
    contour, structures
        Whether to draw the picture's lines, and its structures.
    """

    picture: SurfacePicture
    frame_view: FrameView | None = None
    image: bpy.types.Image | None = None
    frame_alpha: float = 0.0
    everywhere: bool = False
    contour: bool = False
    structures: bool = True

    def draw(self, view: ONEFRAME_PG_view, low: tuple[float, float], high: tuple[float, float]) -> None:
        """Draw the rectangle between two corners (px of the active viewport) with the scene's settings ``view``."""
        shader = composite_shader()
        shader.bind()
        frame = self.picture.structures if self.image is None else gpu.texture.from_image(self.image)
        shader.uniform_sampler("frame", frame)
        shader.uniform_sampler("geometry", self.picture.geometry)
        shader.uniform_sampler("structures", self.picture.structures)
        shader.uniform_sampler("lines", self.picture.lines)
        size, scale, offset = (1.0, 1.0), (1.0, 1.0), (0.0, 0.0)
        if self.frame_view is not None:
            size = self.frame_view.camera.size_wh
            scale, offset = self.frame_view.scale.tolist(), self.frame_view.offset.tolist()
        shader.uniform_float("frame_size", size)
        shader.uniform_float("frame_scale", scale)
        shader.uniform_float("frame_offset", offset)
        shader.uniform_float("line_colour", (*view.contour_color, 1.0))
        shader.uniform_float("line_px", max(1.0, bpy.context.preferences.system.pixel_size))
        shader.uniform_float("frame_alpha", 0.0 if self.image is None else self.frame_alpha)
        shader.uniform_bool("everywhere", (self.everywhere,))
        shader.uniform_bool("contour", (self.contour,))
        shader.uniform_bool("inside", (self.structures,))
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("ALPHA")
        placed_rectangle(shader, low, high, gpu.state.viewport_get()[2:]).draw(shader)
        gpu.state.blend_set("NONE")


def frame_image_of(scene: bpy.types.Scene) -> bpy.types.Image | None:
    """The frame's image behind the camera; ``None`` if there is none or its file does not exist."""
    backgrounds = from_scene.camera_object_of(scene).data.background_images
    image = backgrounds[0].image if backgrounds else None
    return image if image is not None and image.size[0] else None


class Overlay(Pane):
    """Frame, contour and structures over the surface; of views from elsewhere, structures alone."""

    place = "POST_VIEW"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return from_scene.is_set_up(context.scene)

    @classmethod
    def draw(cls, context: bpy.types.Context, strokes: Strokes) -> None:
        scene, region = context.scene, context.region
        surface = from_scene.surface_of(scene)
        if shows_frame(context):
            _draw_over_frame(context, scene)
        elif shown_structures(surface):
            picture = picture_of(region)
            picture.draw(_projection_of(context, 0.0), surface, contour=False)
            Composite(picture).draw(scene.oneframe_view, (0, 0), (region.width, region.height))


def _projection_of(context: bpy.types.Context, frame_mm_per_px: float) -> Projection:
    region, region_3d = context.region, context.region_data
    matrices = region_3d.view_matrix.copy(), region_3d.window_matrix.copy()
    return Projection(region.width, region.height, *matrices, frame_mm_per_px)


def _draw_over_frame(context: bpy.types.Context, scene: bpy.types.Scene) -> None:
    view, region, surface = scene.oneframe_view, context.region, from_scene.surface_of(scene)
    other, contour = frame_in_view.other(scene), view.contour
    # of another frame, Blender's own surface, at the pose of the case's, is covered
    frame_alpha = 1.0 if other is not None else 0.0 if surface.display_type == "WIRE" else 1 - view.opacity
    if not frame_alpha and not contour and not shown_structures(surface):
        return
    frame_view = FrameView.of(scene, region, context.region_data)
    picture, projection = picture_of(region), _projection_of(context, 1 / from_scene.camera(scene).fx)
    is_placed = other is None or other.cam_from_model is not None
    if other is not None and other.cam_from_model is not None:
        world_from_cam = inverse_rigid(cam_from_model_of(from_scene.camera_object_of(scene)))
        moved = Matrix(world_from_cam @ other.cam_from_model) @ surface.matrix_world.inverted()
        projection = replace(projection, view_from_world=projection.view_from_world @ moved)
    contour = contour and is_placed
    if is_placed:
        picture.draw(projection, surface, contour=contour)
    width, height = frame_view.camera.size_wh
    corners = frame_view.region_from_px([[-0.5, height - 0.5], [width - 0.5, -0.5]])
    low, high = np.clip(corners, 0, [region.width, region.height])
    if (low < high).all():
        everywhere, image = other is not None, frame_image_of(scene)
        composite = Composite(picture, frame_view, image, frame_alpha, everywhere, contour, structures=is_placed)
        composite.draw(view, tuple(low), tuple(high))


def picture_of(region: bpy.types.Region) -> SurfacePicture:
    """The picture of a region, created again when its size has changed."""
    window, size_wh = bpy.context.window, (region.width, region.height)
    # windows share textures, but not framebuffers
    place = (0 if window is None else window.as_pointer(), region.as_pointer())
    picture = _pictures.get(place)
    if picture is None or picture.size != size_wh:
        if len(_pictures) > 8:
            _pictures.clear()
        picture = _pictures[place] = SurfacePicture(*size_wh)
    return picture


PARTS = (at_end(_pictures.clear),)
