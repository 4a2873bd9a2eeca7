"""What a scene stores of its CT: where it is, how it is shown and drilled; neither voxels nor texts of a header."""

from collections.abc import Sequence

import bpy
from bpy.props import BoolProperty, FloatProperty, FloatVectorProperty, IntProperty, StringProperty

from ..class_registration import attached, prop
from ..pipeline.volume.bone.threshold import DEFAULT_HU
from ..state.events import redraw

SLICE_SPACE = "IMAGE_EDITOR"
"""The kind of area that shows slices."""


class ONEFRAME_PG_ct(bpy.types.PropertyGroup):
    """The CT of a scene."""

    path: str = prop(StringProperty, "CT", "File, or folder of DICOM slices", subtype="FILE_PATH")
    series: int = prop(IntProperty, "Series", "Number of the series in the folder; 0 for its only one")
    labels_path: str = prop(StringProperty, "Labels", "The label map of the structures", subtype="FILE_PATH")
    threshold_hu: float = prop(
        FloatProperty,
        "Threshold (HU)",
        "Bone lies above it: the line in the slices",
        default=DEFAULT_HU,
        soft_min=-200,
        soft_max=2000,
        min=-32000,
        max=32000,
        step=500,
        precision=0,
        update=redraw,
    )
    level_hu: float = prop(FloatProperty, "Level (HU)", "HU shown as mid-grey", default=300, precision=0, update=redraw)
    width_hu: float = prop(
        FloatProperty,
        "Window (HU)",
        "Range of HU between black and white",
        default=2600,
        min=1,
        soft_max=5000,
        precision=0,
        update=redraw,
    )
    cursor_mm: Sequence[float] = prop(
        FloatVectorProperty, "Point", "Where the slices meet, LPS, mm", size=3, precision=2, update=redraw
    )
    burr_mm: float = prop(
        FloatProperty,
        "Burr (mm)",
        "Diameter of the burr",
        default=4.0,
        min=0.4,
        max=20.0,
        precision=1,
        step=50,
        update=redraw,
    )
    drilling: bool = prop(BoolProperty, description="The drill is in use", options={"HIDDEN"})
    strokes_text: str = prop(
        StringProperty, description="What was drilled (JSON): radius and points, LPS, mm, exact", options={"HIDDEN"}
    )
    margins_text: str = prop(
        StringProperty, description="Margins that were chosen (JSON), mm; empty: none yet", options={"HIDDEN"}
    )


PARTS = (attached(bpy.types.Scene, "oneframe_ct", ONEFRAME_PG_ct),)
