"""All tables that hold a row a view, in one reading of the records: those of the scenes, of the poses, of the targets.

The records of one scene are in memory at a time, whatever the number of views.
"""

from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...errors import RunError
from ..dataset_file import Description
from ..layout import ViewPaths, scene_count, scene_views
from ..run.resume_record import ViewRecord, read_record
from ..run.survey import Tally
from .bop import is_test_target, write_scene, write_test_targets
from .pose_tables import write_poses


def write_view_tables(
    root: Path, description: Description, *, bounds: np.ndarray, depth_scale: float, out: Path | None = None
) -> Tally:
    """Write the tables of a dataset whose views are all finished; gives sums over all views.

    Parameters
    ----------
    bounds
        ``(2, 3)`` corners of the surface's box in the model frame, mm.
    depth_scale
        Millimetres per unit of the depth images, as in ``camera.json``.
    out
        The folder of the tables, if it is not that of the dataset.
    """
    count, camera, out = description.count, description.camera, out or root
    tally, targets = Tally(), array("L")

    def records() -> Iterator[ViewRecord]:
        for scene in range(scene_count(count)):
            in_scene = scene_records(root, scene, count, description.identity)
            write_scene(out, in_scene, camera, description.name)
            for record in in_scene:
                tally.add(record)
                if is_test_target(record):
                    targets.append(record.index)
                yield record

    write_poses(out, records(), camera, description.mesh_from_model, bounds=bounds, depth_scale=depth_scale)
    write_test_targets(out, targets)
    return tally


def scene_records(root: Path, scene: int, count: int, identity: str) -> list[ViewRecord]:
    """The records of all views of a scene of a dataset of ``count`` views."""
    records = []
    for index in scene_views(scene, count):
        paths = ViewPaths(root, index)
        record = read_record(paths)
        if record.identity != identity:
            raise RunError(
                f"{paths.file('frame')}: expected a view of this run, found one of another; "
                "do not change the folder during a run, and run the same command again"
            )
        records.append(record)
    return records
