"""The split of a dataset on disk: its poses and its surface's box, read from its tables."""

from typing import Any

import numpy as np

from ..dataset.checksums import damaged_file
from ..dataset.layout import VIEWS_PER_SCENE, scene_count, scene_folder
from ..errors import InputError
from ..files.content import LARGEST_FILE, read_content
from ..files.tables import parsed_json
from ..transforms import rigid
from .source import Source
from .split import Split, split_of_views


def split_of_dataset(source: Source, *, gap_px: float | None = None) -> Split:
    """Divide a dataset's views into train, val and test.

    Parameters
    ----------
    source
        The dataset.
    gap_px
        As for :func:`.split_of_views`.

    Raises
    ------
    InputError
        A table was changed or cannot be read, or the views cannot be divided.
    """
    count = source.description.count
    poses = np.empty((count, 4, 4))
    for scene in range(scene_count(count)):
        for image, truths in _table(source, f"{scene_folder(scene)}/scene_gt.json").items():
            (truth,) = truths
            poses[scene * VIEWS_PER_SCENE + int(image)] = rigid(
                np.reshape(truth["cam_R_m2c"], (3, 3)), np.array(truth["cam_t_m2c"], float)
            )
    (model,) = _table(source, "models/models_info.json").values()
    low = np.array([model[f"min_{axis}"] for axis in "xyz"])
    size = np.array([model[f"size_{axis}"] for axis in "xyz"])
    corners = low + size * np.stack(np.meshgrid(*[(0, 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return split_of_views(poses, corners, source.description.camera, gap_px=gap_px)


def _table(source: Source, name: str) -> dict[str, Any]:
    path = source.root / name
    known = source.sums.files.get(name)
    problem = f"{name} is not among them" if known is None else damaged_file(source.root, name, known, hashes=True)
    if problem is not None:
        raise InputError(
            f"{source.root}: expected the tables that a run has written, but {problem}; remove the file and run the "
            "render command again"
        )
    return dict(parsed_json(read_content(path, "a table of the dataset", most=LARGEST_FILE), str(path)))
