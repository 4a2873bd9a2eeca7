"""Whether a run can write to the dataset's folder: said before anything starts."""

import json
from pathlib import Path

import bpy
import numpy as np

from ..pipeline.case.loaded_case import LoadedCase
from ..pipeline.dataset.description import describe, input_files, inputs_sha256
from ..pipeline.dataset.identity import COUNT
from ..pipeline.dataset.layout import RECORD, WORK
from ..pipeline.dataset.options import DatasetOptions
from ..pipeline.dataset.run.run_folder import check_description
from ..pipeline.errors import InputError
from ..pipeline.files.content import LARGEST_TEXT, read_file

ADVICE = "choose another folder for the dataset"


def existing_views(out: Path) -> int | None:
    """Number of views for which the dataset in a folder was last started; ``None`` if there is no dataset."""
    try:
        count = json.loads(read_file(out / RECORD, LARGEST_TEXT)).get(COUNT)
    except (OSError, ValueError, AttributeError):
        return None
    return count if isinstance(count, int) else None


def check_folder(out: Path, loaded: LoadedCase, options: DatasetOptions, poses: np.ndarray | None) -> None:
    """Check that a run can write to a folder: a new or empty one, or a dataset of this case and these options.

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
    hashes = inputs_sha256(input_files(loaded.case, options))
    asked = describe(loaded, options, poses, hashes=hashes, blender=bpy.app.version_string)
    if (out / RECORD).exists():
        check_description(out, asked, poses, advice=f"set them back to continue it, or {ADVICE}")
    elif out.is_dir() and not (out / WORK).exists() and any(out.iterdir()):
        raise InputError(
            f"{out}: expected a new or empty folder, or a dataset to continue, found other files; {ADVICE}"
        )
