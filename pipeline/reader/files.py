"""Where views come from: the folder of a dataset, or the shards of a pack, of which nothing is extracted."""

import tarfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..dataset.dataset_file import Description
from ..dataset.decoding import decoded
from ..dataset.layout import MODEL_FILES, ViewPaths, largest_view_file
from ..dataset.model_file import read_model
from ..dataset.run.resume_record import Box, read_record
from ..dataset.truths import TRUTHS
from ..errors import InputError, RunError
from ..files.content import read_file, regular_file
from ..files.tables import parsed_json
from ..packing.layout import FILES, MASKS, mask_columns, shard_name, view_key
from ..packing.manifest import Plan
from ..surface.mesh import TriangleMesh
from ..transforms import rigid


@dataclass(frozen=True)
class Boxes:
    """Boxes of the surface: (x, y, x_max - x, y_max - y) in px, as in BOP; (-1, -1, -1, -1) if it is not visible.

    Attributes
    ----------
    bbox_obj
        Of the whole silhouette, including what is outside the image.
    bbox_visib
        Of the part in the image.
    """

    bbox_obj: Box
    bbox_visib: Box


@dataclass(frozen=True)
class Numbers:
    """The numbers of a view.

    Attributes
    ----------
    k
        ``(3, 3)`` px_from_cam.
    cam_from_model
        ``(4, 4)`` rigid, mm.
    depth_scale
        Millimetres per unit of the 16-bit depth image.
    boxes
        As in BOP's ``scene_gt_info.json``.
    visib_fract
        Visible fraction of the silhouette, 0..1.
    """

    k: np.ndarray
    cam_from_model: np.ndarray
    depth_scale: float
    boxes: Boxes
    visib_fract: float


class ViewFiles:
    """Where views come from. No file stays open, so it can be pickled, and used by threads and forked processes."""

    def __init__(self, root: Path, description: Description, opened: Callable[[Path], "ViewFiles"]) -> None:
        """Read nothing yet; ``opened`` opens another folder, that of the right eyes."""
        self.root, self.description, self._opened = root, description, opened

    @cached_property
    def right(self) -> "ViewFiles":
        """Those of the right eyes, opened when they are first asked for."""
        if not self.description.further:
            raise InputError(f"{self.root}: expected right eyes in it, found none; render the views with both eyes")
        (folder,) = self.description.further
        self.description.read_further(self.root, folder)
        return self._opened(self.root / folder)

    @cached_property
    def mesh(self) -> TriangleMesh:
        """The surface, model frame, read when it is first asked for."""
        return read_model(self.root, MODEL_FILES[0])

    def read(self, index: int, kind: str) -> tuple[bytes, str]:
        """The content of a file of a view, by the name of its array; its name for messages."""
        raise NotImplementedError

    def numbers(self, index: int) -> Numbers:
        """The numbers of a view."""
        raise NotImplementedError

    def array(self, index: int, kind: str) -> np.ndarray:
        """An array of a view, as its file holds it: see :data:`~oneframe.dataset.truths.TRUTHS`."""
        if kind not in self.description.kinds:
            raise InputError(
                f"view {index}: expected an array of the dataset, {', '.join(self.description.kinds)}; found {kind}"
            )
        return self._decoded(*self.read(index, kind), kind)

    def _decoded(self, data: bytes, where: str, kind: str) -> np.ndarray:
        return decoded(data, TRUTHS[kind].form, self.description.camera.shape_hw, where)


class FolderFiles(ViewFiles):
    """The files of a dataset's views."""

    def numbers(self, index: int) -> Numbers:
        """The numbers of a view, from its record."""
        try:
            record = read_record(ViewPaths(self.root, index))
        except RunError as error:
            raise InputError(str(error)) from None
        info, camera = record.gt_info, self.description.camera
        boxes = Boxes(info.bbox_obj, info.bbox_visib)
        return Numbers(camera.k, record.cam_from_model, record.depth_scale, boxes, info.visib_fract)

    def read(self, index: int, kind: str) -> tuple[bytes, str]:
        """The content of a file of a view, and its path."""
        path = ViewPaths(self.root, index).file(kind)
        try:
            return read_file(path, largest_view_file(*self.description.camera.size_wh)), str(path)
        except OSError as error:
            raise InputError(
                f"{path}: expected a file of view {index}, cannot read it ({error.strerror}); check the dataset "
                "(oneframe check)"
            ) from None


class PackFiles(ViewFiles):
    """The members of a pack's shards."""

    def __init__(self, root: Path, description: Description, opened: Callable[[Path], ViewFiles], plan: Plan) -> None:
        """Read nothing yet: a shard's headers are read when its first view is."""
        super().__init__(root, description, opened)
        rgb = "rgb.png" if plan.jpeg_quality is None else "rgb.jpg"
        self._suffixes = {"rgb": rgb, **FILES, **{kind: f"{kind}.json" for kind in MASKS}}
        self._shard_of = {view: number for number, views in enumerate(plan.shards()) for view in views}
        self._places: dict[int, dict[str, tuple[int, int]]] = {}

    def numbers(self, index: int) -> Numbers:
        """The numbers of a view, from its tables."""
        members = [self._member(index, f"{name}.json") for name in ("camera", "gt", "gt_info")]
        where = members[0][1]
        tables: list[Any] = [parsed_json(*member) for member in members]
        try:
            camera, (truth,), (info,) = tables
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

    def read(self, index: int, kind: str) -> tuple[bytes, str]:
        """The content of a file of a view, and its name in messages."""
        return self._member(index, self._suffixes[kind])

    def _decoded(self, data: bytes, where: str, kind: str) -> np.ndarray:
        if kind not in MASKS:
            return super()._decoded(data, where, kind)
        # OpenCV transposes in blocks
        return cv2.transpose(mask_columns(data, self.description.camera.shape_hw, where))

    def _member(self, index: int, suffix: str) -> tuple[bytes, str]:
        number = self._shard_of.get(index)
        if number is None:
            raise InputError(f"{self.root}: expected view {index} in it, found none; pack both eyes by one command")
        path, name = self.root / shard_name(number), f"{view_key(ViewPaths(self.root, index))}.{suffix}"
        try:
            if number not in self._places:
                # two threads may both read the headers: they find the same
                self._places[number] = _member_places(path)
            offset, size = self._places[number][name]
            with open(path, "rb", opener=regular_file) as shard:
                shard.seek(offset)
                # no more than a view may have, whatever a header claims
                data = shard.read(min(size, largest_view_file(*self.description.camera.size_wh)))
        except KeyError:
            raise InputError(
                f"{path}: expected the member {name}, found none; check the pack (oneframe pack --verify)"
            ) from None
        except OSError as error:
            raise InputError(
                f"{path}: expected a shard of the pack, cannot read it ({error.strerror}); copy or pack it again"
            ) from None
        if len(data) < size:
            raise InputError(f"{path}: expected a whole shard, found one that is cut off; copy or pack it again")
        return data, f"{path}: {name}"


def _member_places(path: Path) -> dict[str, tuple[int, int]]:
    """Offset and size of every member's content, by name, from the headers alone; InputError for no archive."""
    try:
        with tarfile.open(path, "r:") as archive:
            return {entry.name: (entry.offset_data, entry.size) for entry in archive if entry.isreg()}
    except tarfile.TarError as error:
        raise InputError(
            f"{path}: expected a whole shard, found a damaged one ({error}); copy or pack it again"
        ) from None


def _box(values: Any) -> Box:
    x, y, width, height = values
    return int(x), int(y), int(width), int(height)
