"""What a run renders, and where: the case in a file beside the dataset, and a folder that it can write to.

The user's own case file gets the settings alone.
"""

import json
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ..pipeline.case.case_file import case_from_text, read_case
from ..pipeline.case.case_writer import case_text, encoded, write_case
from ..pipeline.case.loaded_case import LoadedCase
from ..pipeline.case.pose_record import UNKNOWN
from ..pipeline.dataset.description import describe, inputs_sha256
from ..pipeline.dataset.description import input_files as described_files
from ..pipeline.dataset.identity import COUNT
from ..pipeline.dataset.layout import RECORD, WORK
from ..pipeline.dataset.options import DatasetOptions
from ..pipeline.dataset.run.run_folder import check_description
from ..pipeline.errors import InputError
from ..pipeline.files.content import LARGEST_TEXT, read_file
from ..pipeline.files.outputs import check_outputs, write_output
from ..state import from_scene
from ..state.case_of_file import case_of_file, keep_case_of_file
from ..state.scene_files import check_lasting, forget_stamps, input_files

SUFFIX = ".case.toml"
COMMENT = (
    "Written by Render Dataset: the case of the dataset beside it. Changes are overwritten; Save Case writes yours."
)
ADVICE = "choose another folder for the dataset"


def usual_output(scene: bpy.types.Scene) -> Path:
    """The folder of a dataset unless another one is chosen: ``dataset`` beside the case, or else beside the frame."""
    settings = scene.oneframe
    return from_scene.absolute_path(settings.case_path or settings.frame_path).parent / "dataset"


def output_folder(scene: bpy.types.Scene) -> Path:
    """The dataset's folder: the chosen one, or the usual one."""
    chosen = scene.oneframe.dataset_out
    return from_scene.absolute_path(chosen) if chosen else usual_output(scene)


def existing_views(out: Path) -> int | None:
    """Number of views for which the dataset in a folder was last started; ``None`` if there is no dataset."""
    try:
        count = json.loads(read_file(out / RECORD, LARGEST_TEXT)).get(COUNT)
    except (OSError, ValueError, AttributeError):
        return None
    return count if isinstance(count, int) else None


def check_folder(out: Path, loaded: LoadedCase, options: DatasetOptions, poses: np.ndarray | None) -> None:
    """Check, before anything starts, that a run can write to a folder: a new one, or a dataset of this case.

    Parameters
    ----------
    out
        The dataset's folder.
    loaded, options
        What would be rendered.
    poses
        ``(N, 4, 4)`` listed ``cam_from_model``, mm, or ``None`` if the poses are drawn. A dataset grows to their
        number, or to that of the options.

    Raises
    ------
    InputError, RunError
        It cannot.
    """
    if out.is_file():
        raise InputError(f"{out}: expected a folder for the dataset, found a file; {ADVICE}")
    hashes = inputs_sha256(described_files(loaded.case, options))
    asked = describe(loaded, options, poses, hashes=hashes, blender=bpy.app.version_string)
    if (out / RECORD).exists():
        check_description(out, asked, poses, advice=f"set them back to continue it, or {ADVICE}")
    elif out.is_dir() and not (out / WORK).exists() and any(out.iterdir()):
        raise InputError(
            f"{out}: expected a new or empty folder, or a dataset to continue, found other files; {ADVICE}"
        )


def save_settings(scene: bpy.types.Scene) -> None:
    """Save the options of the dataset with the scene's case, so that the next session continues its run."""
    if not scene.oneframe.case_path:
        return
    path, table = from_scene.absolute_path(scene.oneframe.case_path), from_scene.dataset_table(scene)
    write_case(path, replace(read_case(path, posed=False), dataset=table))
    if (known := case_of_file(scene)) is not None:
        keep_case_of_file(scene, replace(known, dataset=table))
    forget_stamps()


def write_snapshot(scene: bpy.types.Scene, out: Path) -> Path:
    """Write the scene's case beside the dataset's folder, which holds nothing but the dataset, and return its path.

    The same case gives the same bytes.
    """
    path = out.with_name(out.name + SUFFIX)
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
