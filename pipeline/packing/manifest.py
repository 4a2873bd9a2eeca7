"""What a pack holds: its plan, and ``pack.json``, which is written last, with size and hash of all its files."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..dataset.checksums import FileSum, sum_from_json, sums_to_json
from ..dataset.layout import MANIFEST, MOST_VIEWS
from ..dataset.run.survey import to_runs
from ..errors import InputError
from ..files.content import read_content
from ..files.numbers import whole_number
from ..files.tables import parsed_json
from .layout import FORMAT, shard_name

_DAMAGE = (AttributeError, KeyError, TypeError, ValueError)
"""What reading damaged JSON raises."""


@dataclass(frozen=True)
class Plan:
    """What a pack holds, which never changes but for more views at the end.

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
    """

    identity: str
    views_per_shard: int
    jpeg_quality: int | None
    opencv: str | None
    views: tuple[int, ...]

    def shards(self) -> list[tuple[int, ...]]:
        """The views of each shard."""
        step = self.views_per_shard
        return [self.views[first : first + step] for first in range(0, len(self.views), step)]

    def to_json(self) -> dict[str, object]:
        """The JSON object of an unfinished pack."""
        return self.__dict__ | {"views": to_runs(self.views)}

    @classmethod
    def from_json(cls, content: Any, where: str) -> "Plan":
        """Read it again; InputError for something else."""
        try:
            return cls(
                identity=str(content["identity"]),
                views_per_shard=whole_number(content["views_per_shard"], MOST_VIEWS),
                jpeg_quality=content["jpeg_quality"],
                opencv=content["opencv"],
                views=_from_runs(content["views"], MOST_VIEWS),
            )
        except _DAMAGE as error:
            raise _damaged(where, error) from None


@dataclass(frozen=True)
class Manifest:
    """The content of ``pack.json``: the plan, the sums of its shards in their order, and those of all other files."""

    plan: Plan
    shards: tuple[FileSum, ...]
    files: Mapping[str, FileSum]

    def to_json(self) -> dict[str, object]:
        """The JSON object of the file."""
        plan, rgb = self.plan, dict[str, object](format="png")
        if plan.jpeg_quality is not None:
            rgb = {"format": "jpeg", "quality": plan.jpeg_quality, "opencv": plan.opencv}
        return {
            "format": FORMAT,
            "identity": plan.identity,
            "count": len(plan.views),
            "views_per_shard": plan.views_per_shard,
            "rgb": rgb,
            "shards": {
                shard_name(number): {"sha256": known.sha256, "bytes": known.bytes, "views": to_runs(views)}
                for number, (known, views) in enumerate(zip(self.shards, plan.shards(), strict=True))
            },
            "files": sums_to_json(dict(sorted(self.files.items()))),
        }


def read_manifest(folder: Path) -> Manifest:
    """Read the ``pack.json`` of a pack.

    Raises
    ------
    InputError
        Missing, damaged, or of another format.
    """
    path = folder / MANIFEST
    where = str(path)
    content = parsed_json(read_content(path, "the manifest of a pack", where), where)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = repr(content.get("format") if isinstance(content, dict) else content)[:60]
        raise InputError(
            f"{path}: expected the format {FORMAT!r}, found {found}; use the version of OneFrame that made it"
        )
    try:
        count = left = whole_number(content["count"], MOST_VIEWS)
        views: list[tuple[int, ...]] = []
        for shard in content["shards"].values():
            views.append(_from_runs(shard["views"], left))
            left -= len(views[-1])
        rgb = content["rgb"]
        plan = Plan(
            identity=str(content["identity"]),
            views_per_shard=whole_number(content["views_per_shard"], MOST_VIEWS),
            jpeg_quality=rgb.get("quality"),
            opencv=rgb.get("opencv"),
            views=tuple(view for shard in views for view in shard),
        )
        names = [*map(shard_name, range(len(views)))]
        if left or len({*plan.views}) != count or plan.shards() != views or [*content["shards"]] != names:
            raise ValueError("a view is in no shard, in two or in another")
        if (rgb["format"], isinstance(plan.jpeg_quality, int)) not in (("jpeg", True), ("png", False)):
            raise ValueError(f"rgb is {str(rgb)[:60]}")
        return Manifest(
            plan,
            tuple(map(sum_from_json, content["shards"].values())),
            {name: sum_from_json(known) for name, known in content["files"].items()},
        )
    except _DAMAGE as error:
        raise _damaged(where, error) from None


def _damaged(where: str, error: Exception) -> InputError:
    return InputError(
        f"{where}: expected what a pack holds, found a damaged file ({type(error).__name__}: {error}); copy or pack it "
        "again"
    )


def _from_runs(runs: Any, most: int) -> tuple[int, ...]:
    """The numbers of :func:`to_runs`; TypeError or ValueError for something else, or more than so many."""
    ends = [(whole_number(first, MOST_VIEWS), whole_number(last, MOST_VIEWS)) for first, last in runs]
    if not 0 < sum(last - first + 1 for first, last in ends) <= most or any(last < first for first, last in ends):
        raise ValueError(f"expected 1 to {most} views in runs of a first and a last one")
    return tuple(view for first, last in ends for view in range(first, last + 1))
