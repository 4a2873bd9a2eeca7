"""A dataset's frames on disk, in the BOP layout: where each file lies, and how one view becomes its files.

A view is finished when its record ``frame/NNNNNN.json`` is there, which is written last and holds the hashes of the
others; all tables of the dataset (:mod:`pipeline.dataset_tables`) are made from these records alone.
"""

import hashlib
import io
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .atomic_file import write_bytes_atomically
from .errors import InputError
from .image_file import encode_png

FORMAT = "oneframe dataset 1"
"""Name and version of the layout, in ``dataset.json``."""

SPLIT = "train_pbr"
FRAMES_PER_SCENE = 1000
OBJECT_ID = 1
DEPTH_LEVELS = 65535


@dataclass(frozen=True)
class FramePaths:
    """The files of view ``index`` of a dataset in ``root``; one object (ground truth 0) a view."""

    root: Path
    index: int

    @property
    def scene_id(self) -> int:
        """BOP scene: :data:`FRAMES_PER_SCENE` views each."""
        return self.index // FRAMES_PER_SCENE

    @property
    def image_id(self) -> int:
        """Number of the view within its scene."""
        return self.index % FRAMES_PER_SCENE

    @property
    def scene(self) -> Path:
        """Folder of the scene."""
        return self.root / SPLIT / f"{self.scene_id:06d}"

    def file(self, kind: str) -> Path:
        """Path of one of the view's files, by its kind (a key of :func:`view_files`, or ``"frame"``)."""
        gt = "_000000" if kind in ("mask", "mask_visib", "mask_observed") else ""
        suffix = {"frame": ".json", "depth_mm": ".npy"}.get(kind, ".png")
        return self.scene / kind / f"{self.image_id:06d}{gt}{suffix}"

    def relative(self, kind: str) -> str:
        """The same, relative to the dataset's folder, with forward slashes."""
        return self.file(kind).relative_to(self.root).as_posix()


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


def write_view(paths: FramePaths, files: dict[str, bytes], record: dict) -> None:
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


def read_record(paths: FramePaths) -> dict:
    """The record of a finished view."""
    return json.loads(paths.file("frame").read_bytes())


def finished_frames(root: Path, frames: range) -> set[int]:
    """Which of these views have a record (an empty one, as a loss of power leaves it, is none)."""
    return {index for index in frames if _has_content(FramePaths(root, index).file("frame"))}


def _has_content(path: Path) -> bool:
    try:
        return path.stat().st_size > 0
    except FileNotFoundError:
        return False
