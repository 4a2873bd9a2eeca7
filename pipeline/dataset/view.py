"""One view of a dataset: the rendered arrays, and their encoding as the view's files and record."""

import time
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..files.writing import create_folder, make_durable, partial_path, remove_durably, rename_durably, write_undurably
from ..poses.constraints import PlannedPose
from ..projection.rendered_view import RenderedView
from ..projection.silhouette import SilhouetteEdges, silhouette_statistics
from .checksums import FileSum, sum_of
from .layout import ViewPaths
from .run.resume_record import GroundTruthInfo, ViewRecord
from .tables.bop import bounding_box, run_lengths
from .truths import DEPTH_LEVELS, TRUTHS, Shot, depth_scale_for

SETTLED_SECONDS = 1.0
"""Views are finished so long after the first of them: to wait for the disk takes as long for one as for many."""


@dataclass(frozen=True)
class RenderedSample:
    """A rendered view and how its pose was found."""

    planned: PlannedPose
    rendered: RenderedView


def encode_view(
    paths: ViewPaths,
    sample: RenderedSample,
    edges: SilhouetteEdges,
    camera: PinholeCamera,
    *,
    identity: str,
    depth_scale: float,
    kinds: Collection[str],
) -> tuple[dict[str, bytes], ViewRecord]:
    """Encode one view as the bytes of its files, by kind, and its record.

    Parameters
    ----------
    paths
        The view's files in the dataset.
    sample
        The view and its pose.
    edges
        Edges of the surface, for the part of the silhouette outside the image.
    camera
        Intrinsics of the view.
    identity
        Identity of the dataset.
    depth_scale
        Millimetres per unit of the depth image; a view whose surface is too far away for it gets its own scale.
    kinds
        Names of the arrays that are written: see :func:`.written_truths`.
    """
    view, planned = sample.rendered, sample.planned
    farthest = float(view.seen_mm.max())
    if farthest > depth_scale * DEPTH_LEVELS:
        depth_scale = depth_scale_for(farthest)
    shot = Shot(view, planned.cam_from_model, edges.mesh, camera, depth_scale)
    arrays = {kind: TRUTHS[kind].array(shot) for kind in kinds}
    files = {kind: TRUTHS[kind].form.encoded(array) for kind, array in arrays.items()}
    silhouette = silhouette_statistics(edges, camera, planned.cam_from_model)
    inside, visible = int(np.count_nonzero(view.mask)), int(np.count_nonzero(view.visible))
    # ray casting and scan conversion may disagree on a pixel whose centre lies on an edge: inside, the image counts
    whole = silhouette.px_count_all - silhouette.px_count_inside + inside
    record = ViewRecord(
        index=paths.index,
        identity=identity,
        cam_from_model=planned.cam_from_model,
        depth_scale=depth_scale,
        gt_info=GroundTruthInfo(
            bbox_obj=silhouette.bbox_obj if inside else (-1, -1, -1, -1),
            bbox_visib=bounding_box(view.visible),
            px_count_all=whole,
            px_count_valid=inside,
            px_count_visib=visible,
            visib_fract=visible / whole if whole else 0.0,
        ),
        px_count_observed=int(np.count_nonzero(view.observed)),
        attempts=planned.attempts,
        rejections=planned.rejections,
        files=file_sums(paths, files),
        rle_counts=run_lengths(view.visible),
    )
    return files, record


def file_sums(paths: ViewPaths, files: dict[str, bytes]) -> dict[str, FileSum]:
    """Size and hash of a view's files, by their paths relative to the dataset."""
    return {paths.relative(kind): sum_of(data) for kind, data in files.items()}


class ViewWriter:
    """Writes views: their files at once, and about once a second, when these are on the disk, names their records.

    A view with a record is finished, also after a loss of power. One thread at a time uses it. As a context manager it
    finishes what was written, also of a run that is stopped or has no space left.
    """

    def __init__(self, finished: Callable[[int], None]) -> None:
        """Begin without views; ``finished`` is called with the number of each one that is finished."""
        self._finished = finished
        self._files: list[Path] = []
        self._records: dict[Path, Path] = {}
        self._numbers: list[int] = []
        self._due = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        with suppress(*([] if error is None else [OSError])):
            self.settle()

    def write(self, paths: ViewPaths, files: Mapping[str, bytes], record: ViewRecord) -> None:
        """Write a view's files, by kind, and its record under another name."""
        # the record of a damaged view would vouch for files that are not on the disk yet
        remove_durably(paths.file("frame"))
        nameless = partial_path(paths.file("frame"))
        contents = {paths.file(kind): data for kind, data in files.items()} | {nameless: record.to_bytes()}
        for path, data in contents.items():
            _write(path, data)
        if not self._numbers:
            self._due = time.monotonic() + SETTLED_SECONDS
        self._files += contents
        self._records[nameless] = paths.file("frame")
        self._numbers.append(record.index)
        if time.monotonic() >= self._due:
            self.settle()

    def settle(self) -> None:
        """Finish all views that were written."""
        make_durable(self._files)
        rename_durably(self._records)
        for index in self._numbers:
            self._finished(index)
        for written in (self._files, self._records, self._numbers):
            written.clear()


def _write(path: Path, data: bytes) -> None:
    try:
        write_undurably(path, data)
    except FileNotFoundError:
        create_folder(path.parent)
        write_undurably(path, data)
