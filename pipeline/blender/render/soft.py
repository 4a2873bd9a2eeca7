"""The engine ``soft``: the colours of ``raster`` as means over three pixels of a row."""

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
    yield lambda cam_from_model: _softened(tracer.render(cam_from_model))


def _softened(view: RenderedView) -> RenderedView:
    mean = (np.roll(view.rgb, 1, axis=1) + view.rgb + np.roll(view.rgb, -1, axis=1)) / 3
    return replace(view, rgb=np.where(view.mask[..., None], mean, 0).astype(np.float32))


ENGINE = Engine(_opened, require_embree, reference="raster")
