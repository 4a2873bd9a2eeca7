"""One view of a dataset: the rendered arrays, and their encoding as the view's files and record."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..files.content import create_folder, write_files_atomically
from ..poses.constraints import PlannedPose
from ..projection.rendered_view import RenderedView
from ..projection.silhouette import SilhouetteEdges, silhouette_statistics
from .checksums import FileSum, sum_of
from .layout import ViewPaths
from .run.resume_record import GroundTruthInfo, ViewRecord
from .tables.bop import bounding_box, run_lengths
from .truths import DEPTH_LEVELS, TRUTHS, Shot, depth_scale_for


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


def write_view(paths: ViewPaths, files: dict[str, bytes], record: ViewRecord) -> None:
    """Write a view's files and then its record: a view with a record is finished, also after a loss of power."""
    _write({paths.file(kind): data for kind, data in files.items()})
    _write({paths.file("frame"): record.to_bytes()})


def _write(files: Mapping[Path, bytes]) -> None:
    try:
        write_files_atomically(files)
    except FileNotFoundError:
        for path in files:
            create_folder(path.parent)
        write_files_atomically(files)
