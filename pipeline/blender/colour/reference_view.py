"""The reference view of a dataset, as its engine renders it."""

from ...case.loaded_case import LoadedCase
from ...colour.reference_view import ReferenceView, traced_view_of, view_of_depths
from ...projection.rendered_view import RenderedView
from ..render.engines import render_view
from ..render.surface_scene import SurfaceScene


def reference_view_of(loaded: LoadedCase, engine: str = "cycles") -> ReferenceView:
    """Render each frame's own pose to find the surface that it saw: by ``"raster"`` if that is the engine, or Cycles.

    Raises
    ------
    InputError
        No pixel of a frame shows the surface, or there is no such engine here.
    """
    if engine == "raster":
        return traced_view_of(loaded)
    seen: list[RenderedView] = []
    for frame in loaded.frames:
        with SurfaceScene(loaded.surface.mesh, frame.camera) as surface_scene:
            seen.append(render_view(surface_scene, frame.cam_from_model))
    return view_of_depths(loaded, [each.depth_mm for each in seen], seen[0].observed)
