"""Whether a run can write to the dataset's folder, and if not why: said in the window before anything starts."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import bpy

from ..pipeline import __version__
from ..pipeline.case.loaded_case import LoadedCase
from ..pipeline.dataset.layout import FORMAT
from ..pipeline.dataset.options import DatasetOptions
from ..pipeline.errors import InputError
from ..pipeline.files.content import read_content
from .wording import label

RECORD = "dataset.json"
ADVICE = "choose another folder for the dataset"
MOST_LISTED = 4

_FRAME_WORDS = {"cam_from_model": "the pose", "distortion": "the distortion"}
_INPUT_WORDS = {"frame": "the frame's image", "surface": "the surface's file", "poses": "the file of poses"}


def existing_views(out: Path) -> int | None:
    """Number of views for which the dataset in a folder was last started; ``None`` if there is no dataset."""
    try:
        count = json.loads((out / RECORD).read_bytes()).get("count")
    except (OSError, ValueError, AttributeError):
        return None
    return count if isinstance(count, int) else None


def check_folder(out: Path, loaded: LoadedCase, options: DatasetOptions, count: int) -> None:
    """Check that a run can write to a folder: a new or empty one, or a dataset of this case and these options.

    Parameters
    ----------
    out
        The dataset's folder.
    loaded, options
        What would be rendered.
    count
        Number of views wanted; a dataset grows to it.

    Raises
    ------
    InputError
        It cannot. The message names what differs as the window does.
    """
    if out.is_file():
        raise InputError(f"{out}: expected a folder for the dataset, found a file; {ADVICE}")
    record = out / RECORD
    if not record.exists():
        _check_new(out)
        return
    try:
        existing = json.loads(record.read_bytes())
    except OSError as error:
        raise InputError(f"{record}: cannot read the file ({error.strerror}); {ADVICE}") from None
    except (ValueError, RecursionError):
        return  # cut off by a loss of power: the run knows whether it can begin anew
    if not isinstance(existing, dict) or existing.get("format") != FORMAT:
        found = existing.get("format") if isinstance(existing, dict) else existing
        raise InputError(f"{out}: expected a dataset of this version of OneFrame ({FORMAT}), found {found!r}; {ADVICE}")
    differences = _differences(existing, loaded, options)
    if differences:
        more = len(differences) - MOST_LISTED
        listed = "; ".join(differences[:MOST_LISTED]) + (f"; and {more} more" if more > 0 else "")
        raise InputError(
            f"{out}: the folder holds a dataset of other settings: {listed}. Set them back to continue it, or {ADVICE}"
        )
    had = existing.get("count")
    if isinstance(had, int) and had > count:
        raise InputError(
            f"{out}: the folder holds a dataset of {had} views, {count} are wanted, and views are never removed; set "
            f"Views to {had} or more, or {ADVICE}"
        )


def _check_new(out: Path) -> None:
    if out.is_dir() and not (out / ".work").exists() and any(out.iterdir()):
        raise InputError(
            f"{out}: expected a new or empty folder, or a dataset to continue, found other files; {ADVICE}"
        )


def _differences(existing: Mapping[str, Any], loaded: LoadedCase, options: DatasetOptions) -> list[str]:
    """What a dataset was made with and what is set now, each in a clause."""
    case = loaded.case
    made = {name: _mapping(existing.get(name)) for name in ("options", "frame", "inputs_sha256", "versions")}
    found = []
    files = {name: path for name, path in case.input_files().items() if name != "case"}
    if options.poses is not None:
        files["poses"] = Path(options.poses)
    for name, path in files.items():
        digest = hashlib.sha256(read_content(path, "an input of the dataset")).hexdigest()
        if made["inputs_sha256"].get(name) != digest:
            found.append(f"{_INPUT_WORDS.get(name, name)} ({path.name}) has changed")
    now = asdict(options)
    for name, value in made["options"].items():
        if name in now and now[name] != value:
            found.append(f"{label(name)} was {_shown(value)}, is {_shown(now[name])}")
    views = made["options"].get("views")
    if options.sampler == "trajectory" and isinstance(views, int) and views != options.count:
        found.append(f"a trajectory of {views} views cannot grow, {label('count')} is {options.count}")
    frame = {
        **asdict(case.camera),
        "distortion": None if case.distortion is None else asdict(case.distortion),
        # as the run computes it from the file, to the last bit
        "cam_from_model": (case.cam_from_mesh @ loaded.mesh_from_model).tolist(),
    }
    changed = [name for name, value in made["frame"].items() if name in frame and frame[name] != value]
    found += sorted({_FRAME_WORDS.get(name, "K of the camera") + " has changed" for name in changed})
    versions = {"oneframe": __version__, "blender": bpy.app.version_string}
    for name, title in (("oneframe", "OneFrame"), ("blender", "Blender")):
        if made["versions"].get(name, versions[name]) != versions[name]:
            found.append(f"it was made with {title} {made['versions'][name]}, this is {versions[name]}")
    return found


def _mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _shown(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
