"""``dataset.json`` read again: what packing, reading and checking a dataset need of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..errors import InputError
from ..files.content import LARGEST_TEXT, read_content
from ..files.tables import parsed_json
from ..transforms import checked_matrix
from .identity import COUNT, DEPTH_SCALE, POSES_HASH, described, differences, identity_of
from .layout import FORMAT, MOST_VIEWS, RECORD
from .stereo import camera_from_planned, further_eyes
from .truths import written_truths


@dataclass(frozen=True)
class Description:
    """What ``dataset.json`` says.

    Attributes
    ----------
    content
        All of it.
    identity
        Of the dataset: see :func:`~oneframe.dataset.identity.identity_of`.
    count
        Number of views.
    name
        Name of the object.
    camera
        Intrinsics of the views.
    mesh_from_model
        4x4, mm.
    frames
        Number of frames that colour the surface.
    """

    content: Mapping[str, Any]
    identity: str
    count: int
    name: str
    camera: PinholeCamera
    mesh_from_model: np.ndarray
    frames: int = 1

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of a view's files, without its record."""
        return written_truths(self.content["options"], self.frames)

    @cached_property
    def camera_from_planned(self) -> np.ndarray | None:
        """As of :func:`.camera_from_planned`."""
        return camera_from_planned(self.content["options"])

    @cached_property
    def further(self) -> tuple[str, ...]:
        """The folders of datasets that belong into that of this one: of the same views by other cameras."""
        return further_eyes(self.content["options"])

    def read_further(self, root: Path, folder: str) -> "Description":
        """Read the description of one of the :attr:`further` datasets, which must be of the views of this one."""
        there = read_description(root / folder / RECORD)
        expected = {**self.content, "options": {**self.content["options"], "eye": folder}}
        apart = described([each for each in differences(there.content, expected) if each.key != DEPTH_SCALE])
        if there.count != self.count:
            apart.append(f"{there.count} {folder} eyes of {self.count} views")
        if apart:
            raise InputError(f"{root / folder}: expected the {folder} eyes of these views: {'; '.join(apart)}")
        return there

    @property
    def poses_hash(self) -> str | None:
        """SHA-256 of the poses if they were listed; ``None`` if they were drawn."""
        return self.content.get(POSES_HASH)


def read_description(path: Path) -> Description:
    """Read a ``dataset.json``."""
    content = parsed_json(read_content(path, "the description of a dataset", str(path), most=LARGEST_TEXT), str(path))
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = repr(content.get("format") if isinstance(content, dict) else content)[:60]
        raise InputError(
            f"{path}: expected the format {FORMAT!r}, found {found}; use the version of OneFrame that made it"
        )
    count, name, camera, options = (content.get(key) for key in (COUNT, "object", "camera", "options"))
    if not isinstance(count, int) or isinstance(count, bool) or not 0 < count <= MOST_VIEWS:
        raise InputError(f"{path}: expected {COUNT} to be a number of views, found {count!r}; copy the dataset again")
    if not (isinstance(name, str) and isinstance(camera, dict) and isinstance(options, dict)):
        raise InputError(f"{path}: expected object, camera and options, one is missing; copy the dataset again")
    try:
        size = (camera["width"], camera["height"])
        intrinsics = PinholeCamera.from_matrix(camera["K"], size=size, where=f"{path}: camera")
    except KeyError as missing:
        raise InputError(f"{path}: camera: expected a key {missing}, it is missing; copy the dataset again") from None
    mesh_from_model = checked_matrix(content.get("mesh_from_model"), 4, f"{path}: mesh_from_model")
    further = content.get("frames", [])
    if not isinstance(further, list):
        raise InputError(f"{path}: expected a list of frames, found another value; copy the dataset again")
    return Description(content, identity_of(content), count, name, intrinsics, mesh_from_model, 1 + len(further))
