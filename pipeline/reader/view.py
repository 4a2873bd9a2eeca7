"""One view of a dataset, whose parts are read and decoded when they are first asked for."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..dataset.decoding import depth_mm
from ..dataset.normals import normal_codes, unit_vectors
from ..dataset.truths import points_model
from .files import Boxes, Numbers, ViewFiles


@dataclass(frozen=True, eq=False)
class View:
    """One view. Its arrays are read and decoded when they are first asked for, and kept with the view.

    Attributes
    ----------
    index
        Its number in the dataset.
    files
        Where it comes from.
    """

    index: int
    files: ViewFiles

    @cached_property
    def rgb(self) -> np.ndarray:
        """``(H, W, 3)`` uint8 RGB; black where neither surface nor anything around or in front of it is seen."""
        return self.files.array(self.index, "rgb")

    @cached_property
    def depth_mm(self) -> np.ndarray:
        """``(H, W)`` float32 depth of what is seen along the optical axis, mm; 0 where there is nothing.

        That is the surface, or with ``--occluders`` what stands in front: see :attr:`mask_occluder`.
        The float depth if the dataset has it, else the 16-bit image times its scale.
        """
        if "depth_mm" in self.files.description.kinds:
            return self.files.array(self.index, "depth_mm")
        return depth_mm(self.files.array(self.index, "depth"), self._numbers.depth_scale)

    @property
    def mask(self) -> np.ndarray:
        """``(H, W)`` bool: the visible surface, as :attr:`mask_visib`."""
        return self.mask_visib

    @cached_property
    def mask_visib(self) -> np.ndarray:
        """``(H, W)`` bool: the surface is at the pixel's centre, and nothing stands in front of it."""
        return self.files.array(self.index, "mask_visib") > 0

    @cached_property
    def mask_whole(self) -> np.ndarray:
        """``(H, W)`` bool: the surface is at the pixel's centre, whatever stands in front of it; BOP's ``mask``."""
        return self.files.array(self.index, "mask") > 0

    @cached_property
    def mask_occluder(self) -> np.ndarray:
        """``(H, W)`` bool: something stands at the pixel's centre, in front of the surface or beside it."""
        return self._marked("mask_occluder")

    @cached_property
    def mask_surround(self) -> np.ndarray:
        """``(H, W)`` bool: with ``--surroundings``, the pixel shows what the frame does around the surface."""
        return self._marked("mask_surround")

    def _marked(self, kind: str) -> np.ndarray:
        if kind in self.files.description.kinds:
            return self.files.array(self.index, kind) > 0
        return np.zeros(self.files.description.camera.shape_hw, bool)

    @cached_property
    def observed(self) -> np.ndarray:
        """``(H, W)`` bool: surface that a source frame saw."""
        return self.files.array(self.index, "mask_observed") > 0

    @cached_property
    def normals(self) -> np.ndarray:
        """``(H, W, 3)`` float32 unit normals of the visible side, camera axes; 0 where there is no surface.

        They are those of the model's triangles at the pixels' centres, not differences of the depth: these mix surfaces
        at every edge and step, and its rounding tilts them. Computed if the dataset was rendered without.
        """
        if "normals" in self.files.description.kinds:
            return unit_vectors(self.files.array(self.index, "normals"))
        camera = self.files.description.camera
        return unit_vectors(normal_codes(self.mask_visib, self.files.mesh, camera, self.cam_from_model))

    @cached_property
    def points_model(self) -> np.ndarray:
        """``(H, W, 3)`` float32 points of the visible surface at pixels' centres, mm, mesh in ``models/``, or NaN.

        Those of ``--points`` if the dataset has them, else from :attr:`depth_mm`.
        """
        if "points" in self.files.description.kinds:
            return self.files.array(self.index, "points")
        surface_mm = np.where(self.mask_visib, self.depth_mm, np.float32(0))
        return points_model(surface_mm, self.files.description.camera, self.cam_from_model)

    @cached_property
    def right(self) -> "View":
        """The right eye of this view, of a dataset that was rendered with both eyes."""
        return View(self.index, self.files.right)

    @cached_property
    def source_frame(self) -> np.ndarray:
        """``(H, W)`` uint8: which frame of the case colours the surface, from 1; 0 where none saw it."""
        several = self.files.description.frames > 1
        return self.files.array(self.index, "source_frame") if several else self.observed.astype(np.uint8)

    @property
    def k(self) -> np.ndarray:
        """``(3, 3)`` intrinsics px_from_cam; pixel (0, 0) is the centre of the top-left pixel."""
        return self._numbers.k

    @property
    def cam_from_model(self) -> np.ndarray:
        """``(4, 4)`` pose of the mesh in ``models/``, mm, OpenCV camera axes."""
        return self._numbers.cam_from_model

    @property
    def boxes(self) -> Boxes:
        """Boxes of the surface."""
        return self._numbers.boxes

    @property
    def visib_fract(self) -> float:
        """Visible fraction of the silhouette, 0..1."""
        return self._numbers.visib_fract

    @cached_property
    def _numbers(self) -> Numbers:
        return self.files.numbers(self.index)
