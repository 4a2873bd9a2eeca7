"""A queue: a folder of cases of one surface, with a frame each, and how far the work on each of them is.

``QUEUE/NAME/case.toml`` is an ordinary case. It names the files of the case that it was made like, and copies none. The
state of a case is what its file says; nothing else keeps a record.
"""

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..images.image_check import check_image_file, image_size
from .case_file import Case, read_case
from .case_folder import CASE, keep_files, kept_case
from .case_writer import write_case
from .pose_record import INITIAL_GUESS, OTHER_FRAME, UNKNOWN, PoseRecord

NEW, ROUGH, ALIGNED, CHECKED, DOUBTFUL, REFUSED = "new", "rough", "aligned", "checked", "doubtful", "refused"
"""No pose yet, or a first guess; a pose by pins, by hand or of unknown origin; from landmarks, the image or other
frames; looked at by a person; with a doubt that nobody has checked; refused by a person."""


@dataclass(frozen=True)
class NewFrame:
    """A frame for a queue.

    Attributes
    ----------
    image, video
        Its file; film and number as :attr:`.Case.video` has them.
    cam_from_mesh, alignment
        ``(4, 4)`` a pose that was found for it, mm, or ``None``; and the record of that.
    """

    image: Path
    video: tuple[str, int] | None = None
    cam_from_mesh: np.ndarray | None = None
    alignment: PoseRecord = UNKNOWN


def queued_cases(folder: Path) -> tuple[Path, ...]:
    """The case files of a queue, by name; those in hidden folders are none of it."""
    return tuple(path for path in sorted(folder.glob(f"*/{CASE}")) if not path.parent.name.startswith("."))


def state_of(case: Case) -> str:
    """How far the work on a case is."""
    record = case.alignment
    if case.refused:
        return REFUSED
    if not case.posed or record.method == INITIAL_GUESS:
        return NEW
    if record.checked:
        return CHECKED
    if (record.doubt and record.method != OTHER_FRAME) or record.refused:
        return DOUBTFUL
    return ALIGNED if record.is_from_image or record.method == "landmarks" else ROUGH


def add_frames(folder: Path, like: Case, frames: Sequence[NewFrame]) -> list[Path]:
    """Put frames into a queue, each as a case of its own, at the pose that was found for it.

    Those that have one in it already stay as they are, but for a pose where that has none.

    Parameters
    ----------
    folder
        The queue, created if it does not exist.
    like
        Its surface, structures and dataset options are those of the new cases, and its K, scaled to their images.
    frames
        A case is called after its image.

    Returns
    -------
    The case files of these frames, old and new.
    """
    cases = cases_of_frames(folder, like, frames)
    fresh = [case for case in cases if not case.path.exists()]
    keep_files([kept_case(case) for case in fresh], {"frame": like.image, "surface": like.mesh})
    for case in cases:
        if case.posed and state_of(present := read_case(case.path, posed=False)) == NEW:
            posed = replace(present, cam_from_mesh=case.cam_from_mesh, posed=True, alignment=case.alignment)
            write_case(case.path, posed)
    return [case.path for case in cases]


def cases_of_frames(folder: Path, like: Case, frames: Sequence[NewFrame]) -> list[Case]:
    """The cases that :func:`add_frames` writes, as far as they do not exist; frames of one image have one."""
    by_image = {os.path.realpath(frame.image): frame for frame in frames}
    cases = [_case_of(frame, folder, like) for frame in by_image.values()]
    paths = {case.path for case in cases} | ({like.path} if like.path.parent.parent == folder else set())
    name, times = Counter(path.parent.name.casefold() for path in paths).most_common(1)[0] if paths else ("", 0)
    if times > 1:
        raise InputError(f"{folder}: expected frames with names of their own, found two called {name}")
    return cases


def _case_of(frame: NewFrame, folder: Path, like: Case) -> Case:
    image, path = frame.image, folder / case_name(frame.image) / CASE
    present = like if path == like.path else read_case(path, posed=False) if path.exists() else None
    if present is not None and os.path.realpath(present.image) != os.path.realpath(image):
        raise InputError(f"{path}: expected the case of {image.name}, found one of another frame")
    camera = like.camera.for_images(image_size(check_image_file(image, str(image))), str(image))
    pose = frame.cam_from_mesh
    return replace(
        like, path=path, image=image, camera=camera, video=frame.video, frames=(), landmarks=(),
        refused="", posed=pose is not None, cam_from_mesh=like.cam_from_mesh if pose is None else pose,
        alignment=frame.alignment,
    )  # fmt: skip


def case_name(image: Path) -> str:
    """The name of the case of a frame in a queue, its folder's."""
    if image.name.startswith("."):
        raise InputError(f"{image}: expected a name that does not begin with a dot, for a case; rename the image")
    return image.stem
