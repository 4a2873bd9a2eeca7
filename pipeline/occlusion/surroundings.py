"""What the case's frame shows around the surface: on a sheet, seen where a view shows nothing else.

The sheet is a grid of the frame's pixels and of places around it, at inverse depths that continue the surface's:
the plane through them and what they differ from it by, as of :func:`.filled_colours`. It takes the frame's colours
where that shows something else than the surface, and those continued elsewhere.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..colour.fill import filled_colours
from ..colour.lens_shading import LensShading, albedo_codes, shown_codes
from ..colour.seen_frame import SeenFrame
from ..images.pixel_values import grown, sample_bilinear
from ..projection.rendered_view import RenderedView
from ..projection.visible_surface import pixel_points
from ..projection.z_buffer import rasterise_depth
from ..surface.mesh import TriangleMesh
from ..transforms import inverse_rigid, transform_points
from .shadow import Shadow
from .staging import Filter, Staging

CELLS = 64
"""Of the grid, along the frame's longer side."""
BEYOND = np.array([0.02, 0.06, 0.15, 0.3, 0.6, 1.2, 2.5])
"""Places around the frame, in its sizes."""
NEAREST, FARTHEST = 0.5, 4.0
"""Depth of the sheet, over those of the surface's nearest and farthest point: a plane has a horizon."""
KNOWN = 0.999
"""Weight of pixels that show the surroundings from which on a colour is theirs."""
MARGIN_PX = 3
"""Pixels of the frame beside the surface that count as its own, as the pose is not exact."""


def surroundings_filter(staging: Staging) -> Filter | None:
    """The filter that shows the surroundings where a view has no surface."""
    if staging.options["surroundings"] != "frame":
        return None
    around = Surroundings.of(staging.reference.view, staging.reference.light, staging.light)
    return lambda view, staged: around.behind(view, staging.camera, staged.cam_from_model, staged.shadow)


@dataclass(frozen=True)
class Surroundings:
    """The sheet.

    Attributes
    ----------
    view
        The frame.
    mesh
        The sheet, model frame, mm.
    places_px
        Columns and rows of its grid in the frame.
    image
        ``(H, W, 4)`` float32: its colours, which multiply the light if there is one; 1 where it shows the surroundings.
    filled
        ``(R, C, 3)`` colours at the grid's places, for what the frame does not show.
    normal
        ``(3,)`` of the plane, towards the frame, by which the sheet is lit: its own relief is a guess.
    light
        The light at the lens of the views.
    """

    view: SeenFrame
    mesh: TriangleMesh
    places_px: tuple[np.ndarray, np.ndarray]
    image: np.ndarray
    filled: np.ndarray
    normal: np.ndarray
    light: LensShading | None

    @classmethod
    def of(cls, view: SeenFrame, taken: LensShading | None = None, given: LensShading | None = None) -> "Surroundings":
        """From the case's frame, without a light ``taken`` where it shows the surface, for views in another."""
        columns, rows = (_places(size, max(view.camera.size_wh)) for size in view.camera.size_wh)
        flat = np.stack([*np.meshgrid(columns, rows), np.zeros((len(rows), len(columns)))], axis=-1).reshape(-1, 3)
        faces = _faces(len(rows), len(columns))
        surface = view.inverse_depth > 0
        plane = _plane(view.inverse_depth)
        normal = view.cam_from_model[:3, :3].T @ -(view.camera.k.T @ plane)
        normal = (normal / np.linalg.norm(normal)).astype(np.float32)
        inverse_depth = _continued(view.inverse_depth, plane, flat, faces, (columns, rows))
        points_cam = view.camera.rays_cam(flat[:, :2]) / inverse_depth[:, None]
        mesh = TriangleMesh(transform_points(inverse_rigid(view.cam_from_model), points_cam), faces)
        known = view.valid & ~grown(surface, MARGIN_PX)
        image = view.image.astype(np.float32)
        if taken is not None and known.any():
            raster = rasterise_depth(mesh, view.camera, view.cam_from_model)
            points = pixel_points(raster.depth_mm, np.nonzero(known), view.camera, view.cam_from_model)
            factors = taken.factors(points, np.broadcast_to(normal, points.shape), view.cam_from_model)
            image[known] = albedo_codes(image[known], factors[:, None], taken.curve)
        # a surface that fills the frame is continued by itself
        known = known if known.any() else surface
        rgb, covered = _means(image, known, columns, rows)
        filled = filled_colours(flat, faces, rgb, covered).reshape(len(rows), len(columns), 3)
        return cls(view, mesh, (columns, rows), np.dstack([image, known.astype(np.float32)]), filled, normal, given)

    def behind(
        self, view: RenderedView, camera: PinholeCamera, cam_from_model: np.ndarray, shadow: Shadow | None = None
    ) -> RenderedView:
        """A view of a pose (4x4, mm) with them where it shows no surface, in a shadow."""
        raster = rasterise_depth(self.mesh, camera, cam_from_model)
        shown = (raster.face >= 0) & ~view.mask
        depth_mm = np.where(shown, raster.depth_mm, 0)
        points = pixel_points(depth_mm, np.nonzero(shown), camera, cam_from_model)
        colours = self._colours(self.view.project(points)[0])
        if self.light is not None:
            lit = None if shadow is None else 1 - shadow.covers(depth_mm)[shown].astype(np.float32)
            normals = np.broadcast_to(self.normal, points.shape)
            shown_codes(colours, self.light.factors(points, normals, cam_from_model, lit), self.light.curve)
        rgb = view.rgb.copy()
        rgb[shown] = np.clip(colours, 0, 1)
        return replace(view, rgb=rgb, sheet=shown)

    def _colours(self, pixels: np.ndarray) -> np.ndarray:
        """``(N, 3)`` float32 of pixels ``(N, 2)`` of the frame, inside it or not."""
        own = sample_bilinear(self.image, pixels).astype(np.float32)
        rgb, not_known = own[:, :3], own[:, 3] < KNOWN
        across, down = (
            np.interp(at, places, np.arange(len(places)))
            for at, places in zip(pixels[not_known].T, self.places_px, strict=True)
        )
        rgb[not_known] = sample_bilinear(self.filled, np.stack([across, down], axis=1))
        return rgb


