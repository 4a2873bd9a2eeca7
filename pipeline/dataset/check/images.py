"""The images of one view: do they decode, agree with each other and the record, and show the surface at its pose?

OpenCV decodes the images and computes the boxes (:mod:`oneframe.dataset.check.png`, ``cv2.boundingRect``): a reader
independent of :mod:`oneframe.images.png`, which writes them. Needs cv2.
"""

import cv2
import numpy as np

from ...errors import InputError
from ...files.numbers import npy_array
from ...projection.silhouette import SilhouetteEdges, silhouette_statistics
from ..layout import ViewPaths
from .depth import PIXELS_OF_ROUNDING, DepthAgreement, agreement, surface_depth
from .files import DamagedFile, read_bytes
from .findings import Findings
from .png import PngHeader, read_png
from .records import Description, ViewRecord

IMAGES = "images that disagree"
POSES = "views whose pose does not fit the pixels"


def check_view(
    paths: ViewPaths, record: ViewRecord, description: Description, surface: SilhouetteEdges | None, findings: Findings
) -> DepthAgreement | None:
    """Check one view, whose files exist.

    Parameters
    ----------
    paths, record, description
        The view, its record and the dataset's description.
    surface
        The model with its edges; ``None`` if it cannot be read: poses are not checked then.
    findings
        Receives what is wrong.

    Returns
    -------
    Agreement of depth image and surface; ``None`` if something is wrong or poses are not checked.
    """
    try:
        images = {kind: _decoded(paths, kind, description) for kind in description.kinds}
        _check_images(images, paths, record)
        _check_record(images, paths, record)
    except DamagedFile as damage:
        findings.add(IMAGES, damage)
        return None
    if surface is None:
        return None
    try:
        found = agreement(
            images["depth"],
            record.depth_scale,
            surface_depth(surface.mesh, description.camera, record.cam_from_model),
            description.camera.fx,
        )
        misfit = found.misfit
        if misfit:
            where = paths.relative("depth")
            raise DamagedFile(f"{where}: the surface projected with scene_gt and cam_K does not fit: {misfit}")
        _check_silhouette(surface, record, description)
    except DamagedFile as damage:
        findings.add(POSES, damage)
        return None
    return found


def _decoded(paths: ViewPaths, kind: str, description: Description) -> np.ndarray:
    where, (height, width) = paths.relative(kind), description.camera.shape_hw
    if kind == "depth_mm":
        return _float_depth(paths, where, (height, width))
    expected = PngHeader(width, height, channels=3 if kind == "rgb" else 1, bits=16 if kind == "depth" else 8)
    image = read_png(paths.root, where, expected)
    if kind.startswith("mask") and not ((image == 0) | (image == 255)).all():
        raise DamagedFile(f"{where}: expected a mask of 0 and 255, found other values")
    return image


def _float_depth(paths: ViewPaths, where: str, shape: tuple[int, int]) -> np.ndarray:
    header_bytes = 4096
    try:
        depth = npy_array(read_bytes(paths.root, where, 4 * shape[0] * shape[1] + header_bytes), where)
    except InputError as error:
        raise DamagedFile(str(error)) from None
    if depth.shape != shape or depth.dtype != np.float32:
        raise DamagedFile(f"{where}: expected {shape} of float32, found {depth.shape} of {depth.dtype}")
    return depth


def _check_images(images: dict[str, np.ndarray], paths: ViewPaths, record: ViewRecord) -> None:
    """Check the images against each other."""
    mask, depth = images["mask"] > 0, images["depth"]
    _require_none(mask != (depth > 0), paths, "mask", "differ from where the depth image has surface")
    for kind in ("mask_visib", "mask_observed"):
        _require_none((images[kind] > 0) & ~mask, paths, kind, "lie outside the mask")
    coloured = images["rgb"].any(axis=2)
    _require_none(coloured & ~mask, paths, "rgb", "outside the mask are not black")
    if "depth_mm" in images:
        exact = images["depth_mm"].astype(np.float64)
        # depths below half a unit are stored as 1, not 0
        rounding = np.where(depth == 1, 1.0, 0.5) * record.depth_scale + 1e-6 * exact
        wrong = ((exact > 0) != mask) | ~(np.abs(exact - depth * record.depth_scale) <= rounding)
        _require_none(wrong, paths, "depth_mm", "are not those of the depth image before rounding")


def _require_none(wrong: np.ndarray, paths: ViewPaths, kind: str, clause: str) -> None:
    if wrong.any():
        v, u = np.argwhere(wrong)[0]
        raise DamagedFile(f"{paths.relative(kind)}: {int(wrong.sum())} px {clause} (first: u = {u}, v = {v})")


def _check_record(images: dict[str, np.ndarray], paths: ViewPaths, record: ViewRecord) -> None:
    """Check the images against the numbers in the record."""
    visible, info = images["mask_visib"] > 0, record.gt_info
    counts = {
        "px_count_visib": int(visible.sum()),
        "px_count_valid": int((images["depth"] > 0).sum()),
        "bbox_visib": _box(images["mask_visib"]),
    }
    for name, found in counts.items():
        if info[name] != found:
            raise DamagedFile(f"{record.where}: {name} is {info[name]}, {paths.relative('mask_visib')} has {found}")
    observed = int((images["mask_observed"] > 0).sum())
    if record.observed != observed:
        where = paths.relative("mask_observed")
        raise DamagedFile(f"{record.where}: px_count_observed is {record.observed}, {where} has {observed}")
    whole = info["px_count_all"]
    fraction = info["px_count_visib"] / whole if whole else 0.0
    if abs(info["visib_fract"] - fraction) > 1e-12:
        raise DamagedFile(f"{record.where}: visib_fract is {info['visib_fract']}, the counts give {fraction}")
    runs = record.run_lengths
    if (runs < 0).any() or runs.sum() != visible.size:
        raise DamagedFile(f"{record.where}: expected rle_counts of {visible.size} px, found {int(runs.sum())}")
    decoded = np.repeat(np.arange(len(runs)) % 2 == 1, runs).reshape(visible.shape[::-1]).T
    _require_none(decoded != visible, paths, "mask_visib", f"differ from rle_counts of {record.where}")


def _box(mask: np.ndarray) -> list[int]:
    x, y, width, height = cv2.boundingRect(mask)
    return [x, y, width - 1, height - 1] if width else [-1, -1, -1, -1]


def _check_silhouette(surface: SilhouetteEdges, record: ViewRecord, description: Description) -> None:
    """Check the numbers about the silhouette outside the image, which no image shows."""
    info, silhouette = record.gt_info, silhouette_statistics(surface, description.camera, record.cam_from_model)
    visible = info["px_count_visib"]
    whole = silhouette.px_count_all - silhouette.px_count_inside + visible
    if abs(info["px_count_all"] - whole) > PIXELS_OF_ROUNDING + 1e-3 * whole:
        raise DamagedFile(f"{record.where}: px_count_all is {info['px_count_all']}, the surface covers {whole} px")
    box = list(silhouette.bbox_obj) if visible else [-1, -1, -1, -1]
    if np.abs(np.subtract(info["bbox_obj"], box)).max() > 1:
        raise DamagedFile(f"{record.where}: bbox_obj is {info['bbox_obj']}, that of the projected surface is {box}")
