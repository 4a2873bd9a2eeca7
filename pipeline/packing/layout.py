"""The names in a pack: those of BOP's image-wise layout, and of this program's own files beside them.

Source: thodan/bop_toolkit, bop_toolkit_lib/dataset/bop_imagewise.py and bop_webdataset.py.
"""

import re
from collections.abc import Collection
from pathlib import PurePosixPath

from ..dataset.layout import MODEL_FILES, RECORD, TARGETS, ViewPaths
from ..files.content import partial_name

FORMAT = "oneframe pack 1"
"""Name and version of the layout, in ``pack.json``."""

MANIFEST = "pack.json"
KEY_TO_SHARD = "key_to_shard.json"
INFO = "dataset_info.md"
WORK = ".work"
COPIED = (RECORD, "camera.json", *MODEL_FILES)
"""Files of the dataset that a pack holds as they are."""
TABLES = (*COPIED, TARGETS, INFO, KEY_TO_SHARD)
"""The files of a pack beside its shards that the manifest has sums of."""

DESKTOP_FILES = ("Thumbs.db", "desktop.ini")

MASKS = ("mask", "mask_visib", "mask_observed")
FILES = {"source_frame": "source_frame.png", "depth": "depth.png", "depth_mm": "depth_mm.npy"}
"""Kinds of a view's files that a pack holds as they are, if the dataset has them, and the members' names."""
VIEWS_PER_SHARD = 1000
"""As in BOP's own packs."""


def shard_name(number: int) -> str:
    """Name of a shard."""
    return f"shard-{number:06d}.tar"


def is_shard(name: str) -> bool:
    """Whether a shard has such a name."""
    return re.fullmatch(r"shard-[0-9]{6,}\.tar", name) is not None


def is_note(name: str) -> bool:
    """Whether a file beside the shards is one that people add and no reader takes for data, as beside a dataset.

    Such as LICENSE, README.md, notes.txt, .gitattributes.
    """
    path = PurePosixPath(name)
    hidden = name.startswith(".") and name != WORK and partial_name(name) is None
    return len(path.parts) == 1 and (hidden or path.suffix.lower() in ("", ".md", ".txt") or name in DESKTOP_FILES)


def view_key(paths: ViewPaths) -> str:
    """The key of a view: the part of its members' names before the first dot."""
    return f"{paths.scene_id:06d}_{paths.image_id:06d}"


def member_suffixes(kinds: Collection[str], *, jpeg: bool) -> tuple[str, ...]:
    """The members of a view with files of these kinds, each by the part of its name after the key and a dot."""
    masks = tuple(f"{kind}.json" for kind in MASKS)
    files = (name for kind, name in FILES.items() if kind in kinds)
    return ("camera.json", "gt.json", "gt_info.json", *masks, *files, "rgb.jpg" if jpeg else "rgb.png")
