"""The reference view of a dataset, as its engine renders it."""

from ...case.loaded_case import LoadedCase
from ...colour.reference_view import ReferenceView, view_of_depths
from ...colour.shading import ColouredSurface
from ...projection.rendered_view import RenderedView
from ..render.engines import engine_named, opened_engine


def reference_view_of(loaded: LoadedCase, engine: str = "cycles") -> ReferenceView:
    """Render each frame's own pose to find the surface that it saw, by the :attr:`.Engine.reference` of an engine.

    Raises
    ------
    InputError
        No pixel of a frame shows the surface, or there is no such engine here.
    """
    engine = engine_named(engine).reference or engine
    seen: list[RenderedView] = []
    for frame in loaded.frames:
        with opened_engine(engine, ColouredSurface(loaded.surface.mesh), frame.camera) as render:
            seen.append(render(frame.cam_from_model))
    return view_of_depths(loaded, [each.depth_mm for each in seen], seen[0].observed)
