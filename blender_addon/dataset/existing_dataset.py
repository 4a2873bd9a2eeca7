"""Whether a run can write to the dataset's folder, and if not why: said in the window before anything starts."""

import json
from pathlib import Path

import bpy
import numpy as np

from ..pipeline.case.loaded_case import LoadedCase
from ..pipeline.dataset.description import describe, input_files, inputs_sha256
from ..pipeline.dataset.differences import COUNT
from ..pipeline.dataset.layout import FORMAT, RECORD, WORK
from ..pipeline.dataset.options import DatasetOptions
from ..pipeline.dataset.run.same_run import fewest_views, holds_views_of, run_differences
from ..pipeline.errors import InputError
from ..pipeline.files.content import LARGEST_TEXT, read_file
from .wording import in_words

ADVICE = "choose another folder for the dataset"
MOST_LISTED = 4


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
    InputError
        It cannot. The message names what differs as the window does.
    """
    if out.is_file():
        raise InputError(f"{out}: expected a folder for the dataset, found a file; {ADVICE}")
    record, files = out / RECORD, input_files(loaded.case, options)

    def asked() -> dict[str, object]:
        hashes = inputs_sha256(files)
        return describe(loaded, options, poses, hashes=hashes, blender=bpy.app.version_string)

    if not record.exists():
        is_other = out.is_dir() and not (out / WORK).exists() and any(out.iterdir())
        if is_other and not holds_views_of(out, asked(), poses):
            raise InputError(
                f"{out}: expected a new or empty folder, or a dataset to continue, found other files; {ADVICE}"
            )
        return
    try:
        existing = json.loads(read_file(record, LARGEST_TEXT))
    except OSError as error:
        raise InputError(f"{record}: cannot read the file ({error.strerror}); {ADVICE}") from None
    except (ValueError, RecursionError):
        return  # cut off by a loss of power: the run knows whether it can begin anew
    if not isinstance(existing, dict) or existing.get("format") != FORMAT:
        found = existing.get("format") if isinstance(existing, dict) else existing
        raise InputError(f"{out}: expected a dataset of this version of OneFrame ({FORMAT}), found {found!r}; {ADVICE}")
    clauses = (in_words(change, files) for change in run_differences(out, existing, asked(), poses))
    # K is several numbers
    changes = list(dict.fromkeys(clause for clause in clauses if clause is not None))
    if changes:
        more = len(changes) - MOST_LISTED
        listed = "; ".join(changes[:MOST_LISTED]) + (f"; and {more} more" if more > 0 else "")
        raise InputError(
            f"{out}: the folder holds a dataset of other settings: {listed}. Set them back to continue it, or {ADVICE}"
        )
    had, count = existing.get(COUNT), options.count if poses is None else len(poses)
    if isinstance(had, int) and (least := fewest_views(out, had)) > count:
        raise InputError(
            f"{out}: the folder holds a dataset of {least} views, {count} are wanted, and views are never removed; set "
            f"Views to {least} or more, or {ADVICE}"
        )
