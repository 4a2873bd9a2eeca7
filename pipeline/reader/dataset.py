"""A dataset as a sequence of views."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self, overload

from ..dataset.dataset_file import Description, read_description
from ..dataset.layout import MANIFEST, RECORD, advice_without_record, scene_count, scene_views
from ..dataset.run.survey import unrecorded_views, view_ranges
from ..errors import InputError
from ..packing.layout import WORK, is_shard, shard_name
from ..packing.manifest import read_manifest
from ..packing.whole_dataset import AGAIN
from .folder_files import FolderFiles
from .pack_files import PackFiles
from .view import View, ViewFiles


class Dataset(Sequence[View]):
    """Views by their place, in the order of the pack; for the folder of a dataset, in that of their numbers.

    Slices are datasets, too. It can be pickled, and used by threads and forked processes; each opens its own files.
    """

    def __init__(
        self, files: ViewFiles, description: Description, views: Sequence[int], shards: Sequence[range]
    ) -> None:
        """See :func:`~oneframe.reader.dataset.open_dataset`."""
        self._files, self._description, self._views, self._shards = files, description, views, tuple(shards)

    def __len__(self) -> int:
        return len(self._views)

    @overload
    def __getitem__(self, place: int) -> View: ...

    @overload
    def __getitem__(self, place: slice) -> "Dataset": ...

    def __getitem__(self, place: int | slice) -> "View | Dataset":
        if isinstance(place, slice):
            views = self._views[place]
            return Dataset(self._files, self._description, views, (range(len(views)),))
        return View(self._views[place], self._files)

    def __iter__(self) -> Iterator[View]:
        return (View(index, self._files) for index in self._views)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<{len(self)} views of {self.name}>"

    def close(self) -> None:
        """Close all files; a pack gives no more views then, and neither do its slices."""
        self._files.close()

    @property
    def name(self) -> str:
        """Name of the object."""
        return self._description.name

    @property
    def size_wh(self) -> tuple[int, int]:
        """Width and height of the views, px."""
        return self._description.camera.size_wh

    @property
    def views(self) -> Sequence[int]:
        """The number of each view in the dataset that was rendered."""
        return self._views

    @property
    def shards(self) -> tuple[range, ...]:
        """Places that lie together on disk, in their order: to stream, read one range after the other."""
        return self._shards


def open_dataset(path: str | Path) -> Dataset:
    """Open the folder of a dataset or of a pack; images are not read before they are asked for.

    Parameters
    ----------
    path
        What ``--out`` of ``oneframe render`` or ``oneframe pack`` named.

    Raises
    ------
    InputError
        Neither, unfinished, damaged, or of another format. The message says what is missing.
    """
    folder = Path(path)
    if (folder / MANIFEST).is_file():
        return _open_pack(folder)
    if any(is_shard(name) for name in _names(folder)) or (folder / WORK / "plan.json").is_file():
        raise InputError(
            f"{folder}: expected a complete pack, found no {MANIFEST} in it, which is written last; run the command "
            "that packs it again"
        )
    if not (folder / RECORD).is_file():
        raise InputError(
            f"{folder}: expected the folder of a dataset or a pack, found neither {RECORD} nor {MANIFEST} in it; "
            f"{advice_without_record(folder)}, or that of oneframe pack"
        )
    description = read_description(folder / RECORD)
    missing = unrecorded_views(folder, description.count)
    if missing:
        raise InputError(
            f"{folder}: expected {description.count} views, views {view_ranges(missing)} are missing; {AGAIN}"
        )
    views = range(description.count)
    scenes = [scene_views(number, description.count) for number in range(scene_count(description.count))]
    return Dataset(FolderFiles(folder, description, _files_in), description, views, scenes)


def _files_in(folder: Path) -> ViewFiles:
    return open_dataset(folder)._files


def _open_pack(folder: Path) -> Dataset:
    manifest, description = read_manifest(folder), read_description(folder / RECORD)
    if manifest.plan.identity != description.identity:
        raise InputError(
            f"{folder}: expected {MANIFEST} and {RECORD} of one dataset, found those of two; copy or pack it again"
        )
    places: list[range] = []
    for number, (known, views) in enumerate(zip(manifest.shards, manifest.plan.shards(), strict=True)):
        name = shard_name(number)
        try:
            size = (folder / name).stat().st_size
        except OSError:
            raise InputError(f"{folder}: expected the shard {name}, found none; copy or pack it again") from None
        if size != known.bytes:
            raise InputError(
                f"{folder / name}: expected {known.bytes} bytes, found {size}: the shard is cut off or another "
                "one; copy or pack it again"
            )
        first = places[-1].stop if places else 0
        places.append(range(first, first + len(views)))
    return Dataset(PackFiles(folder, description, _files_in, manifest.plan), description, manifest.plan.views, places)


def _names(folder: Path) -> list[str]:
    try:
        return os.listdir(folder)
    except OSError:
        return []
