"""What an evaluation found: its JSON file, from which tables and charts are made."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...files.content import read_content
from ...files.tables import parsed_json
from ..conditions import Conditions
from ..scores.mean_intervals import Resampling
from ..scores.view_scores import SCORES, direction

FORMAT = "oneframe evaluation 1"
EVALUATION = "evaluation.json"
"""Its name in a folder."""
ALL = "all"
"""The name of all cases together."""
ANGLES_DEG = (0.0, 10.0, 20.0, 35.0, 180.0)
"""Ends of the ranges of angles from the nearest frame in which errors are summarised."""
BY_ANGLE = ("error_observed", "error_surface")


@dataclass(frozen=True)
class EvaluatedCase:
    """A case: its name in all tables, the names of its photographs, and the name of the first case of its surface."""

    name: str
    frames: tuple[str, ...]
    surface: str = ""


@dataclass(frozen=True)
class EvaluatedMethod:
    """A method: its name, whether others made it, and why it was skipped (empty if it ran)."""

    name: str
    peer: bool
    skipped: str = ""


@dataclass(frozen=True)
class Row:
    """The scores of a view, see :mod:`oneframe.evaluation.scores.view_scores`; NaN for those that it does not have."""

    case: str
    image: str
    method: str
    scores: Mapping[str, float]


@dataclass(frozen=True)
class Summary:
    """The mean of one score over the photographs of a case, with its 95 % confidence interval.

    Attributes
    ----------
    worst
        The score of the worst photograph; NaN where neither more nor less is better.
    behind, behind_low, behind_high
        How far the mean is behind that of the leading method on the same photographs, with its interval; NaN as above.
    best
        Whether the interval does not tell the method from the leading one, but does so with another.
    """

    case: str
    method: str
    score: str
    mean: float
    low: float
    high: float
    n: int
    worst: float = math.nan
    behind: float = math.nan
    behind_low: float = math.nan
    behind_high: float = math.nan
    best: bool = False


@dataclass(frozen=True)
class AngleSummary:
    """The mean of one score over a case's photographs from one angle to another, see :data:`ANGLES_DEG`."""

    case: str
    method: str
    score: str
    from_deg: float
    to_deg: float
    mean: float
    low: float
    high: float
    n: int


@dataclass(frozen=True)
class Distribution:
    """FID and KID between the photographs and a method's views of a case."""

    case: str
    method: str
    fid: float
    fid_biased: bool
    kid: float
    kid_standard_error: float
    n: int


@dataclass(frozen=True)
class Bound:
    """What a perfect view would score, with the same noise and an error of the pose of ``jitter_px``."""

    case: str
    score: str
    mean: float
    low: float
    high: float
    jitter_px: float


@dataclass(frozen=True)
class Pictures:
    """The pictures of one view, relative to the folder of the evaluation."""

    case: str
    image: str
    method: str
    real: str
    segmented: str
    rendered: str
    difference: str


@dataclass(frozen=True)
class Evaluation:
    """All results; ``missing`` says why there is no distribution, ``seconds`` what took how long."""

    conditions: Conditions
    cases: tuple[EvaluatedCase, ...]
    methods: tuple[EvaluatedMethod, ...]
    rows: tuple[Row, ...]
    summary: tuple[Summary, ...]
    distribution: tuple[Distribution, ...]
    bound: tuple[Bound, ...]
    missing: str = ""
    pictures: tuple[Pictures, ...] = ()
    charts: tuple[str, ...] = field(default=())
    angles: tuple[AngleSummary, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)

    @property
    def ran(self) -> tuple[EvaluatedMethod, ...]:
        """The methods that were not skipped."""
        return tuple(method for method in self.methods if not method.skipped)

    def mean(self, case: str, method: str, score: str) -> Summary:
        """The summary of a score; NaN, of no photographs, if there is none."""
        key, nan = (case, method, score), float("nan")
        found = (entry for entry in self.summary if (entry.case, entry.method, entry.score) == key)
        return next(found, Summary(*key, nan, nan, nan, 0))

    def bound_of(self, case: str, score: str) -> Bound | None:
        """The bound of a score."""
        return next((entry for entry in self.bound if (entry.case, entry.score) == (case, score)), None)


def summarised(rows: Sequence[Row], cases: Sequence[EvaluatedCase], rng: np.random.Generator) -> tuple[Summary, ...]:
    """Summaries for every case and :data:`ALL`, method and score, in the order of the rows."""
    methods = list(dict.fromkeys(row.method for row in rows))
    images = list(dict.fromkeys((row.case, row.image) for row in rows))
    by_image = {(row.case, row.image, row.method): row.scores for row in rows}
    entries: list[Summary] = []
    for case in [*dict.fromkeys(name for name, _ in images), ALL]:
        own = [image for image in images if case in (ALL, image[0])]
        resampling = Resampling(clusters(own, cases), rng)
        for score in SCORES:
            values = np.array([[by_image[*image, method][score] for image in own] for method in methods])
            entries += _summaries(case, methods, score, values, resampling)
    return tuple(entries)


