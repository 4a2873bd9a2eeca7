"""The reference view: the frames of a case as sources of colour, and the surface that each saw.

Coloured surfaces take that surface from a z-buffer in double precision; datasets take it from a render. The depths
agree to the rounding of single precision, except at the few pixels whose centre lies on the outline of a surface to
that rounding. A colour depends on the depth only through the question whether the frame saw its point, so the colours
are the same.
"""

import itertools
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..case.frame import PosedFrame
from ..case.loaded_case import LoadedCase
from ..errors import InputError
from ..images.highlights import highlights
from ..images.pixel_values import grown
from ..light.exposure import matched_exposures
from ..projection.rendered_view import RenderedView
from ..projection.visible_surface import central_point
from ..projection.z_buffer import inverse_depth_map
from ..surface.mesh import TriangleMesh
from ..transforms import transform_points
from .fill import filled_colours
from .lens_shading import LensShading, lens_doubts, lit_by_lamp, without_light
from .ray_tracer import RayTracer
from .seen_frame import SeenFrame
from .shading import ColouredSurface, SurfaceColour
from .texture_atlas import TextureAtlas, bake_atlas
from .vertex_colours import VertexColours, colour_vertices

STEP = 0.05
Look = Callable[[ColouredSurface, PinholeCamera, np.ndarray], RenderedView]
"""How a surface looks from a pose (4x4, mm)."""


@dataclass(frozen=True)
class ReferenceView:
    """The frames' views of the surface.

    Attributes
    ----------
    mesh
        The surface, model frame, with front sides that face the frame.
    views
        Image, camera, pose and inverse depth of each frame, the case's own first.
    pivot_model
        ``(3,)`` mm: the surface point at the centre of the visible surface; pose distributions use it as pivot.
    messages
        Messages for the user.
    view_part
        Part 0..1 of the surface in the case's own frame that it colours: front sides inside its mask.
    light
        The light at the lens if the images of ``views`` are without it: albedos.
    """

    mesh: TriangleMesh
    views: tuple[SeenFrame, ...]
    pivot_model: np.ndarray
    messages: tuple[str, ...]
    view_part: float
    light: LensShading | None = None

    @property
    def view(self) -> SeenFrame:
        """The view of the case's own frame."""
        return self.views[0]

    def observed(self, points_model: np.ndarray, normals_model: np.ndarray) -> np.ndarray:
        """``(N, 3)`` surface points and their unit face normals -> ``(N,)`` bool: a frame saw them."""
        return np.any([view.observed(points_model, normals_model) for view in self.views], axis=0)

    def coverage(self) -> tuple[float, float]:
        """:attr:`view_part`, and the part 0..1 of the whole surface's area that the frames saw."""
        areas = np.linalg.norm(self.mesh.face_cross, axis=1)
        seen = self.observed(self.mesh.face_centres, self.mesh.face_normals)
        return self.view_part, float(areas[seen].sum() / areas.sum())


def limited_to_incidence(reference: ReferenceView, max_incidence_deg: float) -> ReferenceView:
    """The same views, which count surface as seen up to this angle between ray and normal."""
    views = tuple(replace(view, max_incidence_deg=max_incidence_deg) for view in reference.views)
    return replace(reference, views=views)


def without_highlights(reference: ReferenceView, frames: Sequence[PosedFrame]) -> ReferenceView:
    """The same views, in which the highlights of their frames, and the pixels beside them, show nothing."""
    views = [
        _limited_to(view, ~grown(highlights(frame.image, view.valid), 1))
        for view, frame in zip(reference.views, frames, strict=True)
    ]
    return replace(reference, views=tuple(views))


def _limited_to(view: SeenFrame, pixels: np.ndarray) -> SeenFrame:
    """The view, in which others than these ``(H, W)`` bool show nothing."""
    kept = view.valid & pixels
    return replace(view, valid=kept, inverse_depth=view.inverse_depth * kept)


def without_shadows(reference: ReferenceView) -> ReferenceView:
    """The same views, in which what lies in the shadow of their lamp shows nothing.

    The law divides the colours there by light that the surface does not get: what is left is no albedo.
    """
    light, views = reference.light, []
    if light is None or light.light.lamp_cam_mm is None:
        return reference
    for view in reference.views:
        shown, lit = view.inverse_depth > 0, np.ones(view.valid.shape, bool)
        lit[shown] = lit_by_lamp(reference.mesh, light, None, view.shown_points(), view.cam_from_model) > 0
        views.append(_limited_to(view, lit) if lit[shown].any() else view)
    return replace(reference, views=tuple(views))


def _without_edges(view: SeenFrame) -> SeenFrame:
    """The view, in which pixels at the edge of a surface show nothing: their colours are mixed."""
    around = np.lib.stride_tricks.sliding_window_view(np.pad(view.inverse_depth, 1, mode="edge"), (3, 3))
    # beside the pixel's own: from one side of it to the other, a steep wall changes twice as much
    nearest, own, farthest = around.max(axis=(2, 3)), view.inverse_depth, around.min(axis=(2, 3))
    same = 1 - view.steepest
    return _limited_to(view, (farthest > same * own) & (own > same * nearest))


def traced_surface(surface: ColouredSurface, camera: PinholeCamera, cam_from_model: np.ndarray) -> RenderedView:
    """The bare surface as the views of ``raster`` show it."""
    return RayTracer(surface, camera).render(cam_from_model)


