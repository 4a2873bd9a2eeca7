"""The frame with the surface's outline and the structures at its pose, to judge the alignment."""

import numpy as np

from ...case.loaded_case import LoadedCase
from ...images.overlay import draw_overlay
from ...projection.overlay_scene import OverlayScene


def frame_overlay(loaded: LoadedCase, surface_depth_mm: np.ndarray | None = None) -> np.ndarray:
    """The frame with its overlay, ``(H, W, 3)`` float32 values 0..1.

    Parameters
    ----------
    loaded
        The case, at its pose; of its structures, those of :meth:`.LoadedCase.with_shown_structures`.
    surface_depth_mm
        ``(H, W)`` depth of the surface in the frame, 0 where there is none; rasterised if left out.
    """
    frame = loaded.frame
    camera, pose = frame.camera, frame.cam_from_model
    scene = overlay_scene(loaded.with_shown_structures())
    return draw_overlay(frame.image, scene.surface_layer(camera, pose, surface_depth_mm), scene.layers(camera, pose))


def overlay_scene(loaded: LoadedCase) -> OverlayScene:
    """The surface and the structures of a case."""
    surface = loaded.surface
    return OverlayScene.of(surface.mesh, [(mesh, structure.colour) for structure, mesh in surface.structures])
