"""The engine ``raster``: Cycles' pixels in less time, by :class:`oneframe.colour.ray_tracer.RayTracer`."""

from collections.abc import Iterator
from contextlib import contextmanager

from ...camera.pinhole import PinholeCamera
from ...colour.ray_tracer import RayTracer
from ...colour.shading import ColouredSurface
from ...kernels.compiled import require_compiler
from ...projection.rendered_view import Render
from .engines import Engine


@contextmanager
def _opened(surface: ColouredSurface, camera: PinholeCamera, samples: int, threads: int) -> Iterator[Render]:
    # one thread renders, whatever is allowed
    yield RayTracer(surface, camera, samples=samples).render


ENGINE = Engine(_opened, require_compiler)
