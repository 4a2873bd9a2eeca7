"""Cells of sweeps: at one setting, how many trials failed, and how the software answered."""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

Answer = Literal["works", "warns", "falls back", "refuses"]
ANSWERS: tuple[Answer, ...] = ("works", "warns", "falls back", "refuses")
"""A result without a word; with a message; a lesser result in place of a wrong one; none, with the reason."""

LONGEST_MESSAGE = 240
"""Characters of a message that a table keeps."""


@dataclass(frozen=True)
class Outcome:
    """One trial.

    Attributes
    ----------
    answer
        What the software did.
    error
        Error of the result in the unit of the sweep; NaN without a result.
    wrong
        Whether there is a result and it is further off than the sweep allows.
    message
        What the software said; empty if nothing.
    value
        Another quantity of the sweep, such as a time; NaN if there is none.
    """

    answer: Answer
    error: float = math.nan
    wrong: bool = False
    message: str = ""
    value: float = math.nan


@dataclass(frozen=True)
class Limit:
    """A limit of the software on the swept variable: the name of its constant, and its value in that unit."""

    constant: str
    value: float


NO_LIMIT = Limit("", math.nan)


@dataclass(frozen=True)
class Cell:
    """The trials at one setting: a row of the table.

    Attributes
    ----------
    sweep, series
        Name of the sweep; what is compared within it, such as a solver or an engine.
    x, y
        The swept variable, and the second one of a sweep in two dimensions, else NaN.
    trials, wrong, silent
        Number of trials; those with a wrong result; those of them about which the software said nothing.
    works, warns, falls_back, refuses
        Numbers of trials by answer.
    error, error_95, value
        Median and 95 % quantile of the errors, and median of the values; NaN without any.
    constant, limit
        The software's limit on ``x``; empty and NaN if it has none.
    message
        The most frequent message.
    """

    sweep: str
    series: str
    x: float
    y: float
    trials: int
    wrong: int
    silent: int
    works: int
    warns: int
    falls_back: int
    refuses: int
    error: float
    error_95: float
    value: float
    constant: str
    limit: float
    message: str

    @classmethod
    def of(
        cls,
        sweep: str,
        series: str,
        x: float,
        outcomes: Sequence[Outcome],
        *,
        y: float = math.nan,
        limit: Limit = NO_LIMIT,
    ) -> "Cell":
        """Count the trials of a cell."""
        answers = Counter(outcome.answer for outcome in outcomes)
        errors = np.array([outcome.error for outcome in outcomes if not math.isnan(outcome.error)])
        values = np.array([outcome.value for outcome in outcomes if not math.isnan(outcome.value)])
        messages = Counter(" ".join(outcome.message.split()) for outcome in outcomes if outcome.message)
        message = messages.most_common(1)[0][0] if messages else ""
        return cls(
            sweep=sweep,
            series=series,
            x=float(x),
            y=float(y),
            trials=len(outcomes),
            wrong=sum(outcome.wrong for outcome in outcomes),
            silent=sum(outcome.wrong and outcome.answer == "works" for outcome in outcomes),
            works=answers["works"],
            warns=answers["warns"],
            falls_back=answers["falls back"],
            refuses=answers["refuses"],
            # not interpolated: an error may be infinite
            error=float(np.quantile(errors, 0.5, method="nearest")) if errors.size else math.nan,
            error_95=float(np.quantile(errors, 0.95, method="nearest")) if errors.size else math.nan,
            value=float(np.median(values)) if values.size else math.nan,
            constant=limit.constant,
            limit=float(limit.value),
            message=message if len(message) <= LONGEST_MESSAGE else f"{message[:LONGEST_MESSAGE]} ...",
        )

    @property
    def answer(self) -> Answer:
        """The most frequent answer, of equally frequent ones the most careful."""
        counts: Mapping[Answer, int] = {
            "works": self.works,
            "warns": self.warns,
            "falls back": self.falls_back,
            "refuses": self.refuses,
        }
        return max(reversed(ANSWERS), key=counts.__getitem__)

    @property
    def failed_part(self) -> float:
        """Fraction of the trials without a right result: wrong or refused."""
        return (self.wrong + self.refuses) / self.trials


Task = Callable[[], list[Cell]]
"""Measures some cells of a topic."""


@dataclass(frozen=True)
class Sweep:
    """A swept variable: a cell for each of its values, by the trials that ``measure`` makes at a value."""

    name: str
    series: str
    values: Sequence[float]
    measure: Callable[[float], Sequence[Outcome]]
    limit: Limit = NO_LIMIT
    y: float = math.nan

    def tasks(self) -> Iterator[Task]:
        """A measurement for each value."""
        for value in self.values:
            yield partial(self._cells, value)

    def _cells(self, value: float) -> list[Cell]:
        return [Cell.of(self.name, self.series, value, self.measure(value), y=self.y, limit=self.limit)]
