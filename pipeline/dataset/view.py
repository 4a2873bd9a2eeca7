"""One view of a dataset: the rendered arrays, and their encoding as the view's files and record."""

import io
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..errors import InputError
from ..files.content import create_folder, write_files_atomically
from ..images.png import encode_png
from ..poses.constraints import PlannedPose
from ..projection.rendered_view import RenderedView
from ..projection.silhouette import SilhouetteEdges, silhouette_statistics
from .checksums import FileSum, sum_of
from .layout import ViewPaths
from .run.resume_record import GroundTruthInfo, ViewRecord
from .tables.bop import bounding_box
from .tables.coco import run_lengths


@dataclass(frozen=True)
class RenderedSample:
    """A rendered view and how its pose was found."""

    planned: PlannedPose
    rendered: RenderedView


DEPTH_LEVELS = 65535
"""Largest value of the 16-bit depth images."""


def depth_scale_for(farthest_mm: float) -> float:
    """Millimetres per unit of the 16-bit depth images: the finest of 1, 2, 5 times a power of ten that is enough.

    Raises
    ------
    InputError
        The distance is not positive and finite.
    """
    if not (np.isfinite(farthest_mm) and farthest_mm > 0):
        raise InputError(f"depth: expected a positive distance, found {farthest_mm!r} mm")
    exponent = np.floor(np.log10(farthest_mm / DEPTH_LEVELS))
    # parsed from decimal text, so that 0.01 is exactly the float 0.01
    for digit, power in ((1, 0), (2, 0), (5, 0), (1, 1), (2, 1)):
        scale = float(f"{digit}e{int(exponent) + power}")
        if farthest_mm <= scale * DEPTH_LEVELS:
            return scale
    raise AssertionError("a decade always holds a fitting scale")


def quantised_depth(depth_mm: np.ndarray, depth_scale: float) -> np.ndarray:
    """``(H, W)`` depth in mm -> uint16, 0 for background (and never 0 for surface)."""
    units = np.rint(depth_mm / np.float32(depth_scale))
    return np.where(depth_mm > 0, np.clip(units, 1, DEPTH_LEVELS), 0).astype(np.uint16)


def view_files(
    rgb: np.ndarray, depth_mm: np.ndarray, source: np.ndarray, kinds: Collection[str], *, depth_scale: float
) -> dict[str, bytes]:
    """Encode one view as the bytes of its files, by kind.

    Parameters
    ----------
    rgb
        ``(H, W, 3)`` float32 code values 0..1.
    depth_mm
        ``(H, W)`` float32, 0 for background.
    source
        ``(H, W)`` uint8: the number of the frame that saw the surface, from 1, or 0.
    kinds
        Which files: see :func:`.view_kinds`.
    """
    # adding a half and truncating rounds, as no value is negative
    codes = (np.clip(rgb, 0, 1) * np.float32(255) + np.float32(0.5)).astype(np.uint8)
    mask = encode_png(np.where(depth_mm > 0, np.uint8(255), np.uint8(0)))
    files = {
        "rgb": encode_png(codes),
        "depth": encode_png(quantised_depth(depth_mm, depth_scale)),
        "mask": mask,
        # nothing occludes the surface: all of it in the image is visible
        "mask_visib": mask,
        "mask_observed": encode_png(np.where(source > 0, np.uint8(255), np.uint8(0))),
    }
    if "source_frame" in kinds:
        files["source_frame"] = encode_png(source)
    if "depth_mm" in kinds:
        stream = io.BytesIO()
        np.save(stream, np.ascontiguousarray(depth_mm, np.float32), allow_pickle=False)
        files["depth_mm"] = stream.getvalue()
    return files


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
        Which files: see :func:`.view_kinds`.
    """
    view, planned = sample.rendered, sample.planned
    farthest = float(view.depth_mm.max())
    if farthest > depth_scale * DEPTH_LEVELS:
        depth_scale = depth_scale_for(farthest)
    files = view_files(view.rgb, view.depth_mm, view.source, kinds, depth_scale=depth_scale)
    silhouette = silhouette_statistics(edges, camera, planned.cam_from_model)
    inside = int(np.count_nonzero(view.mask))
    # ray casting and scan conversion may disagree on a pixel whose centre lies on an edge: inside, the image counts
    whole = silhouette.px_count_all - silhouette.px_count_inside + inside
    record = ViewRecord(
        index=paths.index,
        identity=identity,
        cam_from_model=planned.cam_from_model,
        depth_scale=depth_scale,
        gt_info=GroundTruthInfo(
            bbox_obj=silhouette.bbox_obj if inside else (-1, -1, -1, -1),
            bbox_visib=bounding_box(view.mask),
            px_count_all=whole,
            px_count_valid=inside,
            px_count_visib=inside,
            visib_fract=inside / whole if whole else 0.0,
        ),
        px_count_observed=int(np.count_nonzero(view.observed)),
        attempts=planned.attempts,
        rejections=planned.rejections,
        files=file_sums(paths, files),
        rle_counts=run_lengths(view.mask),
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
