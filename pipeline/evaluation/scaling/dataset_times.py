"""Time and memory of what a run does with all finished views at once: a resume scan, the tables, the quick check.

Each is measured in a process of its own, so that its peak of memory is its own.
"""

import io
import math
import multiprocessing
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...dataset.check.check_dataset import check_dataset
from ...dataset.checksums import write_checksums
from ...dataset.identity import identity_of
from ...dataset.layout import RECORD, SCENE_TABLES, scene_count, scene_folder
from ...dataset.survey import survey_views
from ...dataset.view_tables import write_view_tables
from ...errors import RunError
from .finished_views import CAMERA, DEPTH_SCALE, KINDS, OBJECT_NAME, finished_description

BOUNDS = np.array([[-30.0, -30.0, -5.0], [30.0, 30.0, 5.0]])


@dataclass(frozen=True)
class Effort:
    """What a measured step took.

    Attributes
    ----------
    seconds, processor_seconds
        Time on the clock, and of the processor: the latter depends less on what else the machine does.
    peak_mb
        Peak of the process's memory, MiB.
    start_mb
        Its memory before the step, MiB.
    """

    seconds: float
    processor_seconds: float
    peak_mb: float
    start_mb: float


def measured(step: Callable[[Path, int], None], root: Path, count: int) -> Effort:
    """Run a step on the dataset of ``count`` views in ``root``, in a process of its own.

    Raises
    ------
    RunError
        The dataset is not what :func:`.write_finished_views` writes.
    """
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_measured, step, root, count).result()


def scan(root: Path, count: int) -> None:
    """Find the finished views, as a run does that resumes."""
    found = survey_views(root, range(count), finished_description(count), KINDS)
    if len(found.finished) != count:
        raise RunError(f"{root}: expected {count} finished views, found {len(found.finished)}")


def write_tables(root: Path, count: int) -> None:
    """Write all tables that hold a row a view, and ``checksums.json``."""
    identity = identity_of(finished_description(count))
    write_view_tables(
        root, count, identity, CAMERA, np.eye(4), object_name=OBJECT_NAME, bounds=BOUNDS, depth_scale=DEPTH_SCALE
    )
    scenes = map(scene_folder, range(scene_count(count)))
    names = [RECORD, "poses.csv", "transforms.json", "test_targets_bop19.json"]
    write_checksums(root, identity, names + [f"{scene}/{name}" for scene in scenes for name in SCENE_TABLES])


def check_quickly(root: Path, count: int) -> None:
    """Check the dataset as ``oneframe check --fast`` does, but no pixels, which these views do not have.

    The files that belong to no view, such as the model, are missing and reported; what is measured is the rest.
    """
    report = check_dataset(root, views=1, hashes=False, stream=io.StringIO())
    if report.count != count:
        raise RunError(f"{root}: expected a dataset of {count} views, found {report.count}")


def _measured(step: Callable[[Path, int], None], root: Path, count: int) -> Effort:
    before = peak_mb()
    start, processor = time.perf_counter(), time.process_time()
    step(root, count)
    return Effort(time.perf_counter() - start, time.process_time() - processor, peak_mb(), before)


def peak_mb(process: int | None = None) -> float:
    """Peak of the memory of a process, of this one by default, MiB; NaN where the system does not say (not Linux)."""
    with suppress(OSError, StopIteration):
        lines = Path(f"/proc/{process or 'self'}/status").read_text().splitlines()
        return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))
    return math.nan
