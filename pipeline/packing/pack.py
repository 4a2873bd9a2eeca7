"""A whole pack: what is missing of it is packed, then its tables are written; and whether one is whole."""

import io
import json
import shutil
import tarfile
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import cv2
import numpy as np

from ..dataset.checksums import damaged_file, sum_of, sum_of_file
from ..dataset.dataset_file import Description
from ..dataset.decoding import decoded
from ..dataset.layout import MANIFEST, MODEL_FOLDERS, MOST_VIEWS, ViewPaths, largest_view_file
from ..dataset.run.resume_record import ViewRecord, read_record
from ..dataset.tables.bop import scene_entries, write_test_targets
from ..dataset.truths import COLOUR, MASK, TRUTHS
from ..errors import InputError, RunError
from ..files.content import names_in, read_file
from ..files.machine import available_cores
from ..files.outputs import writing
from ..files.writing import create_folder, remove_abandoned, write_bytes_atomically, written_file
from ..progress import Progress
from .layout import COPIED, FILES, KEY_TO_SHARD, MASKS, TABLES, mask_json, shard_name, view_key
from .manifest import Manifest, Plan, complete_manifest, read_manifest
from .whole_dataset import WholeDataset, open_whole_dataset

SAFE = "the shards packed so far are safe: correct this and run the same command again"
"""What a file that cannot be written leaves."""


@dataclass(frozen=True)
class PackOptions:
    """How a pack holds its views.

    Attributes
    ----------
    views_per_shard
        How many a shard has; the last one may have fewer.
    jpeg_quality
        Compress RGB as JPEG, 1..100.
    about
        A sentence for ``pack.json``, such as which part of a split the views are.
    """

    views_per_shard: int = 1000
    jpeg_quality: int | None = None
    about: str = ""


def pack_dataset(
    root: Path | str,
    out: Path | str,
    options: PackOptions | None = None,
    *,
    views: Sequence[int] | None = None,
    workers: int = 0,
    stream: TextIO | None = None,
) -> Manifest:
    """Pack a dataset, or go on where an earlier run of the same pack was stopped.

    Parameters
    ----------
    root, out
        The folders of the complete dataset and of the pack.
    options
        How; the defaults if left out.
    views
        The views in the order in which they are packed; all of them, as they are numbered, if left out.
    workers
        Number of threads, 0 for one a core: what takes time releases Python's lock.
    stream
        Of the progress.
    """
    root, out, options = Path(root), Path(out), options or PackOptions()
    quality = options.jpeg_quality
    _check_folders(root, out)
    if not 1 <= options.views_per_shard <= MOST_VIEWS:
        raise InputError(f"--views-per-shard: expected 1 to {MOST_VIEWS} views, found {options.views_per_shard}")
    if quality is not None and not 1 <= quality <= 100:
        raise InputError(f"--jpeg: expected a quality from 1 to 100, found {quality}")
    dataset = open_whole_dataset(root)
    plan = Plan(
        identity=dataset.description.identity,
        views_per_shard=options.views_per_shard,
        jpeg_quality=quality,
        opencv=None if quality is None else cv2.__version__,
        views=_checked_views(views, dataset.description.count),
        about=options.about,
    )
    known = _begun(out, plan)
    shards = dict(enumerate(plan.shards()))
    # what stands under its name is whole, unless it was damaged since
    missing = [
        number
        for number in shards
        if not (out / shard_name(number)).is_file()
        or ((own := known.files.get(shard_name(number))) and damaged_file(out, shard_name(number), own))
    ]
    stopped, done = threading.Event(), len(plan.views) - sum(len(shards[number]) for number in missing)
    with (
        Progress(len(plan.views), "views packed", finished=done, stream=stream) as progress,
        ThreadPoolExecutor(workers or available_cores()) as pool,
    ):

        def count() -> None:
            if stopped.is_set():
                raise RunError("stopped")
            progress.advance()

        written = [
            pool.submit(write_shard, dataset, shards[number], quality, out / shard_name(number), count)
            for number in missing
        ]
        try:
            for shard in written:
                shard.result()
        finally:
            # what is begun leaves nothing
            stopped.set()
            pool.shutdown(cancel_futures=True)
    return _finished(dataset, out, plan)


def verify_pack(folder: Path, *, threads: int = 1, stream: TextIO | None = None) -> list[str]:
    """Compare all files of a complete pack with their size and hash, and name shards of others; clauses."""
    files = complete_manifest(folder).files
    with Progress(len(files), "files verified", stream=stream) as progress, ThreadPoolExecutor(threads) as pool:

        def problem(name: str) -> str | None:
            found = damaged_file(folder, name, files[name], hashes=True)
            progress.advance()
            return found

        wrong = [each for each in pool.map(problem, files) if each is not None]
    others = {path.name for path in folder.glob("[!.]*.tar")} - files.keys()
    return [*wrong, *(f"{name} is no shard of this pack: remove it" for name in sorted(others))]


def _check_folders(root: Path, out: Path) -> None:
    whole, packed = root.resolve(), out.resolve()
    if whole == packed or whole in packed.parents or packed in whole.parents:
        raise InputError(
            f"{out}: expected a folder for the pack beside that of the dataset ({root}), found one within the other; "
            "choose another folder (--out)"
        )


def _checked_views(views: Sequence[int] | None, count: int) -> tuple[int, ...]:
    if views is None:
        return tuple(range(count))
    chosen = tuple(int(view) for view in views)
    if not chosen or len(set(chosen)) != len(chosen) or min(chosen) < 0 or max(chosen) >= count:
        raise InputError(f"views to pack: expected different numbers from 0 to {count - 1}, found others or none")
    return chosen


def _begun(out: Path, plan: Plan) -> Manifest:
    """Begin a pack in a new folder, or go on with one of the same plan; what is known of its files."""
    if (out / MANIFEST).is_file():
        known = read_manifest(out)
        changes = [
            f"{name} was {_short(was)}, is {_short(getattr(plan, name))}"
            for name, was in known.plan.__dict__.items()
            if was != getattr(plan, name)
        ]
        if changes:
            raise RunError(
                f"{out}: the folder holds another pack ({'; '.join(changes)}); undo the change to resume it, or choose "
                "another folder (--out)"
            )
    else:
        with writing(out, SAFE):
            create_folder(out)
            remove_abandoned(out)
            if others := names_in(out):
                raise RunError(
                    f"{out}: expected a new or empty folder or a pack to resume, found other files (such as "
                    f"{min(others)}); choose another folder (--out)"
                )
            known = Manifest(plan)
            known.write(out)
    with writing(out, SAFE):
        for name in ("", *MODEL_FOLDERS):
            remove_abandoned(out / name)
    return known


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 60 else f"{text[:60]}…"


def _finished(dataset: WholeDataset, out: Path, plan: Plan) -> Manifest:
    """Write everything but the shards; gives the manifest."""
    keys = {view_key(ViewPaths(out, view)): number for number, views in enumerate(plan.shards()) for view in views}
    names = [*map(shard_name, range(len(plan.shards()))), *TABLES]
    with writing(out, SAFE):
        for name in COPIED:
            create_folder((out / name).parent)
            with (dataset.root / name).open("rb") as content, written_file(out / name) as stream:
                shutil.copyfileobj(content, stream)
        write_bytes_atomically(out / KEY_TO_SHARD, (json.dumps(keys) + "\n").encode())
        write_test_targets(out, sorted(dataset.targets.intersection(plan.views)))
        manifest = Manifest(plan, {name: sum_of_file(out / name) for name in names})
        manifest.write(out)
    return manifest


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
