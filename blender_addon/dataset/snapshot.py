"""The case as a run renders it, in a file beside the dataset; the user's own case file gets its settings alone."""

from dataclasses import replace
from pathlib import Path

import bpy

from ..pipeline.case.case_file import case_from_text, read_case
from ..pipeline.case.case_writer import case_text, encoded, write_case
from ..pipeline.case.pose_record import UNKNOWN
from ..pipeline.errors import InputError
from ..pipeline.files.outputs import check_outputs, write_output
from ..state import from_scene
from ..state.known_case import keep_known, known_case
from ..state.scene_files import check_lasting, forget_stamps, input_files

SUFFIX = ".case.toml"
COMMENT = (
    "Written by Render Dataset: the case of the dataset beside it. Changes are overwritten; Save Case writes yours."
)


def save_settings(scene: bpy.types.Scene) -> None:
    """Save the options of the dataset with the scene's case, so that the next session continues its run."""
    if not scene.oneframe.case_path:
        return
    path, table = from_scene.absolute_path(scene.oneframe.case_path), from_scene.dataset_table(scene)
    write_case(path, replace(read_case(path, posed=False), dataset=table))
    if (known := known_case(scene)) is not None:
        keep_known(scene, replace(known, dataset=table))
    forget_stamps()


def usual_output(scene: bpy.types.Scene) -> Path:
    """The folder of a dataset unless another one is chosen: ``dataset`` beside the case, or else beside the frame."""
    settings = scene.oneframe
    return from_scene.absolute_path(settings.case_path or settings.frame_path).parent / "dataset"


def snapshot_path(out: Path) -> Path:
    """The snapshot's file: beside the dataset's folder, which holds nothing but the dataset."""
    return out.with_name(out.name + SUFFIX)


def write_snapshot(scene: bpy.types.Scene, out: Path) -> Path:
    """Write the scene's case beside the dataset's folder and return its path; the same case gives the same bytes."""
    path = snapshot_path(out)
    # the record of the pose holds the date, and no view depends on it
    case = replace(from_scene.case(scene, path), alignment=UNKNOWN)
    check_lasting({name: file for name, file in case.input_files().items() if name != "case"})
    text = case_text(path, case, comment=COMMENT)
    case_from_text(text, path)
    data = encoded(path, text)
    if path.is_file() and path.read_bytes() == data:
        return path
    check_outputs([path], input_files(scene))
    if path.exists() and not path.read_bytes().startswith(f"# {COMMENT}\n".encode()):
        raise InputError(f"{path}: expected no such file or that of an earlier run, found another case; rename it")
    write_output(path, data)
    return path
