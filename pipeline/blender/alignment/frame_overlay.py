"""The frame with the surface's outline and the structures at its pose, to judge the alignment."""

import numpy as np

from ...case.loaded_case import LoadedCase
from ...images.overlay import Layer, draw_overlay
from ..render.engines import render_view
from ..render.surface_scene import SurfaceScene


def frame_overlay(loaded: LoadedCase, surface_depth_mm: np.ndarray | None = None) -> np.ndarray:
    """The frame with its overlay, ``(H, W, 3)`` float32 values 0..1.

    Parameters
    ----------
    loaded
        The case, at its pose.
    surface_depth_mm
        ``(H, W)`` depth of the surface in the frame, 0 where there is none; rendered if left out.
    """
    camera = loaded.case.camera
    if surface_depth_mm is None:
        with SurfaceScene(loaded.mesh, camera, None) as scene:
            surface_depth_mm = render_view(scene, loaded.cam_from_model).depth_mm
    layers = []
    for structure, mesh in loaded.structures:
        with SurfaceScene(mesh, camera, None) as scene:
            layers.append(Layer(render_view(scene, loaded.cam_from_model).depth_mm, structure.colour))
    return draw_overlay(loaded.image, surface_depth_mm, layers)
