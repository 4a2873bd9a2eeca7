"""What an evaluation says: the scores of every photograph, their means with intervals, and who leads. Needs ``scipy``.

The 95 % confidence intervals are clustered: by surface, by case, by photograph. Photographs of one surface, coloured
from one frame, resemble each other: 300 of them say little about the next surface. So whole surfaces are drawn first,
then cases (source frames) of each, then photographs (the nested bootstrap; Davison and Hinkley 1997, 3.8), and each of
them counts as much as its neighbours. Pixels are never drawn.
"""

import math
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr, stdtrit

from .conditions import Conditions
from .distribution_distance import FEWEST_IMAGES, FID_IMAGES, Distances, distances
from .view_scores import SCORES, direction

ALL = "all"
"""The name of all cases together."""
HEADINGS = {
    "ssim_whole": ("SSIM, whole image", 3),
    "ssim_surface": ("SSIM, surface", 3),
    "ssim_observed": ("SSIM, observed", 3),
    "psnr_whole": ("PSNR, whole (dB)", 1),
    "psnr_observed": ("PSNR, observed (dB)", 1),
    "error_observed": ("error, observed (/255)", 1),
    "ssim_observed_corrected": ("SSIM, observed, corrected", 3),
    "error_observed_corrected": ("error, observed, corrected", 1),
}
"""Scores of the table -> heading and decimals."""
RANKED = {
    "ssim_whole": "SSIM of the whole image",
    "ssim_surface": "SSIM inside the surface",
    "ssim_observed": "SSIM inside the observed surface",
}
FRAME_COLUMNS = ("case", "image", "method", *SCORES)
RESAMPLES = 2000
LEVEL = 0.95


@dataclass(frozen=True)
class MeanInterval:
    """Mean, the ends of its confidence interval (NaN for one value), and the number of values."""

    mean: float
    low: float
    high: float
    n: int


class Resampling:
    """Draws the same photographs for all values, so that differences are paired.

    Parameters
    ----------
    paths
        Of each photograph: what it belongs to, from the outermost, and itself, such as (surface, case, photograph).
    rng
        Draws.
    """

    def __init__(self, paths: Sequence[tuple[Hashable, ...]], rng: np.random.Generator) -> None:
        self._weights = np.zeros((RESAMPLES + 1, len(paths)))

        def draw(members: Sequence[int], times: np.ndarray, share: float, depth: int) -> None:
            if depth == len(paths[members[0]]):
                self._weights[:, members] = (share * times)[:, None]
                return
            parts: dict[Hashable, list[int]] = {}
            for member in members:
                parts.setdefault(paths[member][depth], []).append(member)
            # a group that was drawn m times is drawn from m times, independently
            counts = rng.multinomial(times * len(parts), np.full(len(parts), 1 / len(parts)))
            counts[0] = 1
            for part, count in zip(parts.values(), counts.T, strict=True):
                draw(part, count, share / len(parts), depth + 1)

        draw(range(len(paths)), np.ones(RESAMPLES + 1, int), 1.0, 0)
        outermost = next((level for level in zip(*paths, strict=True) if len(set(level)) > 1), paths)
        self._units = np.unique([str(unit) for unit in outermost], return_inverse=True)[1]

    def interval(self, values: np.ndarray) -> MeanInterval:
        """The mean of ``(N,)`` values, and its expanded percentile interval; NaN values are left out.

        A percentile interval of few units is too narrow; its percentiles are those that would make that of normal means
        Student's (Hesterberg 2015, "What teachers should know about the bootstrap", 3.3).
        """
        known = ~np.isnan(values)
        nan, units = float("nan"), len(np.unique(self._units[known]))
        if units == 0:
            return MeanInterval(nan, nan, nan, 0)
        weights = self._weights[:, known]
        # what is left out gives its weight to the others
        shares = weights.sum(axis=1)
        mean = float(weights[0] @ values[known] / shares[0])
        if units == 1 or not np.isfinite(mean):
            return MeanInterval(mean, nan, nan, int(known.sum()))
        drawn = weights[shares > 0] @ values[known] / shares[shares > 0]
        tail = ndtr(np.sqrt(units / (units - 1)) * stdtrit(units - 1, (1 - LEVEL) / 2))
        low, high = np.quantile(drawn, [tail, 1 - tail])
        return MeanInterval(mean, float(low), float(high), int(known.sum()))


@dataclass(frozen=True)
class Row:
    """The scores of a view, see :mod:`oneframe.evaluation.scores.view_scores`; NaN for those that it does not have."""

    case: str
    image: str
    method: str
    scores: Mapping[str, float]

    @property
    def cells(self) -> tuple[object, ...]:
        """In the order of :data:`FRAME_COLUMNS`; scores that a view does not have are empty."""
        scores = ("" if math.isnan(self.scores[name]) else self.scores[name] for name in SCORES)
        return self.case, self.image, self.method, *scores


@dataclass(frozen=True)
class Mean:
    """The mean of a score over the photographs of a case.

    Attributes
    ----------
    interval
        With its 95 % confidence interval and the number of photographs.
    behind
        How far it is behind that of the leading method on the same photographs; ``None`` where neither more nor less is
        better, or a value is missing.
    """

    interval: MeanInterval
    behind: MeanInterval | None = None


