"""A frame as a source of colour, and the visibility rule of all colour modes: which surface points the frame saw.

The frame saw a surface point X of a face if all of these hold, with z the depth of X and (u, v) its pixel:

* X is in front of the camera and (u, v) lies inside the grid of pixel centres;
* the face's front side faces the camera, with an angle of at most ``max_incidence_deg`` between ray and normal;
* z * w(u, v) = 1 within :data:`TOLERANCE_PX` / f, where w is the *inverse* depth map of the surface seen from the
  frame, interpolated bilinearly: with the same four pixels and weights as the colour.

Notes
-----
Inverse depth is affine in (u, v) on a plane, so the interpolation is exact inside a face, and only creases need the
tolerance. It amounts to :data:`TOLERANCE_PX` pixel footprints (z / f each) of depth, enough for a crease of 80° inside
a pixel. As the test uses the pixels of the colour lookup, it also rejects points whose colour would mix in another
surface: a pixel of weight a from a surface that is deeper or nearer by the relative step s passes only if a s is below
the tolerance. (The steps of a nearer and a farther surface in one lookup may cancel: at about one point in 100 000 of
three balls behind each other.)

Where the surface ends before the background, pixels and surface end at different places, by up to a pixel. So both
maps are continued by one pixel into the background (:attr:`SeenFrame.continued`), from the nearest surface beside it:
the colour by its value there, the inverse depth along its slope, which is exact on a plane. A lookup there weights the
pixels with surface alone, and passes only if these show the surface of X. Pixels of the surface are never changed, so
nothing is continued across a depth step; nor is anything into pixels that are masked out: there w = 0, and every
lookup that uses one fails. So do lookups of background alone.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..case.frame import PosedFrame
from ..images.pixel_values import among_centres, sample_bilinear
from ..surface.mesh import TriangleMesh
from ..transforms import BLOCK, camera_centre, inverse_rigid, transform_points

TOLERANCE_PX = 1.5
"""Depth tolerance in pixel footprints: a wrongly accepted point is displaced by less than about one pixel."""

MAX_INCIDENCE_DEG = 87.0
"""Largest angle between ray and normal: beyond it the frame's pixels are stretched more than 19 times.

