"""The images of one view: do they decode, agree with each other and the record, and show the surface at its pose?

OpenCV decodes the images and computes the boxes (``cv2.boundingRect``): a reader independent of
:mod:`oneframe.images.png`, which writes them. Needs cv2.
"""

import cv2
import numpy as np

from ...errors import InputError
from ...files.content import read_content
from ...images.image_check import check_image
from ...projection.silhouette import SilhouetteEdges, silhouette_statistics
from ..dataset_file import Description
from ..decoding import decoded
from ..layout import ViewPaths, largest_view_file
from ..run.resume_record import ViewRecord
from ..truths import MASK, TRUTHS, Stored
from .depth import PIXELS_OF_ROUNDING, DepthAgreement, agreement, surface_depth


def check_images(paths: ViewPaths, record: ViewRecord, description: Description) -> Stored:
    """Check the images of a view, whose files exist, against each other and its record.

    Returns
    -------
    What they hold.
    """
    images = {kind: _decoded(paths, kind, description) for kind in description.kinds}
    stored = Stored(images, record.depth_scale, description.frames, description.camera, record.cam_from_model)
    # the mask first, which the others are held against
    for kind in sorted(images, key=lambda kind: kind != "mask"):
        for wrong, clause in TRUTHS[kind].flaws(stored):
            _require_none(wrong, paths, kind, clause)
    _check_counts(images, paths, record)
    return stored


def check_pose(paths: ViewPaths, record: ViewRecord, stored: Stored, surface: SilhouetteEdges) -> DepthAgreement:
    """Check that the depth image and the numbers of the silhouette are those of the surface at the view's pose."""
    camera, pose = stored.camera, stored.cam_from_model
    occluder, projected = stored.occluder, surface_depth(surface.mesh, camera, pose)
    depth = np.where(occluder, np.uint16(0), stored.arrays["depth"])
    found = agreement(depth, record.depth_scale, projected, hidden=stored.mask & occluder)
    if found.misfit:
        where = paths.relative("depth")
        raise InputError(f"{where}: the surface projected with scene_gt and cam_K does not fit: {found.misfit}")
    in_front = stored.arrays["depth"] * record.depth_scale < projected.z + record.depth_scale
    behind = int(np.count_nonzero(occluder & (projected.z > 0) & ~in_front))
    if behind > PIXELS_OF_ROUNDING + 1e-3 * np.count_nonzero(occluder):
        raise InputError(f"{paths.relative('mask_occluder')}: {behind} px are behind the projected surface")
    # the numbers about what is outside the image, which no image shows
    info, where = record.gt_info, paths.relative("frame")
    silhouette = silhouette_statistics(surface, camera, pose)
    inside = info.px_count_valid
    whole = silhouette.px_count_all - silhouette.px_count_inside + inside
    if abs(info.px_count_all - whole) > PIXELS_OF_ROUNDING + 1e-3 * whole:
        raise InputError(f"{where}: px_count_all is {info.px_count_all}, the surface covers {whole} px")
    box = silhouette.bbox_obj if inside else (-1, -1, -1, -1)
    if np.abs(np.subtract(info.bbox_obj, box)).max() > 1:
        raise InputError(f"{where}: bbox_obj is {info.bbox_obj}, that of the projected surface is {box}")
    return found


def _decoded(paths: ViewPaths, kind: str, description: Description) -> np.ndarray:
    where, shape = paths.relative(kind), description.camera.shape_hw
    most = largest_view_file(*description.camera.size_wh)
    data = read_content(paths.file(kind), "a file of the view", where, most, noted=False)
    form = TRUTHS[kind].form
    if form.ending != ".npy":
        # decoders fill what is cut off with black
        check_image(data, where)
    image = decoded(data, form, shape, where)
    if form is MASK and not ((image == 0) | (image == 255)).all():
        raise InputError(f"{where}: expected a mask of 0 and 255, found other values")
    return image


def _require_none(wrong: np.ndarray, paths: ViewPaths, kind: str, clause: str) -> None:
    if wrong.any():
        v, u = np.argwhere(wrong)[0]
        raise InputError(f"{paths.relative(kind)}: {int(wrong.sum())} px {clause} (first: u = {u}, v = {v})")


def _check_counts(images: dict[str, np.ndarray], paths: ViewPaths, record: ViewRecord) -> None:
    """Check the masks against the numbers in the record."""
    visible, info, where = images["mask_visib"] > 0, record.gt_info, paths.relative("frame")
    counts = {
        "px_count_visib": (info.px_count_visib, int(visible.sum()), "mask_visib"),
        "px_count_valid": (info.px_count_valid, int((images["mask"] > 0).sum()), "mask"),
        "bbox_visib": (info.bbox_visib, _box(images["mask_visib"]), "mask_visib"),
        "px_count_observed": (record.px_count_observed, int((images["mask_observed"] > 0).sum()), "mask_observed"),
    }
    for name, (said, found, kind) in counts.items():
        if said != found:
            raise InputError(f"{where}: {name} is {said}, {paths.relative(kind)} has {found}")
    fraction = info.px_count_visib / info.px_count_all if info.px_count_all else 0.0
    if abs(info.visib_fract - fraction) > 1e-12:
        raise InputError(f"{where}: visib_fract is {info.visib_fract}, the counts give {fraction}")
    runs = np.array(record.rle_counts, np.int64)
    if (runs < 0).any() or (runs > visible.size).any() or runs.sum() != visible.size:
        raise InputError(f"{where}: expected rle_counts of {visible.size} px, found others")
    decoded = np.repeat(np.arange(len(runs)) % 2 == 1, runs).reshape(visible.shape[::-1]).T
    _require_none(decoded != visible, paths, "mask_visib", f"differ from rle_counts of {where}")


def _box(mask: np.ndarray) -> tuple[int, int, int, int]:
    x, y, width, height = cv2.boundingRect(mask)
    return (x, y, width - 1, height - 1) if width else (-1, -1, -1, -1)
