"""Files dropped onto a 3D view: each is opened as what its kind and content say."""

from collections.abc import Callable
from pathlib import Path

import bpy

from ..pipeline.case.surface_folder import RECORD
from ..pipeline.errors import InputError
from ..pipeline.surface.structure_colour import OTHER, structure_colour
from ..state import from_scene, workbench
from ..ui.operator import ChosenFiles, Reporting, call
from ..video.operators import VIDEOS
from .operators import CAMERAS, IMAGES, MESHES

LANDMARKS = "*.csv"
TOML = ".toml"


def extensions(glob: str) -> tuple[str, ...]:
    """``"*.png;*.jpg"`` -> ``(".png", ".jpg")``."""
    return tuple(glob.replace("*", "").split(";"))


class ONEFRAME_OT_drop_files(Reporting, ChosenFiles):
    """Open the dropped files: a case, the frame, K, the surface and structures, landmarks"""

    bl_label = "Open in OneFrame"
    bl_options = {"REGISTER", "UNDO", "INTERNAL"}

    def run(self, context: bpy.types.Context) -> None:
        paths = self.chosen_files()
        if not paths:
            raise InputError("expected files, found none; drop them from a file manager")
        for operator, path in _steps(context.scene, paths):
            call(operator, filepath=str(path))


def _steps(scene: bpy.types.Scene, paths: list[Path]) -> list[tuple[str, Path]]:
    """The operator for each file, in an order in which they can follow each other."""
    meshes = [path for path in paths if path.suffix.lower() in extensions(MESHES) or path.name == RECORD]
    bones = [path for path in meshes if structure_colour(path.stem) == OTHER]
    if len(bones) > 1 or (meshes and not bones and from_scene.present_surface(scene) is None):
        names = ", ".join(path.name for path in bones or meshes)
        raise InputError(f"expected one surface, found {names}; drop the surface first, then the structures")
    kinds: tuple[tuple[str, Callable[[Path], bool]], ...] = (
        ("open_case", _is_case),
        ("load_frame", _of_kind(IMAGES)),
        ("load_camera", lambda path: path not in meshes and _of_kind(CAMERAS)(path)),
        ("load_surface", lambda path: path in bones),
        ("add_structure", lambda path: path in meshes),
        ("import_landmarks", _of_kind(LANDMARKS)),
    )
    steps: dict[str, list[Path]] = {operator: [] for operator, _ in kinds}
    for path in paths:
        operator = next((operator for operator, is_of_kind in kinds if is_of_kind(path)), None)
        if operator is None:
            raise InputError(f"{path.name}: expected a case, an image, K, a mesh or landmarks; drop another file")
        steps[operator].append(path)
    return [(operator, path) for operator, found in steps.items() for path in sorted(found)]


def _of_kind(glob: str) -> Callable[[Path], bool]:
    return lambda path: path.suffix.lower() in extensions(glob)


def _is_case(path: Path) -> bool:
    """Whether a file is a case; a TOML file may hold K alone. Only its beginning is read."""
    if path.suffix.lower() != TOML:
        return False
    try:
        with path.open("rb") as opened:
            return b"[frame]" in opened.read(1 << 16)
    except OSError:
        return True  # opening the case says what is wrong with it


class _Dropped(bpy.types.FileHandler):
    """Mixin: files dropped onto a 3D view, of the workbench only: elsewhere they are Blender's."""

    bl_import_operator = "oneframe.drop_files"
    is_ours = False
    """Whether nothing else in Blender opens them, in any scene."""

    @classmethod
    def poll_drop(cls, context: bpy.types.Context | None) -> bool:
        if context is None or context.area is None or context.area.type != "VIEW_3D":
            return False
        return cls.is_ours or workbench.is_workbench(context.scene)


class ONEFRAME_FH_case(_Dropped):
    """Cases, in any scene"""

    bl_label = "OneFrame Case"
    bl_file_extensions = TOML
    is_ours = True


class ONEFRAME_FH_files(_Dropped):
    """Images, K, meshes and landmarks"""

    bl_label = "OneFrame"
    bl_file_extensions = ";".join(
        sorted({kind for glob in (IMAGES, CAMERAS, MESHES, LANDMARKS) for kind in extensions(glob)} - {TOML})
    )


class ONEFRAME_FH_video(_Dropped):
    """Videos"""

    bl_label = "OneFrame Video"
    bl_import_operator = "oneframe.open_video"
    bl_file_extensions = VIDEOS.replace("*", "")


class ONEFRAME_FH_ct(_Dropped):
    """Volumes, in any scene"""

    bl_label = "OneFrame CT"
    bl_import_operator = "oneframe.open_ct"
    # of .nii.gz Blender looks at the last part
    bl_file_extensions = ".nii;.gz;.nrrd"
    is_ours = True
