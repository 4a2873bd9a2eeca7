"""Views in the shards of a pack, at any place, without extracting anything."""

import os
import tarfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..dataset.dataset_file import Description
from ..dataset.layout import ViewPaths, largest_view_file
from ..errors import InputError
from ..files.content import regular_file
from ..files.tables import parsed_json
from ..packing.layout import FILES, MASKS, mask_columns, shard_name, view_key
from ..packing.manifest import Plan
from ..transforms import rigid
from .view import Boxes, Numbers, ViewFiles

MOST_OPEN = 8
"""Shards whose files are open at a time."""


class PackFiles(ViewFiles):
    """The members of a pack's shards. It can be pickled, and used by several threads and after a fork."""

    def __init__(self, folder: Path, description: Description, opened: Callable[[Path], ViewFiles], plan: Plan) -> None:
        """Open nothing yet: a shard's headers are read when its first view is. ``opened`` is that of right eyes."""
        self.root, self.description, self.opened = folder, description, opened
        self._shape, self._most = description.camera.shape_hw, largest_view_file(*description.camera.size_wh)
        rgb = "rgb.png" if plan.jpeg_quality is None else "rgb.jpg"
        self._suffixes = {"rgb": rgb, **FILES}
        self._shard_of = {view: number for number, views in enumerate(plan.shards()) for view in views}
        self._closed = False
        self._open: dict[int, _Shard] = {}
        self._places: dict[int, dict[str, tuple[int, int]]] = {}

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_open": {}}

    def numbers(self, index: int) -> Numbers:
        """The numbers of a view."""
        (camera, where), (truths, _), (infos, _) = (
            self._table(index, suffix) for suffix in ("camera.json", "gt.json", "gt_info.json")
        )
        try:
            (truth,), (info,) = truths, infos
            return Numbers(
                k=np.reshape(np.array(camera["cam_K"], float), (3, 3)),
                cam_from_model=rigid(np.reshape(truth["cam_R_m2c"], (3, 3)), np.array(truth["cam_t_m2c"], float)),
                depth_scale=float(camera["depth_scale"]),
                boxes=Boxes(_box(info["bbox_obj"]), _box(info["bbox_visib"])),
                visib_fract=float(info["visib_fract"]),
            )
        except (KeyError, TypeError, ValueError):
            raise InputError(
                f"{where}: expected BOP's keys of a view with one object, found others; check the pack (oneframe pack "
                "--verify)"
            ) from None

    def array(self, index: int, kind: str) -> np.ndarray:
        """As of :class:`.ViewFiles`; a pack holds masks as run lengths."""
        if kind not in MASKS:
            return super().array(index, kind)
        data, where = self.read(index, kind)
        # OpenCV transposes in blocks
        return cv2.transpose(mask_columns(data, self._shape, where))

    def close(self) -> None:
        """Give back all handles of files."""
        self._closed = True
        self._open = {}
        if "right" in self.__dict__:
            self.right.close()

    def _table(self, index: int, suffix: str) -> tuple[Any, str]:
        data, where = self._member(index, suffix)
        return parsed_json(data, where), where

    def read(self, index: int, kind: str) -> tuple[bytes, str]:
        """The content of a file of a view, and its name in messages."""
        return self._member(index, self._suffixes.get(kind, f"{kind}.json"))

    def _member(self, index: int, suffix: str) -> tuple[bytes, str]:
        number = self._shard_of.get(index)
        if number is None:
            raise InputError(f"{self.root}: expected view {index} in it, found none; pack both eyes by one command")
        path = self.root / shard_name(number)
        name = f"{view_key(ViewPaths(self.root, index))}.{suffix}"
        try:
            shard = self._shard(number, path)
            places = self._places.get(number)
            if places is None:
                # two threads may both read the headers: they find the same
                places = self._places[number] = _member_places(path)
            if name not in places:
                raise InputError(
                    f"{path}: expected the member {name}, found none; check the pack (oneframe pack --verify)"
                )
            offset, size = places[name]
            # a size that a header claims, before memory is taken for it
            data = shard.read_at(offset, size) if offset + size <= shard.size and size <= self._most else b""
        except OSError as error:
            raise InputError(
                f"{path}: expected a shard of the pack, cannot read it ({error.strerror}); copy or pack it again"
            ) from None
        if len(data) < size:
            raise InputError(f"{path}: expected a whole shard, found one that is cut off; copy or pack it again")
        return data, f"{path}: {name}"

    def _shard(self, number: int, path: Path) -> "_Shard":
        if self._closed:
            raise InputError(f"{self.root}: the dataset has been closed; open it again")
        shard = self._open.get(number)
        if shard is None:
            shard = _Shard(path)
            while len(self._open) >= MOST_OPEN:
                # a thread that still reads it keeps it open until it has
                self._open.pop(next(iter(list(self._open)), -1), None)
            self._open[number] = shard
        return shard


def _member_places(path: Path) -> dict[str, tuple[int, int]]:
    """Offset and size of every member's content, by name, from the headers alone; InputError for no archive."""
    try:
        with tarfile.open(path, "r:") as archive:
            return {entry.name: (entry.offset_data, entry.size) for entry in archive if entry.isreg()}
    except tarfile.TarError as error:
        raise InputError(
            f"{path}: expected a whole shard, found a damaged one ({error}); copy or pack it again"
        ) from None


class _Shard:
    """An open file that is closed when nobody refers to it any more."""

    def __init__(self, path: Path) -> None:
        self._descriptor = -1
        flags = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
        self._descriptor = regular_file(str(path), flags)
        self._lock = threading.Lock()
        self.size = os.fstat(self._descriptor).st_size

    def __del__(self) -> None:
        if self._descriptor >= 0:
            os.close(self._descriptor)

    def read_at(self, offset: int, size: int) -> bytes:
        """Bytes at a place; it has no state, so threads and forked processes do not disturb each other."""
        if hasattr(os, "pread"):
            return os.pread(self._descriptor, size, offset)
        with self._lock:  # Windows
            os.lseek(self._descriptor, offset, os.SEEK_SET)
            return os.read(self._descriptor, size)


def _box(values: Any) -> tuple[int, int, int, int]:
    x, y, width, height = values
    return int(x), int(y), int(width), int(height)
