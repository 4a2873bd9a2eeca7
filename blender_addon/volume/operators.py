"""Operators that open a CT and its labels, choose the threshold, and make surface and structures."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, IntProperty, StringProperty

from ..class_registration import prop
from ..pipeline.case.surface_doubts import extents_of, size_text
from ..pipeline.case.surface_folder import write_meshes
from ..pipeline.errors import InputError
from ..pipeline.surface.mesh import Ball, TriangleMesh, ball_around
from ..pipeline.surface.mesh_reader import read_mesh
from ..pipeline.surface.structure_colour import structure_colour
from ..pipeline.volume.bone.bone import DEFAULT_HU, bone_voxels, check_threshold, otsu_threshold
from ..pipeline.volume.bone.bone_surface import STAGES
from ..pipeline.volume.bone.structures import structure_names, without_bone
from ..pipeline.volume.make_surface import STRUCTURES_STAGE, SurfaceSettings, make_surface
from ..pipeline.volume.reading.dicom_series import SeriesInfo
from ..pipeline.volume.reading.label_map import read_labels
from ..pipeline.volume.reading.volume_header import volume_suffix
from ..pipeline.volume.reading.volume_reader import is_dicom, list_series, read_volume
from ..state import from_scene, to_scene, workbench
from ..state.initial_pose import renew_initial_pose
from ..state.scene_files import session_folder
from ..state.to_scene import put_structures
from ..ui.background_operator import InBackground, OpensInBackground, Work
from ..ui.operator import Available, Messages, OperatorResult, Reporting
from ..ui.question import ask_first
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
        key = key_of(context.scene)
        # read again, with its labels
        labels = key[2] if key is not None and key[:2] == (str(path), series) else ""

        def read(_progress: object) -> LoadedCT | tuple[SeriesInfo, ...]:
            if path.is_dir() and not series:
                found = [each for each in list_series(path) if each.may_be_a_volume]
                if len(found) > 1 and not bpy.app.background:
                    return tuple(found)
            volume = read_volume(path, series=series or None)
            return LoadedCT(volume, read_labels(Path(labels), volume) if labels else None)

        return read

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        path = _file_or_folder(self.filepath)
        if not isinstance(result, LoadedCT):
            _ask_for_series(context, path, result)
            return (f"{len(result)} series in the folder: choose one",)
        settings = workbench.enter(context).oneframe_ct
        if result.labels is None:
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


MADE_FROM = "oneframe_ct"
"""Custom property of a surface: the CT that it was made from."""

MADE_BY = "oneframe_made_by"
"""Custom property of a surface: how it was made (JSON, without names of files)."""

_BONE_SHARE = 0.1
"""Of the time, roughly."""


def is_from_ct(scene: bpy.types.Scene) -> bool:
    """Whether the present surface was made from the scene's CT: another version of it keeps pose and landmarks."""
    surface, key = from_scene.present_surface(scene), key_of(scene)
    return surface is not None and key is not None and surface.get(MADE_FROM) == _mark(key)


def made_by(scene: bpy.types.Scene) -> dict[str, Any] | None:
    """How the present surface was made from the scene's CT."""
    surface = from_scene.present_surface(scene)
    if surface is None or not is_from_ct(scene) or MADE_BY not in surface:
        return None
    return dict(json.loads(surface[MADE_BY]))


def _record(ct: LoadedCT, series: int, level: float) -> dict[str, Any]:
    grid = ct.volume.grid
    command = ["oneframe surface CT", *([f"--series {series}"] if series else []), f"--threshold {level!r}"]
    command += ["--labels LABELS"] if ct.labels is not None else []
    return {
        "command": " ".join([*command, "--out surface"]),
        "volume": {"size": list(grid.size), "mesh_from_index": grid.mesh_from_index.tolist()},
        "threshold_hu": level,
        "labels": [] if ct.labels is None else list(structure_names(without_bone(ct.labels)).values()),
    }


def _mark(key: tuple[str, int, str]) -> str:
    return f"{key[0]}:{key[1]}"


class ONEFRAME_OT_make_surface(InBackground, NeedsCT):
    """Make the surface of the bone above the threshold, and the structures of the labels"""

    bl_label = "Make Surface"
    doing = "Making the surface"

    replace: bool = prop(
        BoolProperty, "Replace", "Replace a surface that was not made from this CT", options={"SKIP_SAVE", "HIDDEN"}
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        scene = context.scene
        if not self.replace and from_scene.present_surface(scene) is not None and not is_from_ct(scene):
            question = "The present surface was not made from this CT. Its pose, landmarks and structures go with it."
            ask_first(("Replace the Surface?", question, "Replace"), "make_surface", "INVOKE_DEFAULT", replace=True)
            return {"CANCELLED"}
        return self.start(context)

    def work(self, context: bpy.types.Context) -> Work:
        scene = context.scene
        ct, level = loaded_ct(scene), from_scene.shortest(scene.oneframe_ct.threshold_hu)
        self._inputs, self._record = _inputs(scene), _record(ct, scene.oneframe_ct.series, level)
        if not self.replace and from_scene.present_surface(scene) is not None and not is_from_ct(scene):
            raise InputError("expected no surface, found one that was not made from this CT; replace it by choice")

        def make(progress: Any) -> tuple[Ball | None, Mapping[str, TriangleMesh], dict[str, Path]]:
            check_threshold(ct.volume, level)
            solid = bone_voxels(ct.volume, level)
            progress(_BONE_SHARE)
            stages = (STRUCTURES_STAGE, *STAGES)

            def report(stage: str, share: float) -> None:
                progress(_BONE_SHARE + (1 - _BONE_SHARE) * (stages.index(stage) + share) / len(stages))

            labels = None if ct.labels is None else without_bone(ct.labels)
            made = make_surface(ct.volume, level, solid, labels, SurfaceSettings(), report=report)
            paths = write_meshes(session_folder(), made.bone.mesh, made.structures)
            return made.finish.focus, made.structures, paths

        return make

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        scene = context.scene
        if _inputs(scene) != self._inputs:
            raise InputError("the CT or its threshold has changed meanwhile; start again")
        focus, structures, paths = result
        # as every other tool reads it: the file has single precision
        mesh, _ = read_mesh(paths[""])
        focus = focus or ball_around(mesh)
        key = key_of(scene)
        if is_from_ct(scene) and scene.oneframe.units == "mm":
            to_scene.exchange_surface(context, paths[""], mesh)
            renew_initial_pose(context, focus)
        else:
            to_scene.set_surface(context, paths[""], mesh, "mm", focus)
        surface = from_scene.surface_of(context.scene)
        surface[MADE_FROM] = "" if key is None else _mark(key)
        surface[MADE_BY] = json.dumps(self._record)
        put_structures(surface, {name: (paths[name], structure_colour(name)) for name in structures})
        named = f", structures {', '.join(structures)}" if structures else ""
        return (f"surface: {len(mesh.faces):,} triangles, {size_text(extents_of(mesh))}{named}",)


def _inputs(scene: bpy.types.Scene) -> tuple[object, ...]:
    return key_of(scene), scene.oneframe_ct.threshold_hu