def reference_view(loaded: LoadedCase, look: Look = traced_surface, light: LensShading | None = None) -> ReferenceView:
    """What the frames of a case saw of its surface.

    Parameters
    ----------
    loaded
        The case.
    look
        Shows the bare surface at each frame's pose.
    light
        The light at the lens, which is taken out of the frames; ``look`` must know light then.
    """
    name, mesh, said = loaded.case.path.name, loaded.surface.mesh, []
    surface = ColouredSurface(mesh, light=light)
    seen = [look(surface, frame.camera, frame.cam_from_model) for frame in loaded.frames]
    if light is not None:
        said = lens_doubts(loaded, seen[0])
        loaded = without_light(loaded, seen, light.curve)
    views = []
    for frame, view in zip(loaded.frames, seen, strict=True):
        views.append(SeenFrame(**vars(frame), inverse_depth=inverse_depth_map(view.depth_mm, frame.valid)))
        if not views[-1].inverse_depth.any():
            which = "" if frame is loaded.frame else f" {frame.path.name}"
            raise InputError(
                f"{name}: expected the surface in the frame{which}, no pixel shows it; align the pose first"
            )
    depth_mm = seen[0].depth_mm
    shown, front = depth_mm > 0, seen[0].observed
    front_part = front[shown].mean()
    if front_part < 0.5:
        mesh, front = mesh.flipped(), ~front
        said.insert(0, f"{name}: the frame sees the back of {1 - front_part:.0%} of the surface; flipped its faces")
    view_part = float((front & loaded.frame.valid)[shown].mean())
    pivot_model = central_point(depth_mm * loaded.frame.valid, loaded.frame.camera, loaded.frame.cam_from_model)
    return ReferenceView(mesh, matched_exposures(views), pivot_model, tuple(said), view_part, light)


def colours_of(reference: ReferenceView, mode: str) -> tuple[list[SurfaceColour], list[str]]:
    """The surface's colour from each frame in a mode (``projective``, ``vertex``), and messages.

    In both the frame's view tells which points it saw.
    """
    if mode == "projective":
        return list(reference.views), []
    if mode != "vertex":
        raise ValueError(f"expected the colour mode projective or vertex, found {mode!r}")
    colours: list[SurfaceColour] = []
    said: list[str] = []
    for view in reference.views:
        colour, messages = vertex_colours_of(replace(reference, views=(view,)))
        colours.append(replace(colour, source=view))
        said += messages
    return colours, said


def baked_colour_of(
    reference: ReferenceView,
    mode: str,
    progress: Callable[[float], None] | None = None,
    *,
    unseen: np.ndarray | None = None,
) -> tuple[TextureAtlas | VertexColours, list[str]]:
    """The surface's colour in the modes that other programs know, ``texture`` and ``vertex``, from all frames.

    Runs without Blender, so it may run in a thread. ``progress`` is called often with a fraction 0..1; an exception
    that it raises ends the work. ``unseen`` are colours ``(V, 3)`` of the vertices for what the frame did not see.
    """
    report = progress or (lambda _fraction: None)
    if mode not in ("texture", "vertex"):
        raise ValueError(f"expected the colour mode texture or vertex, found {mode!r}")
    if mode == "vertex":
        report(0.0)
        colours, messages = vertex_colours_of(reference)
        if unseen is not None:
            colours = replace(colours, rgb=np.where(colours.covered[:, None], colours.rgb, unseen))
        return colours, messages
    # of unknown length: each step goes a part of the way that is left
    left = itertools.accumulate(itertools.repeat(1 - STEP), operator.mul, initial=1.0)
    atlas = bake_atlas(reference.mesh, reference.views, unseen=unseen, step=lambda: report(1 - next(left)))
    return atlas, atlas.messages()


def unseen_colours_of(reference: ReferenceView, unseen: str) -> np.ndarray | None:
    """``(V, 3)`` colours of the vertices for what the frame did not see; ``None``, neutral grey, unless ``"fill"``."""
    if unseen == "neutral":
        return None
    if unseen != "fill":
        raise ValueError(f"expected neutral or fill, found {unseen!r}")
    lit = [tuple(map(_without_edges, reference.views))] if reference.light is not None else []
    for views in (*lit, reference.views):
        vertices = colour_vertices(reference.mesh, views)
        if vertices.covered.any():
            return filled_colours(reference.mesh.vertices, reference.mesh.faces, vertices.rgb, vertices.covered)
    # no vertex of large triangles is in the frame
    mean = reference.view.image[reference.view.inverse_depth > 0].mean(axis=0)
    return np.broadcast_to(mean, reference.mesh.vertices.shape)


def vertex_colours_of(reference: ReferenceView) -> tuple[VertexColours, list[str]]:
    """The colours of the vertices, and a message with their spacing."""
    view, mesh = reference.view, reference.mesh
    colours = colour_vertices(mesh, reference.views)
    spacing_px = (
        mesh.median_edge
        * view.camera.fx
        / np.linalg.norm(transform_points(view.cam_from_model, reference.pivot_model[None]))
    )
    message = (
        f"vertex colours: {colours.observed.sum()} of {len(colours.observed)} vertices seen by the frame, "
        f"{spacing_px:.1f} px apart (median): detail finer than that is lost"
    )
    return colours, [message]
