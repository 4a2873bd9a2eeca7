"""``pack.json``: what a pack is to hold, written first; and, at the end, size and hash of all its files."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..dataset.checksums import FileSum, sum_from_json, sums_to_json
from ..dataset.layout import MANIFEST, MOST_VIEWS
from ..dataset.run.survey import to_runs
from ..errors import InputError
from ..files.content import read_content
from ..files.numbers import whole_number
from ..files.tables import parsed_json, write_json

FORMAT = "oneframe pack 1"
"""Name and version of the layout."""


@dataclass(frozen=True)
class Plan:
    """All that the bytes of a pack depend on.

    Attributes
    ----------
    identity
        Of the dataset: see :func:`~oneframe.dataset.identity.identity_of`.
    views_per_shard
        The last shard may have fewer.
    jpeg_quality, opencv
        Quality of RGB as JPEG and the version of OpenCV that compresses it; ``None`` for the dataset's PNG files.
    views
        The views in their order.
    about
        A sentence for people, such as which part of a split the views are.
    """

    identity: str
    views_per_shard: int
    jpeg_quality: int | None
    opencv: str | None
    views: tuple[int, ...]
    about: str = ""

    def shards(self) -> list[tuple[int, ...]]:
        """The views of each shard."""
        step = self.views_per_shard
        return [self.views[first : first + step] for first in range(0, len(self.views), step)]


@dataclass(frozen=True)
class Manifest:
    """The content of ``pack.json``: the plan, and the sums of all other files by name once the pack is complete."""

    plan: Plan
    files: Mapping[str, FileSum] = field(default_factory=dict)

    def write(self, folder: Path) -> None:
        """Write the file."""
        plan = self.plan.__dict__ | {"views": to_runs(self.plan.views)}
        files = sums_to_json(dict(sorted(self.files.items())))
        write_json(folder / MANIFEST, {"format": FORMAT, "count": len(self.plan.views), **plan, "files": files})


def read_manifest(folder: Path) -> Manifest:
    """Read the ``pack.json`` of a pack that may not be complete yet."""
    path = folder / MANIFEST
    content: Any = parsed_json(read_content(path, "the manifest of a pack", str(path)), str(path))
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = repr(content.get("format") if isinstance(content, dict) else content)[:60]
        raise InputError(
            f"{path}: expected the format {FORMAT!r}, found {found}; use the version of OneFrame that made it"
        )
    try:
        quality = content["jpeg_quality"]
        plan = Plan(
            identity=str(content["identity"]),
            views_per_shard=whole_number(content["views_per_shard"], MOST_VIEWS),
            jpeg_quality=None if quality is None else whole_number(quality, 100),
            opencv=content["opencv"],
            views=_from_runs(content["views"], whole_number(content["count"], MOST_VIEWS)),
            about=str(content["about"]),
        )
        return Manifest(plan, {str(name): sum_from_json(known) for name, known in content["files"].items()})
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: expected what a pack holds, found a damaged file ({type(error).__name__}: {error}); copy or pack "
            "it again"
        ) from None


def complete_manifest(folder: Path) -> Manifest:
    """Read the ``pack.json`` of a complete pack."""
    if not (folder / MANIFEST).is_file():
        raise InputError(f"{folder}: expected a complete pack, found no {MANIFEST} in it")
    manifest = read_manifest(folder)
    if not manifest.files:
        raise InputError(
            f"{folder}: expected a complete pack, found an unfinished one; run the command that packs it again"
        )
    return manifest


def _from_runs(runs: Any, count: int) -> tuple[int, ...]:
    """The numbers of :func:`to_runs`; TypeError or ValueError for something else, or another number of them."""
    ends = [(whole_number(first, MOST_VIEWS), whole_number(last, MOST_VIEWS)) for first, last in runs]
    if not 0 < sum(last - first + 1 for first, last in ends) == count or any(last < first for first, last in ends):
        raise ValueError(f"expected {count} views in runs of a first and a last one")
    views = tuple(view for first, last in ends for view in range(first, last + 1))
    if len(set(views)) < count:
        raise ValueError("a view is in two places")
    return views
