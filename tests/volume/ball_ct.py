"""A CT of a ball of bone with a nerve in it, on disk."""

from pathlib import Path

import numpy as np
import pytest


def write_ball_ct(folder: Path) -> None:
    """Write ``ct.nii.gz``, and ``labels.nii.gz`` with their names."""
    sitk = pytest.importorskip("SimpleITK")
    z, y, x = np.mgrid[:44, :46, :48] * 0.5
    depth = 8 - np.sqrt((x - 12) ** 2 + (y - 11.5) ** 2 + (z - 11) ** 2)
    nerve = (np.hypot(x - 9, y - 11.5) < 1) & (depth > 1)
    volumes = {"ct": np.clip(300 + 900 * depth, -1000, 1500).astype(np.int16), "labels": nerve.astype(np.uint8)}
    for name, values in volumes.items():
        image = sitk.GetImageFromArray(values)
        image.SetSpacing((0.5, 0.5, 0.5))
        image.SetOrigin((-30.0, 40.0, 900.0))
        sitk.WriteImage(image, str(folder / f"{name}.nii.gz"))
    (folder / "labels.json").write_text('{"labels": {"facial nerve": 1}}')
