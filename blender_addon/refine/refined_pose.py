"""The refinement of the scene's pose: on arrays only, so that it may run in a thread."""

from collections.abc import Callable

import bpy
import numpy as np

from ..pipeline.alignment.refinement.refine import refine_pose
from ..pipeline.alignment.refinement.verdict import Refinement
from ..pipeline.blender.colour.surface_colour import colour_record, vertex_codes
from ..pipeline.case.loaded_case import LoadedCase
from ..state import from_scene


def refined(
    loaded: LoadedCase, colours: np.ndarray | None, progress: Callable[[float], None] | None = None
) -> Refinement:
    """Refine the case's pose against its frame; arguments as for :func:`refine_pose`."""
    return refine_pose(
        loaded.frame.image,
        loaded.frame.valid,
        loaded.frame.camera,
        loaded.surface.mesh,
        loaded.frame.cam_from_model,
        colours=colours,
        progress=progress,
    )


def known_colours(scene: bpy.types.Scene) -> np.ndarray | None:
    """``(V, 3)`` colours of the vertices that are evidence for the pose, or ``None``.

    Colours projected from the current frame are not: they would only confirm the pose of that projection.
    """
    surface = from_scene.surface_of(scene)
    record = colour_record(surface)
    if record is None or record["frame"] == str(from_scene.absolute_path(scene.oneframe.frame_path)):
        return None
    codes = vertex_codes(surface)
    if codes is None or np.isnan(codes).all():
        return None
    # the mean colour for vertices without one: it carries no evidence
    return np.where(np.isnan(codes), np.nanmean(codes, axis=0), codes)
