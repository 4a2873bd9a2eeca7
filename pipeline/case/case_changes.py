"""In what two cases differ, and what a case file would lose by being replaced."""

import os
from dataclasses import fields
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..transforms import is_same_pose
from .case_file import Case, read_case

RELATIVE, ABSOLUTE = 1e-6, 2e-5
"""Differences of options, and of landmarks in mm and px, that Blender's single precision does not tell apart."""


def differing_fields(one: Case, other: Case) -> tuple[str, ...]:
    """Names of the fields in which two cases differ, other than ``path`` and ``messages``, but for rounding.

    Files are compared by what they name. The order of structures does not count, since nothing depends on it.
    """
    meanings = [_meaning(case) for case in (one, other)]
    differing = [name for name in meanings[0] if not _is_equal(meanings[0][name], meanings[1][name])]
    is_moved = one.posed != other.posed or not is_same_pose(one.cam_from_mesh, other.cam_from_mesh)
    return (*(["cam_from_mesh"] if is_moved else []), *differing)


def other_inputs(path: Path, case: Case) -> tuple[str, ...]:
    """Frame and surface of the case that a file holds, in words, as far as they are not those of ``case``.

    There are none if the file does not exist or is empty.
    """
    if not path.exists() or not path.stat().st_size:
        return ()
    try:
        saved = read_case(path, posed=False)
    except InputError as error:
        raise InputError(f"{error}. Save the case under another name; this file is kept") from None
    changed = differing_fields(saved, case)
    files = {"image": f"another frame ({saved.image.name})", "mesh": f"another surface ({saved.mesh.name})"}
    return tuple(words for name, words in files.items() if name in changed)


def check_replaced(path: Path, case: Case) -> None:
    """Check that a file which a case is to be written to holds no case of something else."""
    if other := other_inputs(path, case):
        raise InputError(
            f"{path}: expected no file or a case of this frame and surface, found one of {' and '.join(other)}; "
            f"choose another name, or replace it with --overwrite"
        )


def _meaning(case: Case) -> dict[str, Any]:
    """What the fields say but for the pose, wherever the case lies and whatever comes first."""
    meaning = {field.name: getattr(case, field.name) for field in fields(Case)}
    for name in ("path", "messages", "cam_from_mesh", "posed"):
        del meaning[name]
    meaning |= {name: os.path.realpath(meaning[name]) for name in ("image", "mesh")}
    meaning["landmarks"] = [(each.name, each.point, each.pixel, each.enabled) for each in case.landmarks]
    meaning["frames"] = [
        (os.path.realpath(each.image), each.camera, each.distortion, each.cam_from_mesh.ravel().tolist())
        for each in case.frames
    ]
    meaning["structures"] = {each.name: (os.path.realpath(each.mesh), each.colour) for each in case.structures}
    poses = case.dataset.get("poses")
    if isinstance(poses, str):
        meaning["dataset"] = {**case.dataset, "poses": os.path.realpath(case.path.parent / poses)}
    return meaning


def _is_equal(one: Any, other: Any) -> bool:
    """Whether two values are equal, numbers in tables and lists but for rounding."""
    if isinstance(one, float) and isinstance(other, int | float):
        return one == other or abs(one - other) <= ABSOLUTE + RELATIVE * abs(other)
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_is_equal(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(_is_equal, one, other))
    return bool(one == other)