def by_angle(rows: Sequence[Row], cases: Sequence[EvaluatedCase], rng: np.random.Generator) -> Iterator[AngleSummary]:
    """Errors of each case, and of :data:`ALL`, method and range of angles that holds photographs."""
    for case in [*dict.fromkeys(row.case for row in rows), ALL]:
        for start, end in pairwise(ANGLES_DEG):
            within = [row for row in rows if case in (ALL, row.case) and start <= row.scores["angle_deg"] < end]
            for method in dict.fromkeys(row.method for row in within):
                own = [row for row in within if row.method == method]
                resampling = Resampling(clusters([(row.case, row.image) for row in own], cases), rng)
                for score in BY_ANGLE:
                    found = resampling.interval(np.array([row.scores[score] for row in own]))
                    yield AngleSummary(case, method, score, start, end, found.mean, found.low, found.high, found.n)


def clusters(images: Sequence[tuple[str, str]], cases: Sequence[EvaluatedCase]) -> list[tuple[str, str, str]]:
    """(case, image) -> what an image is drawn by: (surface, case, image)."""
    surfaces = {case.name: case.surface or case.name for case in cases}
    return [(surfaces[case], case, image) for case, image in images]


def _summaries(
    case: str, methods: Sequence[str], score: str, values: np.ndarray, resampling: Resampling
) -> list[Summary]:
    """The summaries of one score: ``values`` has a row for each method."""
    sign, found = direction(score), [resampling.interval(row) for row in values]
    entries = [
        Summary(case, name, score, each.mean, each.low, each.high, each.n)
        for name, each in zip(methods, found, strict=True)
    ]
    means = sign * np.array([each.mean for each in found])
    if not sign or np.isnan(means).all():
        return entries
    leader = values[np.nanargmax(means)]
    with np.errstate(invalid="ignore"):
        behind = [resampling.interval(sign * (leader - row)) for row in values]
    told = any(each.low > 0 for each in behind)
    return [
        replace(
            entry,
            worst=sign * float(min(sign * row[~np.isnan(row)], default=math.nan)),
            behind=gap.mean,
            behind_low=gap.low,
            behind_high=gap.high,
            best=told and gap.n > 0 and not gap.low > 0,
        )
        for entry, row, gap in zip(entries, values, behind, strict=True)
    ]


def evaluation_bytes(evaluation: Evaluation) -> bytes:
    """The JSON file; values that are missing or not finite are null."""
    # the scores are for whoever shows the file
    table = {"format": FORMAT, **asdict(evaluation), "scores": SCORES}
    conditions = table["conditions"]
    conditions["configuration"] = {name: str(value) for name, value in conditions["configuration"].items()}
    table["rows"] = [{"case": r.case, "image": r.image, "method": r.method, **r.scores} for r in evaluation.rows]
    table["methods"] = [{name: value for name, value in each.items() if value != ""} for each in table["methods"]]
    if not evaluation.missing:
        del table["missing"]
    return (json.dumps(_finite(table), indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def read_evaluation(path: Path) -> Evaluation:
    """Read the file of an evaluation.

    Raises
    ------
    InputError
        It is missing, or holds something else.
    """
    table = parsed_json(read_content(path, "an evaluation"), path.name)
    try:
        if table["format"] != FORMAT:
            raise ValueError(f"format {table['format']!r}")
        return Evaluation(
            conditions=Conditions(**table["conditions"]),
            cases=tuple(EvaluatedCase(e["name"], tuple(e["frames"]), e.get("surface", "")) for e in table["cases"]),
            methods=tuple(EvaluatedMethod(**entry) for entry in table["methods"]),
            rows=tuple(
                Row(e["case"], e["image"], e["method"], {score: _number(e.get(score)) for score in SCORES})
                for e in table["rows"]
            ),
            summary=tuple(Summary(**_numbers(entry)) for entry in table["summary"]),
            distribution=tuple(Distribution(**_numbers(entry)) for entry in table["distribution"]),
            bound=tuple(Bound(**_numbers(entry)) for entry in table["bound"]),
            missing=table.get("missing", ""),
            pictures=tuple(Pictures(**entry) for entry in table["pictures"]),
            charts=tuple(table["charts"]),
            angles=tuple(AngleSummary(**_numbers(entry)) for entry in table.get("angles", ())),
            seconds=dict(table.get("seconds", {})),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{path.name}: expected {FORMAT!r}, found something else ({error!r}); evaluate again"
        ) from None


def _finite(value: object) -> object:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    return [_finite(entry) for entry in value] if isinstance(value, list | tuple) else value


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)


def _numbers(entry: Mapping[str, object]) -> dict:
    return {key: float("nan") if value is None else value for key, value in entry.items()}
