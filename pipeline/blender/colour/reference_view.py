"""The reference view: the aligned frame as a source of colour, and the surface that it saw.

Datasets take the surface from a render, by the ray tracer of their views. Coloured surfaces for the viewport and for
files take it from a z-buffer in double precision, which needs no Blender. The depths agree to the rounding of
single precision, except at the few pixels whose centre lies on the outline of a surface to that rounding. A colour
depends on the depth only through the question whether the frame saw its point, so the colours are the same.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...case.loaded_case import LoadedCase
from ...colour.fill import filled_colours
from ...colour.ray_tracer import RayTracer
from ...colour.shading import SurfaceColour
from ...colour.source_view import SourceView
from ...colour.texture_atlas import TextureAtlas, bake_atlas, classify_faces
from ...colour.vertex_colours import VertexColours, colour_vertices
from ...errors import InputError
from ...projection.rays import MeshRays
from ...projection.visible_surface import most_central
from ...projection.z_buffer import DepthRaster, inverse_depth_map, is_within_limits, rasterise_depth
from ...surface.mesh import TriangleMesh
from ...transforms import camera_centre, inverse_rigid, transform_points
from ..render.engines import render_view
from ..render.surface_scene import SurfaceScene

CLASSIFIED = 0.45
"""Fraction of the time for a texture after which the faces are classified."""
STEP = 0.05


@dataclass(frozen=True)
class ReferenceView:
    """The frame's view of the surface.

    Attributes
    ----------
    mesh
        The surface, model frame, with front sides that face the frame.
    view
        Image, camera, pose and inverse depth.
    pivot_model
        ``(3,)`` mm: the surface point at the centre of the visible surface; pose distributions use it as pivot.
    messages
        Messages for the user.
    raster, rays
        The z-buffer of the view, or what casts rays at ``mesh``, if it comes from one.
    """

    mesh: TriangleMesh
    view: SourceView
    pivot_model: np.ndarray
    messages: tuple[str, ...]
    raster: DepthRaster | None = None
    rays: MeshRays | None = None


def reference_view_of(loaded: LoadedCase, engine: str = "cycles") -> ReferenceView:
    """Render the frame's own pose to find the surface that it saw: by ``"raster"`` if that is the engine, or Cycles.

    Raises
    ------
    InputError
        No pixel of the frame shows the surface, or there is no such engine here.
    """
    mesh, camera, pose = loaded.surface.mesh, loaded.frame.camera, loaded.frame.cam_from_model
    if engine == "raster":
        rays = MeshRays(mesh)
        seen = RayTracer(mesh, camera, None, rays=rays).render(pose)
        view = _view_of(loaded, seen.depth_mm, seen.observed)
        return replace(view, rays=rays) if view.mesh is mesh else view
    with SurfaceScene(mesh, camera, None) as surface_scene:
        seen = render_view(surface_scene, pose)
    return _view_of(loaded, seen.depth_mm, seen.observed)


def limited_to_incidence(source: ReferenceView, max_incidence_deg: float) -> ReferenceView:
    """The same view, which counts surface as seen up to this angle between ray and normal."""
    return replace(source, view=replace(source.view, max_incidence_deg=max_incidence_deg))


def can_rasterise(loaded: LoadedCase) -> bool:
    """Whether :func:`rasterised_view_of` knows the whole surface: none of it is behind the frame's camera."""
    return is_within_limits(loaded.surface.mesh, loaded.frame.camera, loaded.frame.cam_from_model)


def rasterised_view_of(loaded: LoadedCase) -> ReferenceView:
    """The same from a z-buffer, if :func:`can_rasterise`; runs without Blender, so it may run in a thread.

    Raises
    ------
    InputError
        No pixel of the frame shows the surface.
    """
    mesh, pose = loaded.surface.mesh, loaded.frame.cam_from_model
    raster = rasterise_depth(mesh, loaded.frame.camera, pose)
    inverse, shown = raster.inverse_depth, raster.face >= 0
    depth_mm = np.divide(1.0, inverse, out=np.zeros(inverse.shape, np.float32), where=shown, casting="same_kind")
    front = np.zeros(shown.shape, dtype=bool)
    front[shown] = mesh.front_facing(camera_centre(pose), raster.face[shown])
    return _view_of(loaded, depth_mm, front, raster)


def colouring_view_of(loaded: LoadedCase) -> ReferenceView:
    """The reference view of coloured surfaces: from a z-buffer where possible, otherwise from a render.

    Raises
    ------
    InputError
        No pixel of the frame shows the surface.
    """
    return rasterised_view_of(loaded) if can_rasterise(loaded) else reference_view_of(loaded)


