"""The tables of a dataset against the same made again from its records: equal but for the last digits of fractions.

Another processor or another numpy may round those of a product of matrices in another way.
"""

import re
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...files.content import read_content
from ...files.temporary import temporary_folder, writing_temporary
from ..dataset_file import Description
from ..layout import MODEL_FILES, OBJECT_ID, SCENE_TABLES, TARGETS, scene_count, scene_folder
from ..tables.bop import write_camera
from ..tables.view_tables import write_view_tables
from .comparison import RELATIVE, read_table
from .findings import Findings

KIND = "tables that disagree"
_FRACTION = re.compile(rb"-?[0-9]+(?:\.[0-9]+(?:e[-+][0-9]+)?|e[-+][0-9]+)")


def check_tables(root: Path, description: Description, finest_scale: float, findings: Findings) -> None:
    """Compare the tables that exist; all records have been read, and ``finest_scale`` is that of their depth images."""
    scenes = map(scene_folder, range(scene_count(description.count)))
    names = [f"{scene}/{table}" for scene in scenes for table in SCENE_TABLES]
    names += ["camera.json", "poses.csv", "transforms.json", TARGETS]
    scale = _depth_scale(root, finest_scale)
    with temporary_folder() as again, findings.collecting(KIND):
        with writing_temporary():
            write_camera(again, description.camera, scale)
            write_view_tables(root, description, bounds=_bounds(root), depth_scale=scale, out=again)
        for name in names:
            if (root / name).is_file():  # else its sum has told
                with findings.collecting(KIND):
                    found = read_content(root / name, "a table of the dataset", name)
                    if not _is_same(found, (again / name).read_bytes()):
                        raise InputError(
                            f"{name}: it is not what the records of the views make of it; remove it and run the same "
                            "`oneframe render` again, which writes it"
                        )


def _depth_scale(root: Path, finest: float) -> float:
    """That of ``camera.json``, which is at most the finest of a view; else this one."""
    try:
        scale = read_table(root, "camera.json")["depth_scale"]
        return float(scale) if 0 < scale <= finest else finest
    except (InputError, KeyError, TypeError):
        return finest


def _bounds(root: Path) -> np.ndarray:
    """The box of the surface before its model was rounded to single precision; InputError if it is not there."""
    name = MODEL_FILES[1]
    try:
        info = read_table(root, name)[str(OBJECT_ID)]
        low, size = (np.array([float(info[f"{what}_{axis}"]) for axis in "xyz"]) for what in ("min", "size"))
    except (KeyError, TypeError, ValueError, OverflowError):
        raise InputError(f"{name}: expected the box of the model, found something else") from None
    return np.stack([low, low + size])


def _is_same(found: bytes, expected: bytes) -> bool:
    if found == expected:
        return True
    if _FRACTION.sub(b"#", found) != _FRACTION.sub(b"#", expected):
        return False
    one, other = (np.array([*map(float, _FRACTION.findall(text))]) for text in (found, expected))
    return bool((np.abs(one - other) <= RELATIVE * np.maximum(np.abs(other), 1.0)).all())
