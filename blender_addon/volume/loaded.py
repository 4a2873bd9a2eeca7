"""The voxels in memory. The scene stores paths only: for a file that is opened, the panel offers to read them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import bpy
import numpy as np

from ..class_registration import at_end
from ..pipeline.errors import InputError
from ..pipeline.volume.reading.label_map import on_grid, read_labels
from ..pipeline.volume.reading.volume_reader import read_volume
from ..pipeline.volume.slices.slice_planes import SlicePlane, slice_planes
from ..pipeline.volume.volume import LabelMap, Volume
from ..state import from_scene

Key = tuple[str, int, str]
"""Path of the CT, number of its series, and path of the labels; empty for none."""


@dataclass(frozen=True)
class LoadedCT:
    """A CT in memory.

    ``labels`` are the structures as in their file, ``label_values`` ``(Z, Y, X)`` their labels on the grid of the
    volume.
    """

    volume: Volume
    labels: LabelMap | None = None
    label_values: np.ndarray | None = None

    @cached_property
    def planes(self) -> tuple[SlicePlane, SlicePlane, SlicePlane]:
        """Axial, coronal, sagittal."""
        return slice_planes(self.volume.grid)

    @cached_property
    def range_hu(self) -> tuple[int, int]:
        """Lowest and highest value."""
        return int(self.volume.values.min()), int(self.volume.values.max())


_loaded: dict[Key, LoadedCT] = {}
"""One CT: two may not fit into memory."""


def key_of(scene: bpy.types.Scene) -> Key | None:
    """What the scene's CT is read from; ``None`` if it has none."""
    settings = scene.oneframe_ct
    if not settings.path:
        return None
    labels = str(from_scene.absolute_path(settings.labels_path)) if settings.labels_path else ""
    return str(from_scene.absolute_path(settings.path)), settings.series, labels


def ct_of(scene: bpy.types.Scene) -> LoadedCT | None:
    """The scene's CT if it is in memory."""
    key = key_of(scene)
    return None if key is None else _loaded.get(key)


def loaded_ct(scene: bpy.types.Scene) -> LoadedCT:
    """The scene's CT.

    Raises
    ------
    InputError
        There is none, or it is not in memory.
    """
    found = ct_of(scene)
    if found is None:
        raise InputError(
            "expected a CT, found none; open one" if key_of(scene) is None else "press Read CT Again first"
        )
    return found


def keep(scene: bpy.types.Scene, ct: LoadedCT) -> None:
    """Keep a CT in memory as that of the scene."""
    key = key_of(scene)
    _loaded.clear()
    if key is not None:
        _loaded[key] = ct


def reader(key: Key) -> Callable[[Callable[[float], None]], LoadedCT]:
    """A function that reads a CT, and its labels, for a thread."""
    path, series, labels_path = key
    known = next((ct for (at, number, _), ct in _loaded.items() if (at, number) == (path, series)), None)

    def read(progress: Callable[[float], None]) -> LoadedCT:
        volume = read_volume(Path(path), series=series or None) if known is None else known.volume
        progress(0.7)
        return with_labels(volume, Path(labels_path)) if labels_path else LoadedCT(volume)

    return read


def with_labels(volume: Volume, path: Path) -> LoadedCT:
    """A CT with the labels of a file.

    Raises
    ------
    InputError
        No label map, or not one of this CT.
    """
    labels = read_labels(path, volume, resampled=False)
    return LoadedCT(volume, labels, on_grid(labels.values, labels.grid, volume.grid, path.name))


def centre_mm(volume: Volume) -> np.ndarray:
    """``(3,)`` LPS, mm: the middle of the volume."""
    return volume.grid.bounds_mm.mean(axis=0)


PARTS = (at_end(_loaded.clear),)
