"""The folder of a pack while it is written: one writer, one plan that never changes, shards whole or not at all.

The plan and the sums of finished shards are in ``.work``: see :mod:`oneframe.dataset.run.work_folder`.
"""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ..dataset.layout import MODEL_FOLDERS
from ..dataset.run.survey import to_runs
from ..dataset.run.work_folder import WorkFolder
from ..errors import InputError, RunError
from ..files.content import names_in, partial_name, read_file, write_bytes_atomically
from ..files.tables import parsed_json
from .layout import MANIFEST, TABLES, WORK, is_note, is_shard, shard_name
from .manifest import from_runs, read_manifest, shard_from_json, shard_to_json
from .shard import PackedShard

PLAN = "plan.json"


@dataclass(frozen=True)
class Plan:
    """What a pack holds.

    Attributes
    ----------
    identity
        Of the dataset.
    views_per_shard
        The last shard may have fewer.
    jpeg_quality, opencv
        As in :class:`.Manifest`.
    views
        The views in their order.
    """

    identity: str
    views_per_shard: int
    jpeg_quality: int | None
    opencv: str | None
    views: tuple[int, ...]

    def shard_views(self) -> list[tuple[int, ...]]:
        """The views of each shard."""
        step = self.views_per_shard
        return [self.views[first : first + step] for first in range(0, len(self.views), step)]

    def to_json(self) -> dict[str, object]:
        """The JSON object of the file."""
        return {
            "identity": self.identity,
            "views_per_shard": self.views_per_shard,
            "jpeg_quality": self.jpeg_quality,
            "opencv": self.opencv,
            "views": to_runs(self.views),
        }


class PackFolder(WorkFolder):
    """Exclusive access to the folder of a pack; use as a context manager."""

    def __init__(self, path: Path, plan: Plan) -> None:
        """Create or enter the folder.

        Raises
        ------
        RunError
            The folder cannot be written to, holds something else or another pack, or is in use. Nothing in it has been
            touched then.
        """
        super().__init__(path, doing="packs into", work_files=r"plan\.json|shard-[0-9]{6,}\.tar\.json|\.partial-.*")
        self._plan = plan
        self._enter(self._check, lambda: self._acquire("lock"), self._remove_leftovers, self._begin)

    def finished(self) -> list[PackedShard]:
        """The shards of the plan that are there, by their sums in ``.work`` or in the manifest, and their sizes."""
        found = []
        complete = (self.path / MANIFEST).is_file()
        known = {shard.number: shard for shard in read_manifest(self.path).shards} if complete else {}
        for number, views in enumerate(self._plan.shard_views()):
            shard = kept_shard(self.path, number, views, known.get(number))
            if shard is not None:
                found.append(shard)
        return found

    def keep(self, shard: PackedShard) -> None:
        """Note that a shard has been written."""
        keep_shard(self.path, shard)

    def finish(self) -> None:
        """Remove what only an unfinished pack needs."""
        # killed processes on other machines may have left some
        self._remove_leftovers()
        self._remove_work()

    def _begin(self) -> None:
        """Write the plan, unless the pack is complete; one that grows is complete no longer, and keeps its shards."""
        manifest = self.path / MANIFEST
        if manifest.is_file():
            known = read_manifest(self.path)
            if known.views == self._plan.views:
                return
            for shard in known.shards:
                self.keep(shard)
        write_bytes_atomically(self.work / PLAN, (json.dumps(self._plan.to_json()) + "\n").encode())
        manifest.unlink(missing_ok=True)

    def _remove_leftovers(self) -> None:
        self._remove_partial([("", self.path / name) for name in ("", *MODEL_FOLDERS, WORK)], lambda _: True)

    def _known_plan(self) -> Mapping[str, object] | None:
        """The plan of the pack in the folder; ``None`` if there is none."""
        path = self.work / PLAN
        if path.is_file():
            try:
                return dict(parsed_json(read_file(path), str(path)))
            except (InputError, TypeError, ValueError):
                raise RunError(
                    f"{path}: expected the plan of a pack, found a damaged file; remove the folder of the pack, or "
                    "choose another one (--out)"
                ) from None
        if (self.path / MANIFEST).is_file():
            known = read_manifest(self.path)
            return Plan(known.identity, known.views_per_shard, known.jpeg_quality, known.opencv, known.views).to_json()
        return None

    def _check(self) -> None:
        """Check that the folder holds nothing, or the pack of this plan or of its first views."""
        if not self.path.exists():
            return
        names = set(names_in(self.path))
        known = self._known_plan()
        if known is None:
            others = {name for name in names if name != WORK}
            if others or not self._holds_only_work():
                raise RunError(
                    f"{self.path}: expected a new or empty folder or a pack to resume, found other files (such as "
                    f"{min(others or {WORK})}); choose another folder (--out)"
                )
            return
        foreign = sorted(name for name in names if not (is_own_name(name) or is_note(name)))
        if foreign:
            raise RunError(
                f"{self.path}: expected only the files of a pack, found {foreign[0]}; move it elsewhere, or choose "
                "another folder (--out)"
            )
        changes = _differences(known, self._plan)
        if changes:
            raise RunError(
                f"{self.path}: the folder holds another pack ({changes[0]}); undo the change to resume it, or choose "
                "another folder (--out)"
            )


def keep_shard(folder: Path, shard: PackedShard) -> None:
    """Note in the folder of an unfinished pack that a shard has been written.

    Raises
    ------
    OSError
        The note cannot be written.
    """
    write_bytes_atomically(_sum_file(folder, shard.number), (json.dumps(shard_to_json(shard)) + "\n").encode())


def kept_shard(
    folder: Path, number: int, views: tuple[int, ...], known: PackedShard | None = None
) -> PackedShard | None:
    """A shard that is there with the size that :func:`keep_shard` has noted; ``None`` if it must be packed.

    ``known`` stands in for the note.
    """
    path = _sum_file(folder, number)
    with suppress(OSError, InputError):
        known = shard_from_json(number, parsed_json(read_file(path), str(path)), str(path))
    with suppress(OSError):
        size = (folder / shard_name(number)).stat().st_size
        if known is not None and known.views == views and known.sum.bytes == size:
            return known
    return None


def _sum_file(folder: Path, number: int) -> Path:
    return folder / WORK / f"{shard_name(number)}.json"


def is_own_name(name: str) -> bool:
    """Whether a pack has a file or a folder of this name in its folder."""
    name = partial_name(name) or name
    return name in (MANIFEST, WORK, *MODEL_FOLDERS, *TABLES) or is_shard(name)


def _differences(known: Mapping[str, object], plan: Plan) -> list[str]:
    changes = []
    if known.get("identity") != plan.identity:
        changes.append("it was made from another dataset")
    quality = known.get("jpeg_quality")
    if quality != plan.jpeg_quality:
        was, now = ("PNG" if value is None else f"JPEG of quality {value}" for value in (quality, plan.jpeg_quality))
        changes.append(f"its RGB is {was}, now {now} is asked for")
    if known.get("opencv") != plan.opencv and quality == plan.jpeg_quality:
        changes.append(f"OpenCV {known.get('opencv')} compressed its RGB, this is {plan.opencv}")
    if known.get("views_per_shard") != plan.views_per_shard:
        changes.append(f"it has {known.get('views_per_shard')} views a shard, now {plan.views_per_shard} are asked for")
    try:
        views = from_runs(known.get("views"), PLAN)
    except InputError:
        return [*changes, "its plan is damaged"]
    if views != plan.views[: len(views)]:
        changes.append("it holds other views, or in another order; a pack may only get more views at its end")
    return changes
