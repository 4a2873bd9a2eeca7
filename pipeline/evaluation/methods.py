"""The methods that an evaluation compares: this program's colour modes and engines, and the paper's own method."""

import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..colour.reference_view import ReferenceView, colours_of, unseen_colours_of, without_shadows
from ..colour.shading import ColouredSurface, SurfaceColour
from ..colour.vertex_colours import VertexColours
from ..dataset.options import COLOURS, ENGINES, LENS, NONE, SHADOWS, UNSEEN
from ..errors import InputError, RunError
from ..files.keys import nearest_name
from ..images.pixel_values import to_uint8
from ..projection.rendered_view import Render
from ..transforms import transform_points
from .baseline import projected_colours, pyvista_renderer

ViewOf = Callable[[np.ndarray], np.ndarray]
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
    light
        One of :data:`oneframe.dataset.options.LIGHTS`: cases without a light at the lens are refused those in it.
    """

    key: str
    name: str
    colour: str
    renderer: str
    unseen: str = "neutral"
    light: str = NONE

    @property
    def peer(self) -> bool:
        """Whether the method is the paper's, not this program's."""
        return self.colour in (PAPER, PAPER_CLAMPED)


def _ours(colour: str, engine: str, unseen: str = "neutral", light: str = NONE) -> Method:
    words = [colour, *([] if unseen == "neutral" else [unseen]), *([] if light == NONE else [light]), engine]
    return Method("-".join(words), "ours, " + ", ".join(words), colour, engine, unseen, light)


METHODS = {
    method.key: method
    for method in (
        *(_ours(colour, engine, unseen) for unseen in UNSEEN for engine in ENGINES for colour in COLOURS),
        *(_ours("projective", engine, unseen, LENS) for unseen in UNSEEN for engine in ENGINES),
        # shadow maps are too coarse
        *(_ours("projective", engine, unseen, SHADOWS) for unseen in UNSEEN for engine in ENGINES if engine != "eevee"),
        Method("paper-pyvista", "paper (PyVista)", PAPER, "pyvista"),
        Method("paper-clamped-pyvista", "paper, clamped (PyVista)", PAPER_CLAMPED, "pyvista"),
        Method("paper-cycles", "paper's colours (Cycles)", PAPER, "cycles"),
        Method("paper-clamped-cycles", "paper's colours, clamped (Cycles)", PAPER_CLAMPED, "cycles"),
    )
}
DEFAULT = (
    "projective-raster",
    "projective-fill-raster",
    "vertex-raster",
    "projective-eevee",
    "paper-pyvista",
    "paper-clamped-pyvista",
)


@dataclass(frozen=True)
class Renderers:
    """What Blender's room renders with.

    Attributes
    ----------
    check
        Raises InputError if the engine of this name cannot render on this machine.
    opened
        Opens the engine of a name for a surface and a camera.
    blender
        Version of Blender.
    """

    check: Callable[[str], None]
    opened: Callable[[str, ColouredSurface, PinholeCamera], AbstractContextManager[Render]]
    blender: str


@dataclass(frozen=True)
class ChosenMethods:
    """The methods that can run on this machine, why others cannot, and what they render with."""

    running: tuple[Method, ...]
    skipped: Mapping[Method, str]
    renderers: Renderers


def chosen_methods(keys: Sequence[str], renderers: Renderers) -> ChosenMethods:
    """The methods of some keys."""
    for key in keys:
        if key not in METHODS:
            raise InputError(f"--methods: unknown method {key!r}; {nearest_name(key, tuple(METHODS))}")
    methods = [METHODS[key] for key in dict.fromkeys(keys)]
    failed = {renderer: _failure(renderer, renderers) for renderer in {method.renderer for method in methods}}
    running = tuple(method for method in methods if not failed[method.renderer])
    if not running:
        raise RunError("; ".join(f"{method.key}: {failed[method.renderer]}" for method in methods))
    return ChosenMethods(
        running, {method: failed[method.renderer] for method in methods if method not in running}, renderers
    )


def _failure(renderer: str, renderers: Renderers) -> str:
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
        renderers.check(renderer)
    except InputError as error:
        return str(error).partition("; ")[0]
    return ""


@contextmanager
def opened(
    method: Method, renderers: Renderers, reference: ReferenceView, camera: PinholeCamera, poses: Sequence[np.ndarray]
) -> Iterator[ViewOf]:
    """Prepare a method for a reference view; inside the block it renders.

    Parameters
    ----------
    method, renderers
        One that can run, see :func:`chosen_methods`, and what it renders with.
    reference
        The frame's view of the surface, without its light for methods in that of the lens.
    camera
        Intrinsics of the views.
    poses
        All poses that will be rendered, for the clipping planes of renderers that have fixed ones.
    """
    if method.renderer == "pyvista":
        codes, depths = to_uint8(_paper_colours(method, reference)), _depth_range(reference, poses)
        render = pyvista_renderer(reference.mesh, codes, camera, samples=1, lit=False, depth_range_mm=depths)
        yield lambda pose: render(pose).astype(np.float32) / 255
        return
    if method.unseen == "fill":
        reference = without_shadows(reference)
    unseen = unseen_colours_of(reference, method.unseen)
    surface = ColouredSurface(reference.mesh, _colours(method, reference), unseen, light=reference.light)
    with renderers.opened(method.renderer, surface, camera) as render_view:
        yield lambda pose: render_view(pose).rgb


def _colours(method: Method, reference: ReferenceView) -> tuple[SurfaceColour, ...]:
    if method.peer:
        rgb = _paper_colours(method, reference)
        everywhere = np.ones(len(rgb), bool)
        return (VertexColours(rgb, everywhere, everywhere),)
    return tuple(colours_of(reference, method.colour)[0])


def _paper_colours(method: Method, reference: ReferenceView) -> np.ndarray:
    view, clamped = reference.view, method.colour == PAPER_CLAMPED
    return projected_colours(reference.mesh, view.image, view.camera, view.cam_from_model, clamped=clamped)


def _depth_range(reference: ReferenceView, poses: Sequence[np.ndarray]) -> tuple[float, float]:
    """Clipping planes in mm around the surface, from all of the poses."""
    radius = reference.mesh.radius
    depths = [float(transform_points(pose, np.zeros((1, 3)))[0, 2]) for pose in poses]
    far = 1.01 * (max(depths) + radius)
    return max(0.99 * (min(depths) - radius), 1e-3 * far), far
