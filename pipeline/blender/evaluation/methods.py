"""The methods that an evaluation compares: this program's colour modes and engines, and the paper's own method."""

import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...colour.shading import ColouredSurface, SurfaceColour
from ...colour.vertex_colours import VertexColours
from ...dataset.options import COLOURS, ENGINES, UNSEEN
from ...errors import InputError
from ...evaluation.baseline import projected_colours, pyvista_renderer
from ...files.keys import nearest_name
from ...images.pixel_values import to_uint8
from ...transforms import transform_points
from ..colour.reference_view import ReferenceView, colours_of, unseen_colours_of
from ..render.engines import engine_named, opened_engine

Render = Callable[[np.ndarray], np.ndarray]
"""From ``cam_from_model`` (4x4, mm) to ``(H, W, 3)`` float32 code values 0..1."""

PAPER, PAPER_CLAMPED = "paper", "paper-clamped"
"""The colour of the paper's method: per vertex, without a test of visibility; black outside the frame, or clamped."""


@dataclass(frozen=True)
class Method:
    """A way to make a view.

    Attributes
    ----------
    key, name
        On the command line; in tables and charts.
    colour
        One of :data:`.COLOURS`, :data:`PAPER` or :data:`PAPER_CLAMPED`.
    renderer
        One of :data:`oneframe.dataset.options.ENGINES`, or ``"pyvista"``.
    unseen
        What surface looks like that the frame did not see: one of :data:`oneframe.dataset.options.UNSEEN`.
    """

    key: str
    name: str
    colour: str
    renderer: str
    unseen: str = "neutral"

    @property
    def peer(self) -> bool:
        """Whether the method is the paper's, not this program's."""
        return self.colour in (PAPER, PAPER_CLAMPED)


def _ours(colour: str, engine: str, unseen: str = "neutral") -> Method:
    words = (colour, engine) if unseen == "neutral" else (colour, unseen, engine)
    return Method("-".join(words), "ours, " + ", ".join(words), colour, engine, unseen)


METHODS = {
    method.key: method
    for method in (
        *(_ours(colour, engine, unseen) for unseen in UNSEEN for engine in ENGINES for colour in COLOURS),
        Method("paper-pyvista", "paper (PyVista)", PAPER, "pyvista"),
        Method("paper-clamped-pyvista", "paper, clamped (PyVista)", PAPER_CLAMPED, "pyvista"),
        Method("paper-cycles", "paper's colours (Cycles)", PAPER, "cycles"),
        Method("paper-clamped-cycles", "paper's colours, clamped (Cycles)", PAPER_CLAMPED, "cycles"),
    )
}
DEFAULT = (
    "projective-raster",
    "projective-fill-raster",
    "texture-raster",
    "vertex-raster",
    "projective-eevee",
    "paper-pyvista",
    "paper-clamped-pyvista",
)
EVERY = "all"


def chosen_methods(keys: Sequence[str]) -> tuple[Method, ...]:
    """The methods of some keys, or all of them for :data:`EVERY`.

    Raises
    ------
    InputError
        An unknown key.
    """
    for key in keys:
        if key not in METHODS and key != EVERY:
            raise InputError(f"--methods: unknown method {key!r}; {nearest_name(key, (*METHODS, EVERY))}")
    return tuple(METHODS[key] for key in (METHODS if EVERY in keys else dict.fromkeys(keys)))


def skipped_because(methods: Sequence[Method]) -> dict[str, str]:
    """Why methods cannot run on this computer, by key; those that can are left out."""
    failed = {renderer: _failure(renderer) for renderer in {method.renderer for method in methods}}
    return {method.key: failed[method.renderer] for method in methods if failed[method.renderer]}


def _failure(renderer: str) -> str:
    if renderer == "pyvista":
        if find_spec("pyvista") is None:
            return "PyVista is not installed (pip install pyvista)"
        # without OpenGL, VTK ends the process
        trial = (
            "import pyvista; p = pyvista.Plotter(off_screen=True, window_size=(8, 8)); p.add_mesh(pyvista.Sphere()); "
            "p.show(auto_close=False); p.screenshot(None, return_img=True)"
        )
        path = f"import sys; sys.path[:] = {sys.path!r}; "
        ended = subprocess.run([sys.executable, "-c", path + trial], capture_output=True, check=False)
        return "" if ended.returncode == 0 else "PyVista gets no OpenGL context on this machine"
    try:
        engine_named(renderer).check()
    except InputError:
        return "embreex is not installed" if renderer == "raster" else "Blender gets no OpenGL context on this machine"
    return ""


@contextmanager
def opened(
    method: Method, source: ReferenceView, camera: PinholeCamera, poses: Sequence[np.ndarray]
) -> Iterator[Render]:
    """Prepare a method for a reference view; inside the block it renders.

    Parameters
    ----------
    method
        One that can run, see :func:`skipped_because`.
    source
        The frame's view of the surface.
    camera
        Intrinsics of the views.
    poses
        All poses that will be rendered, for the clipping planes of renderers that have fixed ones.
    """
    if method.renderer == "pyvista":
        codes, depths = to_uint8(_paper_colours(method, source)), _depth_range(source, poses)
        render = pyvista_renderer(source.mesh, codes, camera, samples=1, lit=False, depth_range_mm=depths)
        yield lambda pose: render(pose).astype(np.float32) / 255
        return
    surface = ColouredSurface(source.mesh, _colours(method, source), unseen_colours_of(source, method.unseen))
    with opened_engine(method.renderer, surface, camera) as render_view:
        yield lambda pose: render_view(pose).rgb


def _colours(method: Method, source: ReferenceView) -> tuple[SurfaceColour, ...]:
    if method.peer:
        rgb = _paper_colours(method, source)
        everywhere = np.ones(len(rgb), bool)
        return (VertexColours(rgb, everywhere, everywhere),)
    return tuple(colours_of(source, method.colour)[0])


def _paper_colours(method: Method, source: ReferenceView) -> np.ndarray:
    view, clamped = source.view, method.colour == PAPER_CLAMPED
    return projected_colours(source.mesh, view.image, view.camera, view.cam_from_model, clamped=clamped)


def _depth_range(source: ReferenceView, poses: Sequence[np.ndarray]) -> tuple[float, float]:
    """Clipping planes in mm around the surface, from all of the poses."""
    radius = source.mesh.radius
    depths = [float(transform_points(pose, np.zeros((1, 3)))[0, 2]) for pose in poses]
    far = 1.01 * (max(depths) + radius)
    return max(0.99 * (min(depths) - radius), 1e-3 * far), far