def _places(size: int, longer: int) -> np.ndarray:
    """Of the grid along one side of the frame, px."""
    inside = np.linspace(-0.5, size - 0.5, max(2, round(CELLS * size / longer)) + 1)
    return np.concatenate([-0.5 - size * BEYOND[::-1], inside, size - 0.5 + size * BEYOND])


def _faces(rows: int, columns: int) -> np.ndarray:
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    # their fronts face the frame
    corners = np.concatenate([np.stack([a, c, b], -1).reshape(-1, 3), np.stack([a, d, c], -1).reshape(-1, 3)])
    return corners.astype(np.int32)


def _means(values: np.ndarray, counted: np.ndarray, *axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``(R * C, N)`` means of values ``(H, W, N)`` around places of the grid, and which have a pixel that counts."""
    v, u = np.nonzero(counted)
    column, row = (
        np.rint(np.interp(at, places, np.arange(len(places)))).astype(int)
        for at, places in zip((u, v), axes, strict=True)
    )
    size, place = len(axes[0]) * len(axes[1]), row * len(axes[0]) + column
    count = np.bincount(place, minlength=size)
    sums = np.stack([np.bincount(place, channel, size) for channel in values[counted].T], axis=1)
    return sums / np.maximum(count, 1)[:, None], count > 0


def _plane(inverse_depth: np.ndarray) -> np.ndarray:
    """``(3,)`` a, b, c of the plane a u + b v + c through inverse depths ``(H, W)``, 0 for none, by least squares."""
    v, u = np.nonzero(inverse_depth)
    affine = np.column_stack([u, v, np.ones(len(u))])
    # sums that do not depend on a machine's cores
    squares = np.einsum("ni,nj->ij", affine, affine)
    sides = np.einsum("ni,n->i", affine, inverse_depth[v, u].astype(np.float64))
    return np.asarray(np.linalg.lstsq(squares, sides, rcond=None)[0])


def _continued(
    inverse_depth: np.ndarray,
    plane: np.ndarray,
    flat: np.ndarray,
    faces: np.ndarray,
    places_px: tuple[np.ndarray, np.ndarray],
) -> np.ndarray:
    """``(V,)`` inverse depths of a grid's places ``(V, 3)`` from those of the frame ``(H, W)`` and their plane."""
    v, u = np.mgrid[: inverse_depth.shape[0], : inverse_depth.shape[1]]
    known, beside = inverse_depth > 0, inverse_depth - (plane[0] * u + plane[1] * v + plane[2])
    continued = filled_colours(flat, faces, *_means(beside[..., None], known, *places_px))[:, 0]
    continued += flat[:, :2] @ plane[:2] + plane[2]
    own = inverse_depth[known]
    return np.clip(continued, np.min(own) / FARTHEST, np.max(own) / NEAREST).astype(np.float64)
