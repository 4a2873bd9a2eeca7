"""How much of the surface the frame colours, and how exactly: measured at the frame's own pose."""

from dataclasses import dataclass

import numpy as np

from ..images.pixel_values import sample_bilinear
from ..projection.rasteriser import barycentric
from ..projection.z_buffer import rasterise_depth
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre
from .reference_view import ReferenceView
from .source_view import SourceView
from .texture_atlas import OBSERVED_LEAST, TextureAtlas
from .vertex_colours import VertexColours


@dataclass(frozen=True)
class Coverage:
    """Figures of a coloured surface.

    Attributes
    ----------
    of_view
        Fraction of the surface in the frame's view that has a colour from it, 0..1.
    of_surface
        Fraction of the whole surface's area that the frame saw, 0..1.
    mean_error, max_error
        Absolute difference between the surface seen from the frame's pose and the frame where there is colour, code
        values 0..255: mean over pixels and channels, and maximum.
    pixels
        Number of compared pixels.
    """

    of_view: float
    of_surface: float
    mean_error: float
    max_error: float
    pixels: int

    def summary(self) -> str:
        """The figures as one line."""
        return (
            f"the frame colours {self.of_view:.1%} of the surface in its view, {self.of_surface:.1%} of the whole; "
            f"seen from its pose, the surface differs from the frame by {self.mean_error:.3f}/255 on average, "
            f"by at most {self.max_error:.1f}/255"
        )


def coverage_of(reference: ReferenceView, colour: VertexColours | TextureAtlas) -> Coverage:
    """Look at the coloured surface from the frame's pose and compare it with the frame.

    The surface is rasterised in double precision, at the pixel centres, and coloured as its material is. A render in
    single precision may lack pixels at the rim of the observed surface, where the lookup just reaches an unobserved
    texel; elsewhere it has the same values. It needs no renderer, so it may run in a thread.
    """
    frame, mesh = reference.view, reference.mesh
    shown = reference.raster or rasterise_depth(mesh, frame.camera, frame.cam_from_model)
    v, u = np.nonzero(shown.face >= 0)
    face, pixels = shown.face[v, u], np.stack([u, v], axis=1).astype(float)
    weights = _surface_weights(mesh, frame, face, pixels, shown.inverse_depth[v, u])
    rgb, observed = _colours(mesh, colour, face, weights)
    observed &= mesh.front_facing(camera_centre(frame.cam_from_model), face)
    differences = 255 * np.abs(rgb[observed] - frame.image[v[observed], u[observed]])
    areas = np.linalg.norm(mesh.face_cross, axis=1)
    seen = reference.observed(mesh.face_centres, mesh.face_normals)
    return Coverage(
        of_view=float(observed.sum() / max(len(face), 1)),
        of_surface=float(areas[seen].sum() / areas.sum()),
        mean_error=float(differences.mean()) if differences.size else 0.0,
        max_error=float(differences.max()) if differences.size else 0.0,
        pixels=int(np.count_nonzero(observed)),
    )


def _surface_weights(
    mesh: TriangleMesh, frame: SourceView, face: np.ndarray, pixels: np.ndarray, inverse_depth: np.ndarray
) -> np.ndarray:
    """``(N, 3)`` barycentrics, on the surface, of the points that ``(N, 2)`` pixels show on ``(N,)`` faces."""
    corners_px, depth = frame.project(mesh.vertices)
    corners = mesh.faces[face]
    return barycentric(corners_px[corners], pixels) / depth[corners] / inverse_depth[:, None]


def _colours(
    mesh: TriangleMesh, colour: VertexColours | TextureAtlas, face: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """``(N, 3)`` code values 0..1 of points on faces, and ``(N,)`` whether the frame saw them."""
    if isinstance(colour, VertexColours):
        corners = mesh.faces[face]
        return np.einsum("nk,nkc->nc", weights, colour.rgb[corners]), colour.observed[corners].all(axis=1)
    height, width = colour.observed.shape
    uv = np.einsum("nk,nkc->nc", weights, colour.uv[face])
    texels = uv * [width, -height] + [-0.5, height - 0.5]
    flags = sample_bilinear(colour.observed.astype(np.float32), texels)
    return sample_bilinear(colour.image, texels), flags > OBSERVED_LEAST
