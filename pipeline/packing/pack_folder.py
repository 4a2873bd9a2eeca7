"""The folder of a pack while it is written: one writer, one plan that never changes, shards whole or not at all.

The plan of an unfinished pack is in ``.work``: see :mod:`oneframe.dataset.run.work_folder`.
"""

import json
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from ..dataset.checksums import FileSum, damaged_file, sum_from_json
from ..dataset.layout import FURTHER, MANIFEST, MODEL_FOLDERS
from ..dataset.run.work_folder import WorkFolder
from ..errors import InputError, RunError
from ..files.content import names_in, partial_name, read_file, write_bytes_atomically
from ..files.tables import parsed_json
from .layout import TABLES, WORK, is_note, is_shard, shard_name
from .manifest import Manifest, Plan, read_manifest

PLAN = "plan.json"


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

    def finished(self) -> dict[int, FileSum]:
        """The sums of the plan's shards that are there with the right size, by number."""
        complete, known = self._complete(), dict[int, FileSum]()
        if complete is not None and complete.plan == self._plan:
            known.update(enumerate(complete.shards))
        else:
            for number in range(len(self._plan.shards())):
                path = self._note(number)
                with suppress(OSError, InputError, KeyError, TypeError, ValueError):
                    known[number] = sum_from_json(parsed_json(read_file(path), str(path)))
        return {n: found for n, found in known.items() if not damaged_file(self.path, shard_name(n), found)}

    def keep(self, number: int, known: FileSum) -> None:
        """Note that a shard has been written."""
        write_bytes_atomically(self._note(number), (json.dumps(asdict(known)) + "\n").encode())

    def finish(self) -> None:
        """Remove what only an unfinished pack needs."""
        self._remove_work()

    def _note(self, number: int) -> Path:
        return self.work / f"{shard_name(number)}.json"

    def _complete(self) -> Manifest | None:
        return read_manifest(self.path) if (self.path / MANIFEST).is_file() else None

    def _begin(self) -> None:
        """Write the plan, unless the pack is complete; one that grows is so no longer, and keeps its whole shards."""
        complete, known = self._complete(), self._known_plan()
        if complete is not None and complete.plan == self._plan:
            return
        had = [] if known is None else known.shards()
        for number, views in enumerate(self._plan.shards()):
            if number >= len(had) or had[number] != views:
                self._note(number).unlink(missing_ok=True)
            elif complete is not None and complete.plan == known:
                self.keep(number, complete.shards[number])
        write_bytes_atomically(self.work / PLAN, (json.dumps(self._plan.to_json()) + "\n").encode())
        (self.path / MANIFEST).unlink(missing_ok=True)

    def _remove_leftovers(self) -> None:
        self._remove_partial([("", self.path / name) for name in ("", *MODEL_FOLDERS, WORK)], lambda _: True)

    def _known_plan(self) -> Plan | None:
        """The plan of the pack in the folder; ``None`` if there is none."""
        path = self.work / PLAN
        if path.is_file():
            return Plan.from_json(parsed_json(read_file(path), str(path)), str(path))
        complete = self._complete()
        return None if complete is None else complete.plan

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
        change = _difference(known, self._plan)
        if change:
            raise RunError(
                f"{self.path}: the folder holds another pack ({change}); undo the change to resume it, or choose "
                "another folder (--out)"
            )


def is_own_name(name: str) -> bool:
    """Whether a pack has a file or a folder of this name in its folder."""
    name = partial_name(name) or name
    return name in (MANIFEST, WORK, FURTHER, *MODEL_FOLDERS, *TABLES) or is_shard(name)


def _difference(known: Plan, plan: Plan) -> str:
    """What keeps a pack from going on by another plan, as a clause; empty if nothing does."""
    if known.identity != plan.identity:
        return "it was made from another dataset"
    if known.jpeg_quality != plan.jpeg_quality:
        was, now = (
            "PNG" if each.jpeg_quality is None else f"JPEG of quality {each.jpeg_quality}" for each in (known, plan)
        )
        return f"its RGB is {was}, now {now} is asked for"
    if known.opencv != plan.opencv:
        return f"OpenCV {known.opencv} compressed its RGB, this is {plan.opencv}"
    if known.views_per_shard != plan.views_per_shard:
        return f"it has {known.views_per_shard} views a shard, now {plan.views_per_shard} are asked for"
    if known.views != plan.views[: len(known.views)]:
        return "it holds other views, or in another order; a pack may only get more views at its end"
    return ""
