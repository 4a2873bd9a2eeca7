"""One view of a dataset, whose parts are read and decoded when they are first asked for."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..dataset.dataset_file import Description
from ..dataset.decoding import decoded, depth_mm
from ..dataset.run.resume_record import Box
from ..dataset.truths import NORMAL_UNIT, TRUTHS
from ..errors import InputError


@dataclass(frozen=True)
class Boxes:
    """Boxes of the surface: (x, y, x_max - x, y_max - y) in px, as in BOP; (-1, -1, -1, -1) if it is not visible.

    Attributes
    ----------
    bbox_obj
        Of the whole silhouette, including what is outside the image.
    bbox_visib
        Of the part in the image.
    """

    bbox_obj: Box
    bbox_visib: Box


@dataclass(frozen=True)
class Numbers:
    """The numbers of a view.

    Attributes
    ----------
    k
        ``(3, 3)`` px_from_cam.
    cam_from_model
        ``(4, 4)`` rigid, mm.
    depth_scale
        Millimetres per unit of the 16-bit depth image.
    boxes
        As in BOP's ``scene_gt_info.json``.
    visib_fract
        Visible fraction of the silhouette, 0..1.
    """

    k: np.ndarray
    cam_from_model: np.ndarray
    depth_scale: float
    boxes: Boxes
    visib_fract: float


class ViewFiles:
    """Where views come from: a folder or a pack. All methods may be called by several threads at once."""

    description: Description

    def read(self, index: int, kind: str) -> tuple[bytes, str]:
        """The content of a file of a view, by the name of its array; its name for messages."""
        raise NotImplementedError

    def numbers(self, index: int) -> Numbers:
        """The numbers of a view."""
        raise NotImplementedError

    def array(self, index: int, kind: str) -> np.ndarray:
        """An array of a view, as its file holds it: see :data:`~oneframe.dataset.truths.TRUTHS`.

        Raises
        ------
        InputError
            The dataset has none, or it is damaged.
        """
        if kind not in self.description.kinds:
            raise InputError(
                f"view {index}: expected an array of the dataset, {', '.join(self.description.kinds)}; found {kind}"
            )
        data, where = self.read(index, kind)
        return decoded(data, TRUTHS[kind].form, self.description.camera.shape_hw, where)

    def close(self) -> None:
        """Give back all handles of files."""


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
        """``(H, W, 3)`` uint8 RGB; black where there is no surface."""
        return self.files.array(self.index, "rgb")

    @cached_property
    def depth_mm(self) -> np.ndarray:
        """``(H, W)`` float32 depth along the optical axis, mm; 0 where there is no surface.

        The float depth if the dataset has it, else the 16-bit image times its scale.
        """
        if "depth_mm" in self.files.description.kinds:
            return self.files.array(self.index, "depth_mm")
        return depth_mm(self.files.array(self.index, "depth"), self._numbers.depth_scale)

    @cached_property
    def mask(self) -> np.ndarray:
        """``(H, W)`` bool: the surface is at the pixel's centre, and nothing stands in front of it."""
        return self.files.array(self.index, "mask_visib") > 0

    @cached_property
    def observed(self) -> np.ndarray:
        """``(H, W)`` bool: surface that a source frame saw."""
        return self.files.array(self.index, "mask_observed") > 0

    @cached_property
    def normals(self) -> np.ndarray:
        """``(H, W, 3)`` float32 unit normals of the visible side, camera axes; 0 where there is no surface.

        Raises
        ------
        InputError
            The dataset was rendered without ``--normals``.
        """
        codes = self.files.array(self.index, "normals")
        return np.where(codes.any(axis=2)[..., None], codes / np.float32(NORMAL_UNIT) - 1, 0).astype(np.float32)

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