On held-out photographs, surface seen at 80° to 87° is still nearer to the truth than grey is.
"""

SAME_SURFACE = 4.0
"""Largest difference, in depth tolerances, of one curved surface that is continued from two sides."""

LEAST_WEIGHT = 0.01
"""Least bilinear weight of the pixels that a colour is the mean of: it is then at most 1.4 pixels away from them."""


@dataclass(frozen=True)
class SeenFrame(PosedFrame):
    """A frame that colours the surface, with the inverse depth of what it saw of it.

    Attributes
    ----------
    inverse_depth
        ``(H, W)`` float32, 1/mm at the pixel centres; 0 where the frame shows no surface or is masked out.
    max_incidence_deg
        Largest angle between ray and face normal.
    """

    inverse_depth: np.ndarray = field(kw_only=True)
    max_incidence_deg: float = MAX_INCIDENCE_DEG

    @cached_property
    def continued(self) -> tuple[np.ndarray, np.ndarray]:
        """``image`` and ``inverse_depth``, both continued by one pixel into the background: what lookups read."""
        background = (self.inverse_depth <= 0) & self.valid
        same = SAME_SURFACE * self.depth_tolerance
        return continued_by_a_pixel(self.image, self.inverse_depth, background, steepest=self.steepest, same=same)

    @cached_property
    def depth_mm(self) -> np.ndarray:
        """``(H, W)`` float32 depth along the optical axis at the pixel centres, mm; 0 where ``inverse_depth`` is."""
        return np.divide(1.0, self.inverse_depth, out=np.zeros_like(self.inverse_depth), where=self.inverse_depth > 0)

    @property
    def depth_tolerance(self) -> float:
        """Relative depth tolerance."""
        return TOLERANCE_PX / min(self.camera.fx, self.camera.fy)

    @property
    def steepest(self) -> float:
        """Largest relative change of the depth of a surface from pixel to pixel."""
        return float(np.tan(np.radians(MAX_INCIDENCE_DEG))) / min(self.camera.fx, self.camera.fy)

    def shown_points(self, step: int = 1) -> np.ndarray:
        """``(N, 3)`` what every ``step``-th pixel across and down shows of the surface, model frame, mm."""
        depth_mm = self.depth_mm[::step, ::step]
        shown = depth_mm > 0
        points_cam = self.camera.rays_cam(self.camera.pixel_grid()[::step, ::step][shown]) * depth_mm[shown][:, None]
        return transform_points(inverse_rigid(self.cam_from_model), points_cam)

    def project(self, points_model: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``(N, 3)`` model points -> ``(N, 2)`` pixels (NaN behind the camera) and ``(N,)`` depth in mm."""
        points_cam = transform_points(self.cam_from_model, points_model)
        return self.camera.project(points_cam), points_cam[:, 2]

    def unoccluded(self, points_model: np.ndarray) -> np.ndarray:
        """``(N, 3)`` surface points -> ``(N,)`` bool: inside the frame and not occluded; orientation is not tested."""
        pixels, z = self.project(points_model)
        surface = sample_bilinear(self.continued[1], pixels)
        with np.errstate(invalid="ignore"):
            return np.abs(z * surface - 1) <= self.depth_tolerance

    def colours(self, pixels: np.ndarray) -> np.ndarray:
        """``(N, 2)`` pixels of observed points -> ``(N, 3)`` code values 0..1, interpolated bilinearly."""
        return sample_bilinear(self.continued[0], pixels)

    def own_colours(self, points_model: np.ndarray, normals_model: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Colours of points beside a depth step, where the bilinear lookup would mix in another surface.

        Of ``(N, 3)`` surface points, mm, and unit normals of the surface there.

        Returns
        -------
        ``(N, 3)`` code values 0..1: the mean, with bilinear weights, over those of the four pixels that show the plane
        through the point, by the depth tolerance; 0 without such. ``(N,)`` bool: there is one.
        """
        image, surface = self.continued
        pixels, z = self.project(points_model)
        width, height = self.camera.size_wh
        inside = among_centres(pixels, self.camera.size_wh)
        corner = np.clip(np.floor(np.where(inside[:, None], pixels, 0)), 0, [width - 2, height - 2]).astype(np.int64)
        offset = np.where(inside[:, None], pixels, 0) - corner
        normals_cam = normals_model @ self.cam_from_model[:3, :3].T
        # of the ray's component along the normal: constant times the inverse depth on the plane
        along = (normals_cam * transform_points(self.cam_from_model, points_model)).sum(axis=1)
        total, weight = np.zeros((len(pixels), 3)), np.zeros(len(pixels))
        for right, down in ((0, 0), (1, 0), (0, 1), (1, 1)):
            tap = corner + np.array([right, down])
            u, v = tap.T
            with np.errstate(divide="ignore", invalid="ignore"):
                on_plane = z * (self.camera.rays_cam(tap.astype(float)) * normals_cam).sum(axis=1) / along
                own = inside & (np.abs(z * surface[v, u] - on_plane) <= self.depth_tolerance)
                # seen edge-on, a plane meets everything
                own &= np.abs(on_plane - 1) <= self.steepest
            factor = np.where(own, np.abs(1 - right - offset[:, 0]) * np.abs(1 - down - offset[:, 1]), 0)
            total += factor[:, None] * image[v, u]
            weight += factor
        found = weight > LEAST_WEIGHT
        return np.divide(total, weight[:, None], out=np.zeros_like(total), where=found[:, None]), found

    def observed(self, points_model: np.ndarray, normals_model: np.ndarray) -> np.ndarray:
        """``(N, 3)`` surface points and their unit face normals -> ``(N,)`` bool: the frame saw them."""
        seen = np.empty(len(points_model), dtype=bool)
        for start in range(0, len(points_model), BLOCK):
            points, normals = points_model[start : start + BLOCK], normals_model[start : start + BLOCK]
            facing = self.facing(points, normals)
            facing[facing] = self.unoccluded(points[facing])
            seen[start : start + BLOCK] = facing
        return seen

    def facing(self, points_model: np.ndarray, normals_model: np.ndarray) -> np.ndarray:
        """``(N, 3)`` points and unit normals -> ``(N,)`` bool: the front side faces the frame's camera."""
        # column by column: numpy is slow at reductions along an axis of three
        x, y, z = (
            centre - column for centre, column in zip(camera_centre(self.cam_from_model), points_model.T, strict=True)
        )
        nx, ny, nz = normals_model.T
        cosine = x * nx + y * ny + z * nz
        return cosine >= np.cos(np.radians(self.max_incidence_deg)) * np.sqrt(x * x + y * y + z * z)

    def facing_faces(self, mesh: TriangleMesh) -> np.ndarray:
        """``(F,)`` bool: faces whose front side faces the frame's camera."""
        facing = np.empty(len(mesh.faces), dtype=bool)
        for start in range(0, len(facing), BLOCK):
            # neither centres nor normals are kept, which would take 240 MB for 5 million faces
            a, b, c = (mesh.vertices[corner] for corner in mesh.faces[start : start + BLOCK].T)
            block = TriangleMesh(np.concatenate([a, b, c]), np.arange(3 * len(a)).reshape(3, -1).T)
            facing[start : start + BLOCK] = self.facing(block.face_centres, block.face_normals)
        return facing


_BESIDE = ((0, 1), (1, 0), (0, -1), (-1, 0))
_DIAGONAL = ((1, 1), (1, -1), (-1, -1), (-1, 1))


def continued_by_a_pixel(
    image: np.ndarray, inverse_depth: np.ndarray, background: np.ndarray, *, steepest: float, same: float
) -> tuple[np.ndarray, np.ndarray]:
    """Continue colour and inverse depth of the surface by one pixel into the background.

    Parameters
    ----------
    image, inverse_depth
        ``(H, W, 3)`` and ``(H, W)``; 0 is no surface in the latter.
    background
        ``(H, W)`` bool: the pixels to continue into; those that do not touch surface stay as they are.
    steepest
        Largest relative change of inverse depth from pixel to pixel on one surface; it is not continued along larger
        ones.
    same
        Largest relative difference of the inverse depths to which the pixels beside are continued, for one surface.

    Returns
    -------
    ``(H, W, 3)`` and ``(H, W)``: the mean over the pixels beside that show the nearest surface; over the diagonal ones
    if the others show none.
    """
    height, width = inverse_depth.shape
    # a margin of two pixels without surface
    padded = np.pad(inverse_depth, 2)
    padded_image = np.pad(image, ((1, 1), (1, 1), (0, 0)))
    touching = np.zeros((height, width), dtype=bool)
    for down, across in (*_BESIDE, *_DIAGONAL):
        touching |= padded[2 + down : 2 + down + height, 2 + across : 2 + across + width] > 0
    rows, columns = np.nonzero(background & touching)
    colour, surface = image.copy(), inverse_depth.copy()
    for directions in (_BESIDE, _DIAGONAL):
        down, across = np.array(directions).T[..., None]
        beside = padded[rows + 2 + down, columns + 2 + across].astype(np.float64)
        beyond = padded[rows + 2 + 2 * down, columns + 2 + 2 * across]
        step = beside - beyond
        sloping = (beyond > 0) & (np.abs(step) <= steepest * np.hypot(down, across) * beside)
        reached = beside + np.where(sloping, step, 0)
        # of several surfaces the nearest
        own = (beside > 0) & (reached >= reached.max(axis=0) * (1 - same))
        count = own.sum(axis=0)
        found = count > 0
        at, own, reached = (rows[found], columns[found]), own[:, found], reached[:, found]
        colours = padded_image[at[0] + 1 + down, at[1] + 1 + across]
        surface[at] = (own * reached).sum(axis=0) / count[found]
        colour[at] = (own[..., None] * colours).sum(axis=0) / count[found, None]
        rows, columns = rows[~found], columns[~found]
    return colour, surface
