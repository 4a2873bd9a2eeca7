"""The engine ``soft``: views of the ray tracer, softened as by a lens that is a little out of focus."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...colour.ray_tracer import RayTracer
from ...colour.shading import ColouredSurface
from ...projection.rays import require_embree
from ...projection.rendered_view import Render, RenderedView
from .engines import Engine


@contextmanager
def _opened(surface: ColouredSurface, camera: PinholeCamera, samples: int, threads: int) -> Iterator[Render]:
    tracer = RayTracer(surface, camera, samples=samples)

    def render(cam_from_model: np.ndarray) -> RenderedView:
        view = tracer.render(cam_from_model)
        rows = (np.roll(view.rgb, 1, axis=0) + view.rgb + np.roll(view.rgb, -1, axis=0)) / 3
        soft = (np.roll(rows, 1, axis=1) + rows + np.roll(rows, -1, axis=1)) / 3
        return replace(view, rgb=soft * view.mask[..., None])

    yield render


ENGINE = Engine(_opened, require_embree, reference="raster")
