"""``pack.json``: which views each shard of a pack holds, and size and hash of all its files. It is written last."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..dataset.checksums import FileSum, sum_from_json, sums_to_json
from ..dataset.layout import MOST_VIEWS
from ..dataset.run.survey import to_runs
from ..errors import InputError
from ..files.content import read_content
from ..files.numbers import whole_number
from ..files.tables import parsed_json
from .colour_loss import ColourLoss
from .layout import FORMAT, MANIFEST, shard_name
from .shard import PackedShard


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
        return sum((shard.loss for shard in self.shards), ColourLoss())

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


def shard_from_json(number: int, content: Any, where: str, most: int = MOST_VIEWS) -> PackedShard:
    """Read it again, with at most so many views.

    Raises
    ------
    InputError
        Something else.
    """
    with _reading(where):
        loss = content.get("loss")
        return PackedShard(
            number,
            from_runs(content["views"], where, most),
            sum_from_json(content),
            ColourLoss() if loss is None else ColourLoss.from_json(loss),
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
    content = parsed_json(read_content(path, "the manifest of a pack", where), where)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = repr(content.get("format") if isinstance(content, dict) else content)[:60]
        raise InputError(
            f"{path}: expected the format {FORMAT!r}, found {found}; use the version of OneFrame that made it"
        )
    with _reading(where):
        count = left = whole_number(content["count"], MOST_VIEWS)
        shards: list[PackedShard] = []
        for number, (name, shard) in enumerate(content["shards"].items()):
            if name != shard_name(number):
                raise ValueError(f"{name[:60]} in the place of {shard_name(number)}")
            shards.append(shard_from_json(number, shard, f"{path}: {name}", most=left))
            left -= len(shards[-1].views)
        views = {view for shard in shards for view in shard.views}
        if not shards or left or len(views) != count:
            raise ValueError("a view is in no shard, or in two")
        rgb = content["rgb"]
        quality, version = rgb.get("quality"), rgb.get("opencv")
        if (rgb["format"], isinstance(quality, int)) not in (("jpeg", True), ("png", False)):
            raise ValueError(f"rgb is {str(rgb)[:60]}")
        return Manifest(
            identity=str(content["identity"]),
            views_per_shard=whole_number(content["views_per_shard"], MOST_VIEWS),
            jpeg_quality=quality,
            opencv=None if version is None else str(version),
            shards=tuple(shards),
            files={name: sum_from_json(known) for name, known in content["files"].items()},
        )


@contextmanager
def _reading(where: str) -> Iterator[None]:
    """Turn what damaged JSON raises inside the block into a sentence."""
    try:
        yield
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"{where}: expected a part of the manifest of a pack, found a damaged one ({type(error).__name__}: "
            f"{error}); {AGAIN}"
        ) from None


AGAIN = "copy or pack it again"


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


def _is_run(run: object) -> bool:
    return isinstance(run, list) and len(run) == 2 and all(type(end) is int for end in run) and 0 <= run[0] <= run[1]