@dataclass(frozen=True)
class Summary:
    """Means by case (and :data:`ALL`), method and score; distances by case and method; who is a peer."""

    conditions: Conditions
    cases: tuple[str, ...]
    peer_by_method: Mapping[str, bool]
    means: Mapping[tuple[str, str, str], Mean]
    distances: Mapping[tuple[str, str], Distances]

    @property
    def blocks(self) -> tuple[str, ...]:
        """The cases, and of several also :data:`ALL`."""
        return self.cases + (ALL,) * (len(self.cases) > 1)

    def mean(self, case: str, method: str, score: str) -> MeanInterval:
        """The mean of a score; NaN, of no photographs, if there is none."""
        found = self.means.get((case, method, score))
        return MeanInterval(math.nan, math.nan, math.nan, 0) if found is None else found.interval


def summary_of(
    rows: Sequence[Row],
    surfaces: Mapping[str, str],
    peer_by_method: Mapping[str, bool],
    conditions: Conditions,
    features: Mapping[tuple[str, str], Sequence[tuple[np.ndarray, np.ndarray]]],
    rng: np.random.Generator,
) -> Summary:
    """Summarise rows.

    Parameters
    ----------
    rows
        All cases', photograph by photograph.
    surfaces
        Case -> what its surface is called: cases of one surface are drawn together.
    peer_by_method
        Method -> whether others made it, in the order of the table.
    conditions
        Under which the rows were measured.
    features
        Case and method -> features of photograph and view, for FID and KID; those of all cases are compared too.
    rng
        Draws for the intervals.
    """
    means: dict[tuple[str, str, str], Mean] = {}
    by_image = {(row.case, row.image, row.method): row.scores for row in rows}
    images = list(dict.fromkeys((row.case, row.image) for row in rows))
    for case in (*surfaces, ALL):
        own = [image for image in images if case in (ALL, image[0])]
        resampling = Resampling([(surfaces[name], name, image) for name, image in own], rng)
        for score in SCORES:
            values = {method: np.array([by_image[*image, method][score] for image in own]) for method in peer_by_method}
            for method, mean in _means(values, direction(score), resampling):
                means[case, method, score] = mean
    groups = {key: list(each) for key, each in features.items()}
    for (_, method), each in features.items():
        groups.setdefault((ALL, method), []).extend(each)
    apart = {key: distances(each) for key, each in groups.items() if len(each) >= FEWEST_IMAGES}
    return Summary(conditions, tuple(surfaces), peer_by_method, means, apart)


def _means(values: Mapping[str, np.ndarray], sign: int, resampling: Resampling) -> Iterator[tuple[str, Mean]]:
    """By method: of ``(N,)`` values, of which more (1), less (-1) or neither (0) is better."""
    intervals = {method: resampling.interval(each) for method, each in values.items()}
    known = {method: sign * each.mean for method, each in intervals.items() if not math.isnan(each.mean)}
    leader = max(known, key=lambda method: known[method], default=None) if sign else None
    for method, interval in intervals.items():
        mean = Mean(interval)
        if leader is not None:
            with np.errstate(invalid="ignore"):
                mean = replace(mean, behind=resampling.interval(sign * (values[leader] - values[method])))
        yield method, mean


def markdown_table(summary: Summary, notes: Iterable[str]) -> bytes:
    """The summary as Markdown: conditions and notes, then a table for each case and for all."""
    lines = ["# Evaluation", "", *(f"{line}  " for line in summary.conditions.lines()), ""]
    lines += ["Means with 95 % confidence intervals: bootstrap over surfaces, then cases, then photographs.", ""]
    lines += [f"- {note}" for note in notes]
    for case in summary.blocks:
        has_distances = any(each == case for each, _ in summary.distances)
        headings = [heading for heading, _ in HEADINGS.values()] + ["FID", "KID"] * has_distances
        lines += ["", f"## {'All cases' if case == ALL else case}", "", _line("", *headings)]
        lines.append("|---" * (len(headings) + 1) + "|")
        for method in summary.peer_by_method:
            cells = [_cell(summary.mean(case, method, name), decimals) for name, (_, decimals) in HEADINGS.items()]
            if (apart := summary.distances.get((case, method))) is not None:
                cells += [f"{apart.fid:.1f}", f"{apart.kid:.4f} ± {apart.kid_error:.4f}"]
            lines.append(_line(method, *cells))
    return ("\n".join(lines) + "\n").encode()


def _line(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _cell(mean: MeanInterval, decimals: int) -> str:
    if math.isnan(mean.mean):
        return ""
    interval = "" if math.isnan(mean.low) else f" [{mean.low:.{decimals}f}, {mean.high:.{decimals}f}]"
    return f"{mean.mean:.{decimals}f}{interval}"


def summary_notes(summary: Summary) -> Iterator[str]:
    """A sentence for every case and score by which the paper's method is ahead of all of ours.

    Ahead is what the interval of the paired difference tells apart.
    """
    if any(each.n < FID_IMAGES for each in summary.distances.values()):
        yield f"FID is biased: it needs {FID_IMAGES} images or more. Compare KID."
    for case in summary.blocks:
        for score, words in RANKED.items():
            groups: dict[bool, list[tuple[float, str]]] = {True: [], False: []}
            for method, peer in summary.peer_by_method.items():
                if (mean := summary.mean(case, method, score)).n:
                    groups[peer].append((mean.mean, method))
            if not groups[True] or not groups[False]:
                continue
            (theirs, leader), (ours, best) = max(groups[True]), max(groups[False])
            behind = summary.means[case, best, score].behind
            if theirs > ours and behind is not None and behind.low > 0:
                title = "All cases" if case == ALL else case
                yield (
                    f"{title}: {leader} is ahead in {words}, {theirs:.3f} against {ours:.3f} ({best}), "
                    f"by {behind.low:.3f} to {behind.high:.3f} on the same photographs."
                )
