"""Operators that open a CT and its labels, choose the threshold, and read the CT again."""

from pathlib import Path
from typing import Any

import bpy
from bpy.props import IntProperty, StringProperty

from ..class_registration import prop
from ..pipeline.errors import InputError
from ..pipeline.volume.bone.threshold import DEFAULT_HU, otsu_threshold
from ..pipeline.volume.reading.dicom_series import SeriesInfo
from ..pipeline.volume.reading.label_map import read_labels
from ..pipeline.volume.reading.volume_header import volume_suffix
from ..pipeline.volume.reading.volume_reader import is_dicom, list_series, read_volume
from ..state import workbench
from ..ui.background_operator import InBackground, OpensInBackground, Work
from ..ui.operator import Available, Messages, Reporting
from . import ct
from .ct import LoadedCT, ct_of, key_of, loaded_ct

VOLUMES = "*.nii;*.nii.gz;*.nrrd;*.dcm"


class NeedsCT(Available):
    """Mixin: available once a CT is in memory."""

    needs = (lambda context: ct_of(context.scene) is not None, "Open a CT first")


class ONEFRAME_OT_open_ct(OpensInBackground):
    """Open a CT in Hounsfield units: NIfTI, NRRD, or a folder of DICOM slices"""

    bl_label = "Open CT"
    doing = "Reading the CT"

    filter_glob: str = prop(StringProperty, default=VOLUMES, options={"HIDDEN"})
    series: int = prop(
        IntProperty,
        "Series",
        "Number of the series in a folder of DICOM slices; 0 asks if there are several",
        min=0,
        options={"SKIP_SAVE", "HIDDEN"},
    )

    def work(self, context: bpy.types.Context) -> Work:
        path, series = _file_or_folder(self.filepath), self.series

        def read(_progress: object) -> LoadedCT | tuple[SeriesInfo, ...]:
            if path.is_dir() and not series:
                found = [each for each in list_series(path) if each.may_be_a_volume]
                if len(found) > 1 and not bpy.app.background:
                    return tuple(found)
            return LoadedCT(read_volume(path, series=series or None))

        return read

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        path = _file_or_folder(self.filepath)
        if not isinstance(result, LoadedCT):
            _ask_for_series(context, path, result)
            return (f"{len(result)} series in the folder: choose one",)
        settings = workbench.enter(context).oneframe_ct
        settings.property_unset("labels_path")
        settings.path, settings.series = str(path), self.series
        lowest, highest = int(result.volume.values.min()), int(result.volume.values.max())
        if not lowest < settings.threshold_hu < highest:
            settings.threshold_hu = min(max(DEFAULT_HU, lowest), highest)
        ct.keep(context.scene, result)
        return (ct_text(result),)


def ct_text(loaded: LoadedCT) -> str:
    """Size of a CT in words."""
    grid = loaded.volume.grid
    size, spacing = (" x ".join(f"{value:.4g}" for value in each) for each in (grid.size, grid.spacing_mm))
    return f"CT: {size} voxels of {spacing} mm"


def _file_or_folder(filepath: str) -> Path:
    """The file or folder chosen in a dialog; for a DICOM slice its folder."""
    if not filepath:
        raise InputError("expected a CT, found none; choose a file, or go into the folder of its DICOM slices")
    path = Path(bpy.path.abspath(filepath))
    if path.is_dir() or volume_suffix(path) is not None:
        return path
    try:
        return path.parent if is_dicom(path) else path
    except InputError:
        # a name that does not exist was typed, or left over in the dialog: reading says so
        return path.parent if filepath.endswith(("/", "\\")) else path


def _ask_for_series(context: bpy.types.Context, path: Path, found: tuple[SeriesInfo, ...]) -> None:
    """Open a menu of the series in a folder: numbers and sizes only."""

    def draw(menu: Any, _context: bpy.types.Context) -> None:
        layout = menu.layout
        layout.operator_context = "INVOKE_DEFAULT"
        for series in found:
            chosen = layout.operator("oneframe.open_ct", text=str(series))
            chosen.filepath, chosen.series = str(path), series.number

    context.window_manager.popup_menu(draw, title="Choose a Series")


class ONEFRAME_OT_read_ct(InBackground):
    """Read the voxels of this scene's CT from its file again"""

    bl_label = "Read CT Again"
    bl_options = {"REGISTER"}
    doing = "Reading the CT"

    needs = (lambda context: key_of(context.scene) is not None, "Open a CT first")

    def work(self, context: bpy.types.Context) -> Work:
        key = key_of(context.scene)
        if key is None:
            raise InputError("expected a CT, found none; open one")
        return ct.reader(key)

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        ct.keep(context.scene, result)
        return (ct_text(result),)


class ONEFRAME_OT_open_labels(OpensInBackground, NeedsCT):
    """Open a label map of this CT (nnU-Net, 3D Slicer, ITK-SNAP): its structures become meshes with the surface"""

    bl_label = "Open Labels"
    doing = "Reading the labels"

    filter_glob: str = prop(StringProperty, default="*.nii;*.nii.gz;*.nrrd", options={"HIDDEN"})

    def work(self, context: bpy.types.Context) -> Work:
        path, volume = Path(bpy.path.abspath(self.filepath)), loaded_ct(context.scene).volume
        return lambda _progress: LoadedCT(volume, read_labels(path, volume))

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        loaded_ct(context.scene)
        context.scene.oneframe_ct.labels_path = str(Path(bpy.path.abspath(self.filepath)))
        ct.keep(context.scene, result)
        return (f"structures: {', '.join(result.labels.names.values())}",)


class ONEFRAME_OT_otsu(NeedsCT, Reporting):
    """Find the threshold between soft tissue and bone from the grey values (Otsu)"""

    bl_label = "Otsu"

    def run(self, context: bpy.types.Context) -> Messages:
        level = otsu_threshold(loaded_ct(context.scene).volume)
        context.scene.oneframe_ct.threshold_hu = level
        return (f"threshold {level:g} HU",)
