"""View."""

import hashlib
import io
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files.content import write_bytes_atomically
from ..images.png import encode_png
from .layout import ViewPaths


@dataclass(frozen=True)
class RenderedView:
    """One rendered view.

    Attributes
    ----------
    rgb
        ``(H, W, 3)`` float32 code values 0..1; black where there is no surface.
    depth_mm
        ``(H, W)`` float32 distance along the optical axis of the surface at the pixel's centre; 0 for none.
    observed
        ``(H, W)`` bool: the source frame saw the surface at the pixel's centre.
    beside_unseen
        ``(H, W)`` bool: observed, but about a frame pixel away from where the frame's view of the surface breaks off;
        only told by scenes for anti-aliasing.
    """

    rgb: np.ndarray
    depth_mm: np.ndarray
    observed: np.ndarray
    beside_unseen: np.ndarray

    @property
    def mask(self) -> np.ndarray:
        """``(H, W)`` bool: there is surface at the pixel's centre."""
        return self.depth_mm > 0


DEPTH_LEVELS = 65535


def depth_scale_for(farthest_mm: float) -> float:
    """Millimetres per unit of the 16-bit depth images: the finest of 1, 2, 5 times a power of ten that holds all.

    Raises
    ------
    InputError
        The distance is not positive and finite.
    """
    if not (np.isfinite(farthest_mm) and farthest_mm > 0):
        raise InputError(f"depth: expected a positive distance, found {farthest_mm!r} mm")
    exponent = np.floor(np.log10(farthest_mm / DEPTH_LEVELS))
    # written as decimal text, so that 0.01 is stored as 0.01
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
    rgb: np.ndarray, depth_mm: np.ndarray, observed: np.ndarray, *, depth_scale: float, float_depth: bool
) -> dict[str, bytes]:
    """One view as the bytes of its files, by kind.

    Parameters
    ----------
    rgb
        ``(H, W, 3)`` float32 code values 0..1.
    depth_mm
        ``(H, W)`` float32, 0 for background.
    observed
        ``(H, W)`` bool: surface that the source frame saw.
    """
    # rounded by adding a half and cutting: values are not negative
    codes = (np.clip(rgb, 0, 1) * np.float32(255) + np.float32(0.5)).astype(np.uint8)
    mask = encode_png(np.where(depth_mm > 0, np.uint8(255), np.uint8(0)))
    files = {
        "rgb": encode_png(codes),
        "depth": encode_png(quantised_depth(depth_mm, depth_scale)),
        "mask": mask,
        # nothing stands before the surface: all of it that is in the image is visible
        "mask_visib": mask,
        "mask_observed": encode_png(np.where(observed, np.uint8(255), np.uint8(0))),
    }
    if float_depth:
        stream = io.BytesIO()
        np.save(stream, np.ascontiguousarray(depth_mm, np.float32), allow_pickle=False)
        files["depth_mm"] = stream.getvalue()
    return files


def write_view(paths: ViewPaths, files: dict[str, bytes], record: dict) -> None:
    """Write a view's files, then its record with their hashes."""
    for kind, data in files.items():
        _write(paths.file(kind), data)
    hashes = {paths.relative(kind): hashlib.sha256(data).hexdigest() for kind, data in files.items()}
    text = json.dumps({"index": paths.index, **record, "sha256": hashes}, separators=(",", ":")) + "\n"
    _write(paths.file("frame"), text.encode())


def _write(path: Path, data: bytes) -> None:
    try:
        write_bytes_atomically(path, data)
    except FileNotFoundError:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes_atomically(path, data)


def read_record(paths: ViewPaths) -> dict:
    """The record of a finished view."""
    return json.loads(paths.file("frame").read_bytes())


def mask_statistics(mask: np.ndarray) -> dict[str, object]:
    """The part of ``scene_gt_info`` that a ``(H, W)`` bool mask tells, and the mask's run lengths for COCO.

    Boxes are (x, y, width, height) with width = x_max - x_min, as in BOP; [-1, -1, -1, -1] for an empty mask.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    box = [-1, -1, -1, -1]
    if len(rows):
        box = [columns[0], rows[0], columns[-1] - columns[0], rows[-1] - rows[0]]
    # COCO: column by column, starting with the number of zeros
    flat = np.concatenate([[False], mask.T.ravel(), [False]])
    edges = np.flatnonzero(flat[1:] != flat[:-1])
    counts = np.diff(np.concatenate([[0], edges, [mask.size]]))
    if len(counts) > 1 and counts[-1] == 0:
        counts = counts[:-1]
    visible = int(np.count_nonzero(mask))
    return {
        "bbox_visib": [int(value) for value in box],
        "px_count_visib": visible,
        "rle_counts": counts.tolist(),
    }
