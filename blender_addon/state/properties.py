"""What a scene stores besides the objects: paths of files, K as typed, landmarks, display settings."""

import math
from collections.abc import Sequence
from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    IntVectorProperty,
    PointerProperty,
    StringProperty,
)

from ..class_registration import attached, prop
from ..pipeline.camera.pinhole import PixelOrigin
from ..pipeline.dataset.options import OPTIONS, PATHS
from . import events

UNITS = [("mm", "Millimetres", "The mesh's numbers are millimetres"), ("m", "Metres", "The mesh's numbers are metres")]
ORIGINS = [
    ("center", "Centre", "Pixel (0, 0) is the centre of the top-left pixel (OpenCV)"),
    ("corner", "Corner", "Pixel (0, 0) is the corner of the top-left pixel (COLMAP, OpenGL)"),
]


def _keep_name_unique(landmark: "ONEFRAME_PG_landmark", _context: bpy.types.Context) -> None:
    """Append a number to a name that is empty or in use: files identify landmarks by name."""
    taken = {other.name for other in landmark.id_data.oneframe.landmarks if other != landmark}
    wanted = landmark.name.strip() or "Landmark"
    name, number = wanted, 1
    while name in taken:
        name, number = f"{wanted}.{number:03d}", number + 1
    # assigning calls this again, which then finds nothing to change
    if landmark.name != name:
        landmark.name = name


class ONEFRAME_PG_landmark(bpy.types.PropertyGroup):
    """A 2D-3D correspondence: a surface point and an image point, either of which may still be missing."""

    name: str = prop(StringProperty, "Name", "Name of the landmark", update=_keep_name_unique)
    enabled: bool = prop(
        BoolProperty, "Use", "Use this correspondence for the pose", default=True, update=events.landmarks_changed
    )
    has_point: bool = prop(BoolProperty, description="The point on the surface has been picked")
    point: Sequence[float] = prop(
        FloatVectorProperty,
        "Surface Point",
        "Point on the surface, frame and units of the mesh file",
        size=3,
        precision=4,
    )
    has_pixel: bool = prop(BoolProperty, description="The point in the frame has been picked")
    pixel: Sequence[float] = prop(
        FloatVectorProperty,
        "Image Point",
        "Pixel of the undistorted frame; (0, 0) is the centre of the top-left pixel",
        size=2,
        precision=3,
    )


def _typed_number(name: str, description: str) -> Any:
    """A number as text: Blender's own have seven digits, a calibration has more. Empty until it is known."""
    return prop(StringProperty, name, description)


class ONEFRAME_PG_camera(bpy.types.PropertyGroup):
    """K as typed in the panel, in every digit; Set Camera applies it."""

    width: int = prop(IntProperty, "Width", "Width of the frame in pixels", min=1, max=65536, default=1920)
    height: int = prop(IntProperty, "Height", "Height of the frame in pixels", min=1, max=65536, default=1080)
    fx: str = _typed_number("fx", "Focal length in pixels, along x")
    fy: str = _typed_number("fy", "Focal length in pixels, along y")
    cx: str = _typed_number("cx", "Principal point in pixels, x")
    cy: str = _typed_number("cy", "Principal point in pixels, y")
    pixel_origin: PixelOrigin = prop(
        EnumProperty, "Pixel Origin", "Where pixel (0, 0) of the principal point is", items=ORIGINS, default="center"
    )
    distortion: str = prop(
        StringProperty, "Distortion", "OpenCV's k1, k2, p1, p2, k3, separated by commas; empty for none"
    )


def _dataset_annotations() -> dict:
    """One property for every option of a dataset, with the same name, limits and description."""
    annotations: dict[str, Any] = {}
    for option in OPTIONS.values():
        if option.key in PATHS:
            continue
        given: dict[str, Any] = {
            "name": option.label,
            "description": option.text[:1].upper() + option.text[1:],
            "default": option.default,
        }
        if option.choices:
            items = [(choice, choice.capitalize(), about) for choice, about in option.choices.items()]
            annotations[option.key] = EnumProperty(items=items, **given)
        elif option.kind is bool:
            annotations[option.key] = BoolProperty(**given)
        else:
            kind: Any = IntProperty if option.kind is int else FloatProperty
            limits = {"min": option.least, "max": option.most}
            ends = {end: option.kind(limit) for end, limit in limits.items() if math.isfinite(limit)}
            annotations[option.key] = kind(**ends, **given)
    return annotations


