"""A queue: a folder of cases of one surface, with a frame each, and how far the work on each of them is.

``QUEUE/NAME/case.toml`` is an ordinary case. It names the files of the case that it was made like, and copies none. The
state of a case is what its file says; nothing else keeps a record.
"""

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from ..errors import InputError
from ..images.image_check import check_image_file, image_size
from .alignment_record import FOUND, INITIAL_GUESS, OTHER_FRAME
from .case_file import Case, read_case
from .case_folder import CASE, keep_files, kept_case

NEW, ROUGH, ALIGNED, CHECKED, DOUBTFUL = "new", "rough", "aligned", "checked", "doubtful"
"""No pose yet, or a first guess; a pose by pins, by hand or of unknown origin; from landmarks, the image or other
frames; looked at by a person; with a doubt that nobody has checked."""


def queued_cases(folder: Path) -> tuple[Path, ...]:
    """The case files of a queue, by name."""
    return tuple(sorted(folder.glob(f"*/{CASE}")))


def state_of(case: Case) -> str:
    """How far the work on a case is."""
    record = case.alignment
    if not case.posed or record.get("method") == INITIAL_GUESS:
        return NEW
    if "checked" in record:
        return CHECKED
    method = record.get("method")
    if ("doubt" in record and method != OTHER_FRAME) or "refused" in record:
        return DOUBTFUL
    return ALIGNED if method in ("landmarks", *FOUND) else ROUGH


def add_frames(folder: Path, like: Case, frames: Sequence[tuple[Path, tuple[str, int] | None]]) -> list[Path]:
    """Put frames into a queue, each as a case without a pose; those that are already in it stay as they are.

    Parameters
    ----------
    folder
        The queue, created if it does not exist.
    like
        Its K, surface, structures and dataset options are those of the new cases.
    frames
        The images, each with film and number as :attr:`.Case.video` has them. A case is called after its image.

    Returns
    -------
    The case files of these frames, old and new.

    Raises
    ------
    InputError
        Two frames would have one case, a file of that name is in the way, or an image does not have the size of K;
        nothing is written then.
    RunError
        A file cannot be written.
    """
    cases = [
        replace(
            like, path=folder / image.stem / CASE, image=image, video=video, posed=False, frames=(), landmarks=(),
            alignment={},
        )
        for image, video in frames
    ]  # fmt: skip
    paths = [case.path for case in cases]
    if doubled := _first_doubled(path.parent.name.casefold() for path in paths):
        raise InputError(f"{folder}: expected frames with names of their own, found two called {doubled}")
    fresh = []
    for case in cases:
        if (size := image_size(check_image_file(case.image, str(case.image)))) != like.camera.size_wh:
            raise InputError(
                f"{case.image}: expected {like.camera.width}x{like.camera.height} px, the size that K is for, found "
                f"{size[0]}x{size[1]}; put it into another queue, with its own K"
            )
        if not case.path.exists():
            fresh.append(case)
        elif os.path.realpath(read_case(case.path, posed=False).image) != os.path.realpath(case.image):
            raise InputError(f"{case.path}: expected the case of {case.image.name}, found one of another frame")
    keep_files([kept_case(case) for case in fresh], {"frame": like.image, "surface": like.mesh})
    return paths


def _first_doubled(names: Iterable[str]) -> str:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return ""