def _view_of(
    loaded: LoadedCase, depth_mm: np.ndarray, front: np.ndarray, raster: DepthRaster | None = None
) -> ReferenceView:
    """The view of a surface with this depth (0 without surface), which shows its front side where ``front``."""
    camera, cam_from_model, mesh, messages = loaded.frame.camera, loaded.frame.cam_from_model, loaded.surface.mesh, []
    name = loaded.case.path.name
    shown = depth_mm > 0
    if not (shown & loaded.frame.valid).any():
        raise InputError(f"{name}: expected the surface in the frame, no pixel shows it; align the pose first")
    part = front[shown].mean()
    if part < 0.5:
        mesh = mesh.flipped()
        messages.append(f"{name}: the frame sees the back of {1 - part:.0%} of the surface; flipped its faces")
    view = SourceView(**vars(loaded.frame), inverse_depth=inverse_depth_map(depth_mm, loaded.frame.valid))
    v, u = np.nonzero(shown & loaded.frame.valid)
    central = most_central(np.stack([u, v], axis=1))
    pixel = np.array([[u[central], v[central]]], float)
    pivot_cam = camera.rays_cam(pixel) * depth_mm[v[central], u[central]]
    pivot_model = transform_points(inverse_rigid(cam_from_model), pivot_cam)[0]
    return ReferenceView(mesh, view, pivot_model, tuple(messages), raster)


def colour_of(source: ReferenceView, mode: str) -> tuple[SurfaceColour, list[str]]:
    """The surface's colour in a mode (``projective``, ``texture``, ``vertex``), and messages for the user.

    In all modes the reference view tells which points it saw.
    """
    if mode == "projective":
        return source.view, []
    colour, messages = baked_colour_of(source, mode)
    return replace(colour, source=source.view), messages


def baked_colour_of(
    source: ReferenceView,
    mode: str,
    progress: Callable[[float], None] | None = None,
    *,
    unseen: np.ndarray | None = None,
) -> tuple[TextureAtlas | VertexColours, list[str]]:
    """The same for the modes that other programs know: ``texture`` and ``vertex``.

    Runs without Blender, so it may run in a thread. ``progress`` is called often with a fraction 0..1; an exception
    that it raises ends the work. ``unseen`` are colours ``(V, 3)`` of the vertices for what the frame did not see.
    """
    report = progress or _unreported
    if mode != "texture":
        report(0.0)
        colours, messages = vertex_colours_of(source)
        if unseen is not None:
            colours = replace(colours, rgb=np.where(colours.covered[:, None], colours.rgb, unseen))
        return colours, messages
    view, mesh = source.view, source.mesh
    stage = _Stage(report, CLASSIFIED)

    def observed(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        stage.step()
        return view.observed(points, normals)

    faces_seen = classify_faces(mesh, view.camera, view.cam_from_model, observed)
    stage = _Stage(report, 1.0, CLASSIFIED)
    atlas = bake_atlas(mesh, view.camera, view.cam_from_model, view.continued[0], observed, faces_seen, unseen=unseen)
    return atlas, atlas.messages()


class _Stage:
    """Reports a stage of unknown length: each step goes a part of the way that is left."""

    def __init__(self, report: Callable[[float], None], end: float, start: float = 0.0) -> None:
        self._report, self._end, self._fraction = report, end, start

    def step(self) -> None:
        self._report(self._fraction)
        self._fraction += STEP * (self._end - self._fraction)


def _unreported(_fraction: float) -> None:
    pass


def unseen_colours_of(source: ReferenceView, unseen: str) -> np.ndarray | None:
    """``(V, 3)`` colours of the vertices for what the frame did not see; ``None``, neutral grey, unless ``"fill"``."""
    if unseen != "fill":
        return None
    vertices = colour_vertices(source.mesh, source.view)
    if vertices.covered.any():
        return filled_colours(source.mesh.vertices, source.mesh.faces, vertices.rgb, vertices.covered)
    # no vertex of large triangles is in the frame
    mean = source.view.image[source.view.inverse_depth > 0].mean(axis=0)
    return np.broadcast_to(mean, source.mesh.vertices.shape)


def vertex_colours_of(source: ReferenceView) -> tuple[VertexColours, list[str]]:
    """The colours of the vertices, and a message with their spacing."""
    view, mesh = source.view, source.mesh
    colours = colour_vertices(mesh, view)
    spacing_px = (
        mesh.median_edge
        * view.camera.fx
        / np.linalg.norm(transform_points(view.cam_from_model, source.pivot_model[None]))
    )
    message = (
        f"vertex colours: {colours.observed.sum()} of {len(colours.observed)} vertices seen by the frame, "
        f"{spacing_px:.1f} px apart (median): detail finer than that is lost"
    )
    return colours, [message]
