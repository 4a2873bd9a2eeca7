"""SimpleITK, which reads, resamples and grows volumes, and finds connected parts: loaded when it is needed."""

from typing import Any

import numpy as np

from ..errors import InputError
from .volume import VoxelGrid


def simple_itk() -> Any:
    """The library, silent: its warnings quote lines of headers, which may name the patient.

    Raises
    ------
    InputError
        It is not installed.
    """
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


def resampled(values: np.ndarray, own: VoxelGrid, wanted: VoxelGrid, *, outside: float | None = None) -> np.ndarray:
    """``(Z, Y, X)`` values at the voxels of another grid.

    Those of the nearest voxels and 0 outside; or, with a value for ``outside``, float32, trilinearly.
    """
    sitk = simple_itk()
    image, like = sitk.GetImageFromArray(values), sitk.Image(list(wanted.size), sitk.sitkUInt8)
    for each, grid in ((image, own), (like, wanted)):
        each.SetOrigin(grid.mesh_from_index[:3, 3].tolist())
        each.SetSpacing(grid.spacing_mm.tolist())
        each.SetDirection((grid.mesh_from_index[:3, :3] / grid.spacing_mm).ravel().tolist())
    if outside is None:
        found = sitk.Resample(image, like, sitk.Transform(), sitk.sitkNearestNeighbor, 0)
    else:
        found = sitk.Resample(image, like, sitk.Transform(), sitk.sitkLinear, outside, sitk.sitkFloat32)
    return sitk.GetArrayFromImage(found)


def grown(mask: np.ndarray, steps: int) -> np.ndarray:
    """A ``(Z, Y, X)`` mask with the neighbours of its voxels added ``steps`` times, or its border taken away."""
    sitk = simple_itk()
    image = sitk.GetImageFromArray(mask.view(np.uint8))
    for _ in range(abs(steps)):
        image = (sitk.BinaryDilate if steps > 0 else sitk.BinaryErode)(image, (1, 1, 1), sitk.sitkCross)
    return sitk.GetArrayFromImage(image).view(np.bool_)
