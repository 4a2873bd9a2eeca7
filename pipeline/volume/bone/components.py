"""The connected parts of a mask of voxels, by SimpleITK."""

from dataclasses import dataclass

import numpy as np

from ..simple_itk import simple_itk


@dataclass(frozen=True)
class Components:
    """Parts of a mask whose voxels touch by their faces.

    Attributes
    ----------
    part
        ``(Z, Y, X)`` uint32, number of the voxel's part, 1 to P; 0 outside the mask.
    voxels
        ``(P,)`` number of voxels of each part.
    """

    part: np.ndarray
    voxels: np.ndarray

    def chosen(self, parts: np.ndarray) -> np.ndarray:
        """``(Z, Y, X)`` bool: the voxels of the parts that ``(P,)`` bool selects."""
        return np.concatenate([[False], parts])[self.part]

    @property
    def touching_border(self) -> np.ndarray:
        """``(P,)`` bool: the parts with a voxel in the outermost layers."""
        found = np.zeros(len(self.voxels) + 1, np.bool_)
        for axis in range(3):
            found[self.part.take([0, -1], axis=axis)] = True
        return found[1:]


def components(mask: np.ndarray) -> Components:
    """The parts of a ``(Z, Y, X)`` bool mask."""
    sitk = simple_itk()
    part = sitk.GetArrayFromImage(sitk.ConnectedComponent(sitk.GetImageFromArray(mask.view(np.uint8))))
    # layer by layer, which bounds the memory
    voxels = np.zeros(int(part.max()) + 1, np.int64)
    for layer in part:
        counts = np.bincount(layer.ravel())
        voxels[: len(counts)] += counts
    return Components(part, voxels[1:])
