"""Maps the pixels of a slice to the area that shows it, at any zoom and pan."""

from dataclasses import dataclass

import bpy
import numpy as np

from ..pipeline.volume.slices.slice_planes import SlicePlane
from .loaded import LoadedCT, ct_of
from .slice_areas import plane_of


@dataclass(frozen=True)
class SliceView:
    """A slice in a region: ``region = pixel * scale + offset``, in region pixels (origin bottom-left).

    Attributes
    ----------
    ct, plane
        What is shown.
    number
        Number of the slice: the one nearest to the scene's point.
    scale, offset
        ``(2,)``; the second scale is negative, since a region's y axis points up.
    """

    ct: LoadedCT
    plane: SlicePlane
    number: int
    scale: np.ndarray
    offset: np.ndarray

    @classmethod
    def of(cls, context: bpy.types.Context) -> "SliceView | None":
        """The slice in the context's region; ``None`` if it shows none, or the CT is not in memory."""
        number, ct, region = plane_of(context.space_data), ct_of(context.scene), context.region
        if number is None or ct is None or region is None or region.type != "WINDOW":
            return None
        plane = ct.planes[number]
        corners = (0.0, 0.0), (float(region.width), float(region.height))
        low, high = (np.array(region.view2d.region_to_view(*corner)) for corner in corners)
        px_per_unit = np.array(corners[1]) / (high - low)
        size = np.array(plane.size_wh)
        scale = px_per_unit / size * [1, -1]
        # the image's corners are those of the outermost pixels, half a pixel from their centres
        offset = -low * px_per_unit + [0.0, px_per_unit[1]] + 0.5 * scale
        return cls(ct, plane, shown_slice(context.scene, plane), scale, offset)

    def region_from_px(self, place: np.ndarray) -> np.ndarray:
        """``(2,)`` pixel of the slice -> region pixels."""
        return np.asarray(place) * self.scale + self.offset

    def px_from_region(self, place: np.ndarray) -> np.ndarray:
        """``(2,)`` region pixels -> pixel of the slice."""
        return (np.asarray(place) - self.offset) / self.scale


def shown_slice(scene: bpy.types.Scene, plane: SlicePlane) -> int:
    """Number of the slice through the scene's point."""
    place, _, _ = plane.place_of(np.array(scene.oneframe_ct.cursor_mm))
    return int(np.clip(np.rint(place), 0, plane.count - 1))


def inside(ct: LoadedCT, point_mm: np.ndarray) -> np.ndarray:
    """The nearest point ``(3,)`` between the centres of the outermost voxels, LPS, mm."""
    plane = ct.planes[0]
    number, u, v = plane.place_of(point_mm)
    width, height = plane.size_wh
    return plane.point_at(
        *(float(np.clip(at, 0, n - 1)) for at, n in zip((number, u, v), (plane.count, width, height), strict=True))
    )
