"""The files that Save Case puts into the case's folder: what was made in this session, and on request all others."""

import json
from collections.abc import Callable
from pathlib import Path

import bpy

from ..pipeline.case.case_folder import FRAME, KeptFile, check_new, keep_files, kept_mesh, made_by_file
from ..pipeline.case.frame import read_frame
from ..pipeline.case.surface_folder import SURFACE, structure_file
from ..state import from_scene, to_scene
from ..state.scene_files import input_files, is_temporary
from ..volume.surface import made_by


def keep_beside(scene: bpy.types.Scene, folder: Path, *, collect: bool, replace: bool) -> list[Path]:
    """Copy files into the case's folder as ``oneframe case`` does, and use the copies.

    It gives the files in the folder that were copied or written.

    Parameters
    ----------
    folder
        The case's; files in it stay as they are.
    collect
        Copy all files, and not only those that end with this session and the frame that was taken from a video.
    replace
        The folder is that of the case that is saved: files with other content than those of the same names get one of
        their content, since these may be the user's own.
    """

    frame = from_scene.absolute_path(scene.oneframe.frame_path)
    from_video = scene.oneframe.frame_path == scene.oneframe_video.taken_path

    def is_kept(path: Path) -> bool:
        elsewhere = folder.resolve() not in path.resolve().parents
        return is_temporary(path) or (elsewhere and (collect or (from_video and path == frame)))

    kept: list[tuple[KeptFile, Callable[[str], None]]] = []
    inputs = {name: path for name, path in input_files(scene).items() if name != "case" and not is_kept(path)}
    if is_kept(frame):
        target = folder / (frame.name if from_video and not collect else FRAME)
        kept.append(
            (KeptFile(target, read_frame(frame).encoded()), lambda path: to_scene.relink_frame(scene, Path(path)))
        )
    surface, before_surface = from_scene.surface_of(scene), len(kept)
    for made in (surface, *(child for child in surface.children if child.oneframe.role == "STRUCTURE")):
        source = from_scene.absolute_path(made.oneframe.mesh_path)
        if is_kept(source):
            target = folder / (SURFACE if made == surface else structure_file(made.name))
            kept.append((kept_mesh(source, target), _relinked(made)))
    if replace:
        kept = [(file.beside(), relink) for file, relink in kept]
    files = [file for file, _ in kept]
    record, mesh = made_by(scene), from_scene.absolute_path(surface.oneframe.mesh_path)
    if is_kept(mesh):
        mesh = files[before_surface].path
    if record is not None and mesh.resolve().parent == folder.resolve():
        files.append(KeptFile(made_by_file(mesh), (json.dumps(record, indent=2) + "\n").encode()))
    if not replace:
        check_new(files, "choose another folder")
    keep_files(files, inputs)
    for file, relink in kept:
        relink(str(file.path.resolve()))
    if from_video:
        scene.oneframe_video.taken_path = scene.oneframe.frame_path
    return [each.path for each in files]


def _relinked(made: bpy.types.Object) -> Callable[[str], None]:
    def relink(path: str) -> None:
        made.oneframe.mesh_path = path

    return relink