class ONEFRAME_PG_dataset(bpy.types.PropertyGroup):
    """The options of a dataset, see :data:`OPTIONS`."""

    __annotations__ = _dataset_annotations()


class ONEFRAME_PG_scene(bpy.types.PropertyGroup):
    """Everything that the add-on stores in a scene."""

    case_path: str = prop(StringProperty, "Case", "The case file that was opened or saved", subtype="FILE_PATH")
    mask_brush_px: float = prop(
        FloatProperty,
        "Brush",
        "Radius of the brush of the tool Mask, pixels of the frame",
        min=1,
        max=2000,
        default=20,
        update=events.redraw,
    )
    case_text: str = prop(StringProperty, description="The case as its file has it (TOML)", options={"HIDDEN"})
    frame_path: str = prop(StringProperty, "Frame", "The frame's image file", subtype="FILE_PATH")
    frame_size: Sequence[int] = prop(IntVectorProperty, "Frame Size", "Width and height of the frame in pixels", size=2)
    video_text: str = prop(
        StringProperty, description="Film of the frame, and its number there (JSON)", options={"HIDDEN"}
    )
    refused: str = prop(StringProperty, "Refused", "Why the frame is refused; empty unless it is")
    evidence: str = prop(StringProperty, description="What the pose rests on (JSON)", options={"HIDDEN"})
    began_at_guess: bool = prop(
        BoolProperty, description="The surface began at a pose that was computed without the frame", options={"HIDDEN"}
    )
    units: str = prop(EnumProperty, "Units", "Unit of the mesh files", items=UNITS, default="mm")
    camera: ONEFRAME_PG_camera = prop(PointerProperty, type=ONEFRAME_PG_camera)
    distortion_text: str = prop(StringProperty, description="Distortion in use (JSON), exact", options={"HIDDEN"})
    camera_object: bpy.types.Object | None = prop(
        PointerProperty, "Camera", "The frame's camera", type=bpy.types.Object
    )
    surface: bpy.types.Object | None = prop(
        PointerProperty, "Surface", "The surface that is aligned", type=bpy.types.Object
    )
    landmarks: "bpy.types.bpy_prop_collection_idprop[ONEFRAME_PG_landmark]" = prop(
        CollectionProperty, type=ONEFRAME_PG_landmark
    )
    landmark_index: int = prop(IntProperty, "Active Landmark", "Landmark being edited")
    click_sigma_px: float = prop(
        FloatProperty,
        "Click Noise",
        "Standard deviation of a picked image point in pixels: how exactly you can click",
        default=2.0,
        min=0.05,
        max=50.0,
    )
    show_files: bool = prop(BoolProperty, "Files", "Show what frame, K and surface are loaded with", options={"HIDDEN"})
    show_landmarks: bool = prop(
        BoolProperty, "Show Landmarks", "Draw landmarks, residuals and the pose's uncertainty", default=True
    )
    dataset: ONEFRAME_PG_dataset = prop(PointerProperty, type=ONEFRAME_PG_dataset)
    dataset_out: str = prop(
        StringProperty, "Folder", "Folder of the dataset; a stopped run continues there", subtype="DIR_PATH"
    )
    preview_view: int = prop(IntProperty, "View", "Number of the view to preview, counted from 0", min=0)


class ONEFRAME_PG_object(bpy.types.PropertyGroup):
    """The role of an object in the alignment, and the file it was loaded from."""

    role: str = prop(
        EnumProperty, "Role", items=[("NONE", "None", ""), ("SURFACE", "Surface", ""), ("STRUCTURE", "Structure", "")]
    )
    mesh_path: str = prop(StringProperty, "Mesh", "File that the mesh was loaded from", subtype="FILE_PATH")


PARTS = (
    attached(bpy.types.Scene, "oneframe", ONEFRAME_PG_scene),
    attached(bpy.types.Object, "oneframe", ONEFRAME_PG_object),
)
