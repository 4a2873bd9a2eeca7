"""Views in the folder of a dataset."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..dataset.dataset_file import Description
from ..dataset.decoding import decoded_array, decoded_depth, decoded_grey, decoded_rgb
from ..dataset.layout import ViewPaths, largest_view_file
from ..dataset.run.resume_record import read_record
from ..errors import InputError, RunError
from ..files.content import read_file
from .view import Boxes, Truth


@dataclass(frozen=True)
class FolderFiles:
    """The files of a dataset's views.

    Attributes
    ----------
    root, description
        The dataset's folder and what it says.
    """

    root: Path
    description: Description

    def truth(self, index: int) -> Truth:
        """The numbers of a view, from its record."""
        try:
            record = read_record(ViewPaths(self.root, index), with_mask=False)
        except RunError as error:
            raise InputError(str(error)) from None
        info = record.gt_info
        return Truth(
            k=self.description.camera.k,
            cam_from_model=record.cam_from_model,
            depth_scale=record.depth_scale,
            boxes=Boxes(info.bbox_obj, info.bbox_visib),
            visib_fract=info.visib_fract,
        )

    def rgb(self, index: int) -> np.ndarray:
        """``(H, W, 3)`` uint8."""
        data, path = self._read(index, "rgb")
        return decoded_rgb(data, self.description.camera.shape_hw, str(path))

    def depth_mm(self, index: int, depth_scale: float) -> np.ndarray:
        """``(H, W)`` float32, mm."""
        shape = self.description.camera.shape_hw
        if self.description.float_depth:
            data, path = self._read(index, "depth_mm")
            return decoded_array(data, shape, str(path))
        data, path = self._read(index, "depth")
        return decoded_depth(data, depth_scale, shape, str(path))

    def mask(self, index: int, kind: str) -> np.ndarray:
        """``(H, W)`` bool."""
        data, path = self._read(index, kind)
        return decoded_grey(data, np.uint8, self.description.camera.shape_hw, str(path)) != 0

    def close(self) -> None:
        """Nothing is open."""

    def _read(self, index: int, kind: str) -> tuple[bytes, Path]:
        path = ViewPaths(self.root, index).file(kind)
        try:
            return read_file(path, largest_view_file(*self.description.camera.size_wh)), path
        except OSError as error:
            raise InputError(
                f"{path}: expected a file of view {index}, cannot read it ({error.strerror}); check the dataset "
                "(oneframe check)"
            ) from None
