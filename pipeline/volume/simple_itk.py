"""SimpleITK, which reads, resamples and grows volumes, and finds connected parts: loaded when it is needed."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from .volume import VoxelGrid


def simple_itk() -> Any:
    """The library, silent: its warnings quote lines of headers, which may name the patient."""
    try:
        # a session without a CT need not load it
        import SimpleITK as sitk
    except ImportError:
        raise InputError(
            "volumes: expected the package SimpleITK, which reads CT, this Python has none; install it with "
            'pip install "SimpleITK>=2.5", or use a Blender in which the OneFrame extension is enabled'
        ) from None
    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    return sitk


def resampled(values: np.ndarray, own: VoxelGrid, wanted: VoxelGrid) -> np.ndarray:
    """``(Z, Y, X)`` values at the voxels of another grid, float32, trilinearly; 0 outside."""
    sitk = simple_itk()
    image, like = sitk.GetImageFromArray(values), sitk.Image(list(wanted.size), sitk.sitkUInt8)
    for each, grid in ((image, own), (like, wanted)):
        each.SetOrigin(grid.mesh_from_index[:3, 3].tolist())
        each.SetSpacing(grid.spacing_mm.tolist())
        each.SetDirection((grid.mesh_from_index[:3, :3] / grid.spacing_mm).ravel().tolist())
    found = sitk.Resample(image, like, sitk.Transform(), sitk.sitkLinear, 0.0, sitk.sitkFloat32)
    return sitk.GetArrayFromImage(found)


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
