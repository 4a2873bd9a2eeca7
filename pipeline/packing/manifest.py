"""``pack.json``: which views each shard of a pack holds, and size and hash of all its files. It is written last."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..dataset.checksums import FileSum, sums_to_json
from ..dataset.layout import MOST_VIEWS
from ..errors import InputError
from ..files.content import read_content
from ..files.tables import parsed_json
from .colour_loss import ColourLoss, total_loss
from .layout import FORMAT, MANIFEST, shard_name
from .shard import PackedShard

LARGEST_NUMBER = 1 << 50


@dataclass(frozen=True)
class Manifest:
    """The content of ``pack.json``.

    Attributes
    ----------
    identity
        Of the dataset: see :func:`~oneframe.dataset.identity.identity_of`.
    views_per_shard
        As asked for; the last shard may have fewer.
    jpeg_quality, opencv
        Quality of RGB as JPEG and the version of OpenCV that compressed it; ``None`` for the dataset's PNG files.
    shards
        All shards, in their order.
    files
        Size and hash of all other files, by name.
    """

    identity: str
    views_per_shard: int
    jpeg_quality: int | None
    opencv: str | None
    shards: tuple[PackedShard, ...]
    files: Mapping[str, FileSum]

    @property
    def views(self) -> tuple[int, ...]:
        """All views, in the order of the shards."""
        return tuple(view for shard in self.shards for view in shard.views)

    @property
    def loss(self) -> ColourLoss:
        """What JPEG has lost in all views."""
        return total_loss(shard.loss for shard in self.shards)

    def to_json(self) -> dict[str, object]:
        """The JSON object of the file."""
        rgb: dict[str, object] = {"format": "png"}
        if self.jpeg_quality is not None:
            loss = self.loss
            rgb = {
                "format": "jpeg",
                "quality": self.jpeg_quality,
                "opencv": self.opencv,
                # of 255; identical images have no finite ratio
                "mean_error": loss.mean,
                "largest_error": loss.largest,
                "psnr_db": loss.psnr_db if loss.squared else None,
            }
        return {
            "format": FORMAT,
            "identity": self.identity,
            "count": len(self.views),
            "views_per_shard": self.views_per_shard,
            "rgb": rgb,
            "shards": {shard_name(shard.number): shard_to_json(shard) for shard in self.shards},
            "files": sums_to_json(dict(sorted(self.files.items()))),
        }


def shard_to_json(shard: PackedShard) -> dict[str, object]:
    """The JSON object of one shard: its sum, its views as first and last ones of runs, and its loss if it has any."""
    content: dict[str, object] = {"sha256": shard.sum.sha256, "bytes": shard.sum.bytes, "views": to_runs(shard.views)}
    return content | ({"loss": shard.loss.to_json()} if shard.loss.values else {})


def shard_from_json(number: int, content: object, where: str, most: int = MOST_VIEWS) -> PackedShard:
    """Read it again, with at most so many views.

    Raises
    ------
    InputError
        Something else.
    """
    entry = _Entry(content, where)
    loss = entry.content.get("loss")
    return PackedShard(
        number,
        from_runs(entry.content.get("views"), where, most),
        entry.sum(),
        ColourLoss() if loss is None else ColourLoss.from_json(loss, where),
    )


def read_manifest(folder: Path) -> Manifest:
    """Read the ``pack.json`` of a pack.

    Raises
    ------
    InputError
        Missing, damaged, or of another format.
    """
    path = folder / MANIFEST
    where = str(path)
    manifest = _Entry(parsed_json(read_content(path, "the manifest of a pack", where), where), where)
    if manifest.content.get("format") != FORMAT:
        found = repr(manifest.content.get("format"))[:60]
        raise InputError(
            f"{path}: expected the format {FORMAT!r}, found {found}; use the version of OneFrame that made it"
        )
    if manifest.integer("count") > MOST_VIEWS:
        raise InputError(f"{path}: expected at most {MOST_VIEWS} views, found {manifest.integer('count')}; {AGAIN}")
    shards, files, rgb = manifest.table("shards"), manifest.table("files"), manifest.table("rgb")
    names = [shard_name(number) for number in range(len(shards))]
    if not names or list(shards) != names:
        raise InputError(f"{path}: expected shards from {shard_name(0)} on, found others; {AGAIN}")
    found_shards, left = [], manifest.integer("count")
    for number, name in enumerate(names):
        found_shards.append(shard_from_json(number, shards[name], f"{path}: {name}", most=left))
        left -= len(found_shards[-1].views)
    views = [view for shard in found_shards for view in shard.views]
    if len(set(views)) != len(views) or manifest.integer("count") != len(views):
        raise InputError(f"{path}: expected each view in one shard, and count to be their number; {AGAIN}")
    quality, version = rgb.get("quality"), rgb.get("opencv")
    if (rgb.get("format") == "jpeg") != isinstance(quality, int) or rgb.get("format") not in ("png", "jpeg"):
        raise InputError(f"{path}: expected rgb to be png, or jpeg with its quality, found {rgb!r}; {AGAIN}")
    return Manifest(
        identity=str(manifest.content.get("identity")),
        views_per_shard=manifest.integer("views_per_shard"),
        jpeg_quality=quality,
        opencv=None if version is None else str(version),
        shards=tuple(found_shards),
        files={name: _Entry(content, f"{path}: {name}").sum() for name, content in files.items()},
    )


AGAIN = "copy or pack it again"


def to_runs(views: Sequence[int]) -> list[list[int]]:
    """Numbers as [first, last] of runs that rise by one; their order is kept."""
    runs: list[list[int]] = []
    for view in views:
        if runs and runs[-1][1] + 1 == view:
            runs[-1][1] = view
        else:
            runs.append([view, view])
    return runs


def from_runs(runs: object, where: str, most: int = MOST_VIEWS) -> tuple[int, ...]:
    """The numbers of :func:`to_runs`, at most so many.

    Raises
    ------
    InputError
        Something else.
    """
    if not isinstance(runs, list) or not runs or not all(map(_is_run, runs)):
        raise InputError(f"{where}: expected views as pairs of a first and a last number; {AGAIN}")
    if sum(last - first + 1 for first, last in runs) > most:
        raise InputError(f"{where}: expected at most {most} views, found more; {AGAIN}")
    return tuple(view for first, last in runs for view in range(first, last + 1))


class _Entry:
    """Typed access to a JSON object."""

    def __init__(self, content: object, where: str) -> None:
        if not isinstance(content, dict):
            raise InputError(f"{where}: expected a table, found {str(content)[:60]!r}; {AGAIN}")
        self.content: dict[str, Any] = content
        self._where = where

    def table(self, key: str) -> dict[str, Any]:
        return _Entry(self.content.get(key), f"{self._where}: {key}").content

    def integer(self, key: str) -> int:
        value = self.content.get(key)
        if not isinstance(value, int) or not _is_number(value):
            raise InputError(f"{self._where}: expected {key} to be a whole number, found {str(value)[:60]!r}; {AGAIN}")
        return value

    def sum(self) -> FileSum:
        digest = self.content.get("sha256")
        if not isinstance(digest, str) or len(digest) != 64:
            raise InputError(f"{self._where}: expected sha256 to be 64 digits, found {str(digest)[:60]!r}; {AGAIN}")
        return FileSum(digest, self.integer("bytes"))


def _is_number(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= LARGEST_NUMBER


def _is_run(run: object) -> bool:
    return isinstance(run, list) and len(run) == 2 and all(map(_is_number, run)) and run[0] <= run[1]
