"""What anti-aliased views are measured against: many exact rays in every pixel, averaged as the masks say.

The frame counts as constant on its pixels, which are means over their squares already (see
:mod:`oneframe.colour.footprint_filter`). Of the rays in a pixel, those count that meet what the ray through its centre
does: surface that the frame saw, surface that it did not see, or background.
"""

from dataclasses import replace

import numpy as np

from oneframe.blender.render.cycles import CyclesScene
from oneframe.blender.render.engines import LARGEST_VIEW_PX
from oneframe.blender.render.material import filter_lookups
from oneframe.camera.pinhole import PinholeCamera
from oneframe.colour.shading import ColouredSurface, SurfaceColour
from oneframe.colour.vertex_colours import VertexColours
from oneframe.surface.mesh import TriangleMesh


def converged_view(
    mesh: TriangleMesh,
    colour: SurfaceColour,
    camera: PinholeCamera,
    cam_from_model: np.ndarray,
    *,
    along: int,
    constant: bool = True,
) -> np.ndarray:
    """``(H, W, 3)`` means over ``along`` x ``along`` rays in each pixel.

    Parameters
    ----------
    mesh, colour
        The surface, model frame, and its colours.
    camera, cam_from_model
        The view, at the frame's scale or coarser, and its pose (4x4, mm).
    along
        Number of rays along a pixel's side; odd, so that one of them goes through its centre.
    constant
        Whether the frame counts as constant on its pixels; otherwise it is interpolated, such as one of a finer scene.
    """
    parts = []
    # in bands: a view has a largest size
    rows = max(1, LARGEST_VIEW_PX // (camera.width * along**2))
    for top in range(0, camera.height, rows):
        band = replace(camera, height=min(rows, camera.height - top), cy=camera.cy - top)
        parts.append(_converged_band(mesh, colour, band, cam_from_model, along, constant))
    return np.concatenate(parts)


def _converged_band(
    mesh: TriangleMesh,
    colour: SurfaceColour,
    camera: PinholeCamera,
    cam_from_model: np.ndarray,
    along: int,
    constant: bool,
) -> np.ndarray:
    fine = camera.resized(camera.width * along, camera.height * along)
    with CyclesScene(ColouredSurface(mesh, (colour,)), fine, filtered=True) as scene:
        if constant and not isinstance(colour, VertexColours):
            for _, name in filter_lookups(0):
                scene.surface_object.data.materials[0].node_tree.nodes[name].interpolation = "Closest"
        rays = scene.render(cam_from_model)

    def by_pixel(values: np.ndarray) -> np.ndarray:
        """``(H along, W along, ...)`` -> ``(H, W, along^2, ...)``."""
        shape = (camera.height, along, camera.width, along, *values.shape[2:])
        return np.swapaxes(values.reshape(shape), 1, 2).reshape(*camera.shape_hw, along * along, *values.shape[2:])

    kind = by_pixel(rays.mask.astype(np.int8) + rays.observed)
    same = kind == kind[:, :, along * along // 2, None]
    return (by_pixel(rays.rgb) * same[..., None]).sum(axis=2) / same.sum(axis=2)[..., None]
