"""One shard: an order that says all about it, and the function that writes it, the same bytes wherever it runs."""

import hashlib
import io
import json
import tarfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np

from ..camera.pinhole import PinholeCamera
from ..dataset.checksums import FileSum, sum_of
from ..dataset.decoding import Shape, decoded
from ..dataset.layout import ViewPaths, largest_view_file
from ..dataset.run.resume_record import ViewRecord, read_record
from ..dataset.tables.bop import scene_entries
from ..dataset.truths import COLOUR, MASK, TRUTHS
from ..errors import InputError, RunError
from ..files.content import read_file, written_file
from ..files.outputs import writing
from .layout import FILES, MASKS, mask_json, shard_name, view_key

SAFE = "the shards packed so far are safe: correct this and run the same command again"
"""What a file that cannot be written leaves."""


@dataclass(frozen=True)
class ShardOrder:
    """Everything that the bytes of a shard depend on, and where it goes.

    Attributes
    ----------
    root, folder
        The dataset's folder, and that of the pack.
    number
        Of the shard.
    views
        The views in it, in their order.
    identity
        Of the dataset: the records of the views must have it.
    camera
        Of the views.
    jpeg_quality
        Of RGB as JPEG, 1..100; ``None`` keeps the PNG files.
    """

    root: Path
    folder: Path
    number: int
    views: tuple[int, ...]
    identity: str
    camera: PinholeCamera
    jpeg_quality: int | None = None


def pack_shard(order: ShardOrder, on_view: Callable[[], None] = lambda: None) -> FileSum:
    """Write one shard, whole or not at all; gives size and hash of the file.

    The same order makes the same bytes on any machine; with JPEG, those with the same version of OpenCV.

    ``on_view`` is called after each view.

    Raises
    ------
    RunError
        A view is missing, damaged or of another dataset, or the shard cannot be written.
    """
    path = order.folder / shard_name(order.number)
    with writing(path, SAFE), written_file(path) as stream:
        return write_shard(order, stream, on_view)


def write_shard(order: ShardOrder, stream: BinaryIO, on_view: Callable[[], None]) -> FileSum:
    """Write the bytes of a shard: see :func:`pack_shard`."""
    hashed = _Hashed(stream)
    with tarfile.TarFile(fileobj=hashed, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for index in order.views:
            paths = ViewPaths(order.root, index)
            try:
                members = view_members(order, paths)
            except InputError as error:
                raise RunError(str(error)) from None
            for suffix, data in members:
                # without owner and time: the bytes depend on the members alone
                entry = tarfile.TarInfo(f"{view_key(paths)}.{suffix}")
                entry.size = len(data)
                archive.addfile(entry, io.BytesIO(data))
            on_view()
    return FileSum(hashed.sha256(), hashed.tell())


def view_members(order: ShardOrder, paths: ViewPaths) -> list[tuple[str, bytes]]:
    """The members of one view: name after its key, and content.

    Raises
    ------
    InputError, RunError
        The view is missing, damaged or of another dataset.
    """
    record = read_record(paths, with_mask=False)
    if record.identity != order.identity:
        raise RunError(
            f"{paths.file('frame')}: expected a view of this dataset, found one of another run; put the right view in "
            "its place, or remove the file and render it again"
        )
    camera, truth, info = scene_entries(record, order.camera.k.ravel().tolist())
    members = [("camera.json", _json(camera)), ("gt.json", _json(truth)), ("gt_info.json", _json(info))]
    most = largest_view_file(*order.camera.size_wh)
    shape = order.camera.shape_hw
    members += [(f"{kind}.json", data) for kind, data in _masks(paths, record, most, shape)]
    for kind, name in FILES.items():
        if paths.relative(kind) in record.files:
            members.append((name, checked_file(paths, record, kind, most)))
    rgb = checked_file(paths, record, "rgb", most)
    if order.jpeg_quality is None:
        return [*members, ("rgb.png", rgb)]
    bgr = np.ascontiguousarray(decoded(rgb, COLOUR, shape, str(paths.file("rgb")))[..., ::-1])
    jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, order.jpeg_quality])[1]
    return [*members, ("rgb.jpg", jpeg.tobytes())]


def checked_file(paths: ViewPaths, record: ViewRecord, kind: str, most: int) -> bytes:
    """The content of a view's file, of at most so many bytes, which is what its record says.

    Raises
    ------
    RunError
        It is missing or another one.
    """
    name, path = paths.relative(kind), paths.file(kind)
    again = f"remove {paths.file('frame')} and render the view again (oneframe render)"
    known = record.files.get(name)
    if known is None:
        raise RunError(f"{path}: expected it in the record of view {paths.index}, which lists no such file; {again}")
    try:
        data = read_file(path, most)
    except OSError as error:
        raise RunError(
            f"{path}: expected a file of view {paths.index}, cannot read it ({error.strerror}); {again}"
        ) from None
    if sum_of(data) != known:
        raise RunError(
            f"{path}: expected the file that the record of view {paths.index} describes, found a changed one; {again}"
        )
    return data


def _masks(paths: ViewPaths, record: ViewRecord, most: int, shape: Shape) -> Iterator[tuple[str, bytes]]:
    """Kind and run lengths of each mask, as BOP's ``save_masks`` has them: by the number of the object in the image."""
    known: dict[bytes, bytes] = {}
    for kind in (kind for kind in MASKS if not TRUTHS[kind].option or paths.relative(kind) in record.files):
        data = checked_file(paths, record, kind, most)
        if data not in known:
            known[data] = mask_json(decoded(data, MASK, shape, str(paths.file(kind))) != 0)
        yield kind, known[data]


def _json(content: object) -> bytes:
    return json.dumps(content).encode()


class _Hashed(io.BufferedIOBase):
    """A stream that is only written to, and its hash."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream, self._digest, self._size = stream, hashlib.sha256(), 0

    def write(self, data: Any, /) -> int:
        self._digest.update(data)
        self._size += len(data)
        return self._stream.write(data)

    def tell(self) -> int:
        return self._size

    def sha256(self) -> str:
        return self._digest.hexdigest()
