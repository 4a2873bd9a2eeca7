"""The CT of a scene: the scene stores where it is, the voxels are in memory, and are read again from their file."""

from dataclasses import dataclass

import bpy
from bpy.props import FloatProperty, IntProperty, StringProperty

from ..class_registration import at_end, attached, prop
from ..pipeline.errors import InputError
from ..pipeline.volume.bone.bone import DEFAULT_HU
from ..pipeline.volume.volume import LabelMap, Volume
from ..state import from_scene

Key = tuple[str, int, str]
"""Path of the CT, number of its series, and path of the labels; empty for none."""


class ONEFRAME_PG_ct(bpy.types.PropertyGroup):
    """The CT of a scene: neither voxels nor texts of a header."""

    path: str = prop(StringProperty, "CT", "File, or folder of DICOM slices", subtype="FILE_PATH")
    series: int = prop(IntProperty, "Series", "Number of the series in the folder; 0 for its only one")
    labels_path: str = prop(StringProperty, "Labels", "The label map of the structures", subtype="FILE_PATH")
    threshold_hu: float = prop(
        FloatProperty,
        "Threshold (HU)",
        "Bone lies above it",
        default=DEFAULT_HU,
        soft_min=-200,
        soft_max=2000,
        min=-32000,
        max=32000,
        step=500,
        precision=0,
    )


@dataclass(frozen=True)
class LoadedCT:
    """A CT in memory, and the structures of its label map."""

    volume: Volume
    labels: LabelMap | None = None


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
    """The scene's CT."""
    ct = ct_of(scene)
    if ct is None:
        raise InputError(
            "expected a CT, found none; open one" if key_of(scene) is None else "press Read CT Again first"
        )
    return ct


def keep(scene: bpy.types.Scene, ct: LoadedCT) -> None:
    """Keep a CT in memory as that of the scene."""
    key = key_of(scene)
    _loaded.clear()
    if key is not None:
        _loaded[key] = ct


PARTS = (attached(bpy.types.Scene, "oneframe_ct", ONEFRAME_PG_ct), at_end(_loaded.clear))
