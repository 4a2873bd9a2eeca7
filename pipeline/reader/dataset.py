"""A dataset as a sequence of views."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import overload

from ..dataset.checksums import damaged_file
from ..dataset.dataset_file import Description, read_description
from ..dataset.layout import MANIFEST, RECORD, advice_without_record, scene_count, scene_views
from ..dataset.run.survey import unrecorded_views, view_ranges
from ..errors import InputError
from ..packing.layout import shard_name
from ..packing.manifest import complete_manifest
from ..packing.whole_dataset import AGAIN
from .files import FolderFiles, PackFiles, ViewFiles
from .view import View


class Dataset(Sequence[View]):
    """Views by their place, in the order of the pack; for the folder of a dataset, in that of their numbers.

    Slices are datasets, too. It can be pickled, and used by threads and forked processes: no file stays open.
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

    def __repr__(self) -> str:
        return f"<{len(self)} views of {self.name}>"

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
    """
    folder = Path(path)
    if (folder / MANIFEST).is_file():
        return _open_pack(folder)
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
    manifest = complete_manifest(folder)
    plan, description = manifest.plan, read_description(folder / RECORD)
    if plan.identity != description.identity:
        raise InputError(
            f"{folder}: expected {MANIFEST} and {RECORD} of one dataset, found those of two; copy or pack it again"
        )
    places: list[range] = []
    for number, views in enumerate(plan.shards()):
        name = shard_name(number)
        known = manifest.files.get(name)
        problem = f"{MANIFEST} does not list {name}" if known is None else damaged_file(folder, name, known)
        if problem:
            raise InputError(f"{folder}: expected whole shards, but {problem}; copy or pack it again")
        first = places[-1].stop if places else 0
        places.append(range(first, first + len(views)))
    return Dataset(PackFiles(folder, description, _files_in, plan), description, plan.views, places)
