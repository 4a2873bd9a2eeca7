"""The reference view: the aligned frame as a source of colour, and the surface that it saw, from a render."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...case.loaded_case import LoadedCase
from ...colour.source_view import SourceView
from ...colour.texture_atlas import TextureAtlas, bake_atlas, classify_faces
from ...colour.vertex_colours import VertexColours, colour_vertices
from ...dataset.view import RenderedView
from ...errors import InputError
from ...projection.visible_surface import most_central
from ...projection.z_buffer import inverse_depth_map
from ...surface.mesh import TriangleMesh
from ...transforms import inverse_rigid, transform_points
from ..render.engines import render_view
from ..render.material import SurfaceColour
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
    """

    mesh: TriangleMesh
    view: SourceView
    pivot_model: np.ndarray
    messages: tuple[str, ...]


def reference_view_of(loaded: LoadedCase) -> ReferenceView:
    """Render the frame's own pose to find the surface that it saw.

    Raises
    ------
    InputError
        No pixel of the frame shows the surface.
    """
    camera, cam_from_model, mesh, messages = loaded.case.camera, loaded.cam_from_model, loaded.mesh, []
    seen = _geometry(mesh, camera, cam_from_model)
    name = loaded.case.path.name
    if not (seen.mask & loaded.valid).any():
        raise InputError(f"{name}: expected the surface in the frame, no pixel shows it; align the pose first")
    front = seen.observed[seen.mask].mean()
    if front < 0.5:
        mesh = mesh.flipped()
        messages.append(f"{name}: the frame sees the back of {1 - front:.0%} of the surface; flipped its faces")
    view = SourceView(camera, cam_from_model, loaded.image, inverse_depth_map(seen.depth_mm, loaded.valid))
    v, u = np.nonzero(seen.mask & loaded.valid)
    central = most_central(np.stack([u, v], axis=1))
    pixel = np.array([[u[central], v[central]]], float)
    pivot_cam = camera.rays_cam(pixel) * seen.depth_mm[v[central], u[central]]
    pivot_model = transform_points(inverse_rigid(cam_from_model), pivot_cam)[0]
    return ReferenceView(mesh, view, pivot_model, tuple(messages))


def colour_of(source: ReferenceView, mode: str) -> tuple[SurfaceColour, list[str]]:
    """The surface's colour in a mode (``projective``, ``texture``, ``vertex``), and messages for the user."""
    return (source.view, []) if mode == "projective" else baked_colour_of(source, mode)


def baked_colour_of(
    source: ReferenceView, mode: str, progress: Callable[[float], None] | None = None
) -> tuple[TextureAtlas | VertexColours, list[str]]:
    """The same for the modes that other programs know: ``texture`` and ``vertex``.

    Runs without Blender, so it may run in a thread. ``progress`` is called often with a fraction 0..1; an exception
    that it raises ends the work.
    """
    report = progress or _unreported
    if mode != "texture":
        report(0.0)
        return vertex_colours_of(source)
    view, mesh = source.view, source.mesh
    stage = _Stage(report, CLASSIFIED)

    def observed(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        stage.step()
        return view.observed(points, normals)

    faces_seen = classify_faces(mesh, view.camera, view.cam_from_model, observed)
    stage = _Stage(report, 1.0, CLASSIFIED)
    atlas = bake_atlas(mesh, view.camera, view.cam_from_model, view.image, observed, faces_seen)
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


def _geometry(mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray) -> RenderedView:
    with SurfaceScene(mesh, camera, None) as surface_scene:
        return render_view(surface_scene, cam_from_model)
