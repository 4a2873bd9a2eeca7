"""One shard: a tar file of views, the same bytes whoever writes it."""

import io
import json
import tarfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from ..dataset.checksums import sum_of
from ..dataset.dataset_file import Description
from ..dataset.decoding import decoded
from ..dataset.layout import ViewPaths, largest_view_file
from ..dataset.run.resume_record import ViewRecord, read_record
from ..dataset.tables.bop import scene_entries
from ..dataset.truths import COLOUR, MASK, TRUTHS
from ..errors import InputError, RunError
from ..files.content import read_file, written_file
from ..files.outputs import writing
from .layout import FILES, MASKS, mask_json, view_key
from .whole_dataset import WholeDataset

SAFE = "the shards packed so far are safe: correct this and run the same command again"
"""What a file that cannot be written leaves."""


def write_shard(
    dataset: WholeDataset, views: Sequence[int], jpeg_quality: int | None, path: Path, on_view: Callable[[], None]
) -> None:
    """Write some views of a dataset into a tar file, whole or not at all.

    The bytes depend on the views alone; with a quality of JPEG, on the version of OpenCV, too.
    """
    with (
        writing(path, SAFE),
        written_file(path) as stream,
        tarfile.TarFile(fileobj=stream, mode="w", format=tarfile.USTAR_FORMAT) as archive,
    ):
        for index in views:
            paths = ViewPaths(dataset.root, index)
            try:
                members = list(_members(dataset.description, paths, jpeg_quality))
            except InputError as error:
                raise RunError(str(error)) from None
            for suffix, data in members:
                # without owner and time
                entry = tarfile.TarInfo(f"{view_key(paths)}.{suffix}")
                entry.size = len(data)
                archive.addfile(entry, io.BytesIO(data))
            on_view()


def _members(description: Description, paths: ViewPaths, jpeg_quality: int | None) -> Iterator[tuple[str, bytes]]:
    """The members of one view: name after its key, and content."""
    record, camera = read_record(paths), description.camera
    if record.identity != description.identity:
        raise RunError(
            f"{paths.file('frame')}: expected a view of this dataset, found one of another run; put the right view in "
            "its place, or remove the file and render it again"
        )
    names, most = ("camera", "gt", "gt_info"), largest_view_file(*camera.size_wh)
    for name, entry in zip(names, scene_entries(record, camera.k.ravel().tolist()), strict=True):
        yield f"{name}.json", json.dumps(entry).encode()
    masks: dict[bytes, bytes] = {}
    for kind in MASKS:
        if not TRUTHS[kind].option or paths.relative(kind) in record.files:
            data = _checked_file(paths, record, kind, most)
            if data not in masks:
                masks[data] = mask_json(decoded(data, MASK, camera.shape_hw, str(paths.file(kind))) != 0)
            yield f"{kind}.json", masks[data]
    for kind, name in FILES.items():
        if paths.relative(kind) in record.files:
            yield name, _checked_file(paths, record, kind, most)
    rgb = _checked_file(paths, record, "rgb", most)
    if jpeg_quality is None:
        yield "rgb.png", rgb
        return
    bgr = np.ascontiguousarray(decoded(rgb, COLOUR, camera.shape_hw, str(paths.file("rgb")))[..., ::-1])
    yield "rgb.jpg", cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])[1].tobytes()


def _checked_file(paths: ViewPaths, record: ViewRecord, kind: str, most: int) -> bytes:
    """The content of a view's file, of at most so many bytes, which is what its record says."""
    path, known = paths.file(kind), record.files.get(paths.relative(kind))
    again = f"remove {paths.file('frame')} and render the view again (oneframe render)"
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
