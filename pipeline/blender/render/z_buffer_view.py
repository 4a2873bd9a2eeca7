"""A view of the surface from a z-buffer in numpy: the colours of the frame, depth and observed surface.

For a mesh that is not much finer than the view's pixels it takes a third of a ray tracer's time and memory. It follows
the rule of :mod:`pipeline.colour.source_view` pixel by pixel, at the pixels' centres, so it agrees with a ray traced
view except where a centre lies on an edge, or the frame's tolerances, to rounding.
"""

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...colour.source_view import SourceView
from ...colour.vertex_colours import NEUTRAL
from ...dataset.view import RenderedView
from ...images.pixel_values import ROUNDING_PX
from ...projection.z_buffer import is_within_limits, rasterise_depth
from ...surface.mesh import TriangleMesh
from ...transforms import camera_centre, inverse_rigid

BLOCK_PX = 1 << 15
"""Pixels that are coloured at once: few enough for a processor's cache."""


class ZBufferRenderer:
    """Renders views of one surface, coloured by one frame."""

    def __init__(self, mesh: TriangleMesh, camera: PinholeCamera, source: SourceView) -> None:
        """Prepare what the views share.

        Parameters
        ----------
        mesh
            The surface, model frame, with front sides that face the frame.
        camera
            Intrinsics of the views.
        source
            The frame, and the surface that it saw.
        """
        self._mesh, self._camera, self._source = mesh, camera, source
        self._faces_frame = source.facing_faces(mesh)
        image, surface = source.continued
        texels = np.concatenate([image, surface[..., None]], axis=2)
        self._texels = np.ascontiguousarray(texels, np.float32).reshape(-1, 4)
        self._offsets = (mesh.face_cross * mesh.vertices[mesh.faces[:, 0]]).sum(axis=1)

    def can_render(self, cam_from_model: np.ndarray) -> bool:
        """Whether all of the surface is in front of the camera (pose 4x4, mm): nothing is clipped."""
        return is_within_limits(self._mesh, self._camera, cam_from_model)

    def render(self, cam_from_model: np.ndarray) -> RenderedView:
        """Render a pose (4x4, mm) that :meth:`can_render`."""
        raster = rasterise_depth(self._mesh, self._camera, cam_from_model)
        front = self._mesh.face_cross @ camera_centre(cam_from_model) > self._offsets
        seen_face = np.append(self._faces_frame & front, False)
        nearness = raster.inverse_depth.astype(np.float32)
        height, width = self._camera.shape_hw
        rgb, observed = np.empty((height, width, 3), np.float32), np.empty((height, width), bool)
        from_view = self._frame_from_view(cam_from_model)
        for start in range(0, height, rows := max(1, BLOCK_PX // width)):
            block = slice(start, start + rows)
            self._colour(from_view, start, nearness[block], seen_face[raster.face[block]], rgb[block], observed[block])
        shown = raster.face >= 0
        if not shown.all():
            rgb[~shown] = 0
        depth_mm = np.divide(1, nearness, out=np.zeros_like(nearness), where=shown)
        return RenderedView(rgb, depth_mm, observed, np.zeros((height, width), dtype=bool))

    def _frame_from_view(self, cam_from_model: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The frame's homogeneous pixel of a point, divided by its depth in the view: A (u, v, 1) + b / depth."""
        frame_from_view = self._source.cam_from_model @ inverse_rigid(cam_from_model)
        projection = self._source.camera.k @ frame_from_view[:3]
        return projection[:, :3] @ np.linalg.inv(self._camera.k), projection[:, 3]

    def _colour(
        self,
        from_view: tuple[np.ndarray, np.ndarray],
        first_row: int,
        nearness: np.ndarray,
        may_be_seen: np.ndarray,
        rgb: np.ndarray,
        observed: np.ndarray,
    ) -> None:
        """Colour rows of a view.

        Parameters
        ----------
        from_view
            Of :meth:`_frame_from_view`.
        first_row, nearness, may_be_seen
            Number of the first row; ``(R, W)`` inverse depth; ``(R, W)`` bool: both cameras see the face's front.
        rgb, observed
            ``(R, W, 3)`` and ``(R, W)``, to be written.
        """
        u = np.arange(nearness.shape[1])
        v = first_row + np.arange(len(nearness))[:, None]
        width, height = self._source.camera.size_wh
        x, y, z = (
            (row[0] * u + (row[1] * v + row[2])).astype(np.float32) + np.float32(shift) * nearness
            for row, shift in zip(*from_view, strict=True)
        )
        inside = may_be_seen & (z > 0)
        # where it is not, anything but a division by zero does
        z_or_one = np.where(inside, z, np.float32(1))
        x /= z_or_one
        y /= z_or_one
        inside &= (x >= -ROUNDING_PX) & (x <= width - 1 + ROUNDING_PX)
        inside &= (y >= -ROUNDING_PX) & (y <= height - 1 + ROUNDING_PX)
        np.clip(x, 0, width - 1, out=x)
        np.clip(y, 0, height - 1, out=y)
        left, top = (
            np.minimum(x.astype(np.int32), max(width - 2, 0)),
            np.minimum(y.astype(np.int32), max(height - 2, 0)),
        )
        across, down = (x - left).astype(np.float32)[..., None], (y - top).astype(np.float32)[..., None]
        at, right, below = (top * width + left).astype(np.intp), int(width > 1), width * int(height > 1)

        def texels(step: int) -> np.ndarray:
            return np.take(self._texels, at + step, axis=0, mode="clip")

        upper, lower = texels(0), texels(below)
        upper += (texels(right) - upper) * across
        lower += (texels(below + right) - lower) * across
        lower -= upper
        lower *= down
        upper += lower
        # z is the depth in the frame relative to that in the view
        frame_depth = np.divide(z, nearness, out=np.zeros_like(z), where=inside)
        np.less_equal(np.abs(upper[..., 3] * frame_depth - 1), self._source.depth_tolerance, out=observed)
        observed &= inside
        rgb[:] = NEUTRAL
        np.copyto(rgb, upper[..., :3], where=observed[..., None])
