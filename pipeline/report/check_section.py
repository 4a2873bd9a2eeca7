"""What the checker found, and what the page itself could not read, as HTML."""

from collections.abc import Sequence

import numpy as np

from ..dataset.check.check_dataset import CheckReport
from ..files.numbers import format_two_digits
from .page import escaped, spaced

MOST_PROBLEMS = 50
"""Lines of what could not be read; the rest is counted."""


def badge(check: CheckReport | None) -> str:
    """One mark beside the name."""
    if check is None:
        return '<a class="badge unknown" href="#check">not checked</a>'
    if count := len(check.findings):
        return f'<a class="badge bad" href="#check"><span aria-hidden="true">!</span> {_number(count, "finding")}</a>'
    return '<a class="badge good" href="#check"><span aria-hidden="true">✓</span> complete and consistent</a>'


def check_section(check: CheckReport | None, problems: Sequence[str]) -> str:
    """The content of the section."""
    if check is None:
        parts = ["<p class='muted'>The dataset was not checked for this page. <code>oneframe check</code> does it.</p>"]
    elif check.findings:
        parts = [f"<p class='lead bad'>Not complete and consistent: {_number(len(check.findings), 'finding')}.</p>"]
        parts += [_list(kind, messages, check.findings.counts[kind]) for kind, messages in check.findings.first.items()]
    else:
        parts = ["<p class='lead good'>Complete and consistent.</p>", _figures(check)]
    parts.append(problem_list("Not shown on this page", problems))
    return "\n".join(parts)


def problem_list(title: str, problems: Sequence[str]) -> str:
    """A list with a title, of :data:`MOST_PROBLEMS` at most; nothing if it is empty."""
    return _list(title, problems[:MOST_PROBLEMS], len(problems)) if problems else ""


def _figures(check: CheckReport) -> str:
    figures = [(spaced(check.hashed), "files with the right hash")]
    pixels = sum(view.compared for view in check.compared)
    figures.append((str(len(check.compared)), "views compared pixel by pixel"))
    if pixels:
        agreeing = sum(view.agreeing for view in check.compared) / pixels
        dz = np.median([view.median_dz_mm for view in check.compared if view.compared])
        shift = max(float(np.hypot(*view.shift_px)) for view in check.compared)
        figures += [
            (f"{agreeing:.2%}", "of the depth agrees with the projected model"),
            (f"{format_two_digits(float(dz))} mm", "median difference of depth"),
            (f"{format_two_digits(shift)} px", "largest shift of a view"),
        ]
    tiles = "".join(f"<li><strong>{escaped(value)}</strong> {escaped(name)}</li>" for value, name in figures)
    return f'<ul class="tiles">{tiles}</ul>'


def _list(kind: str, messages: Sequence[str], count: int) -> str:
    items = "".join(f"<li>{escaped(message)}</li>" for message in messages)
    more = count - len(messages)
    rest = f"<p class='muted'>and {more} more</p>" if more > 0 else ""
    title = escaped(kind[:1].upper() + kind[1:])
    return f'<h3>{title} <span class="count">{count}</span></h3><ul class="findings">{items}</ul>{rest}'


def _number(count: int, noun: str) -> str:
    return f"{count} {noun}{'s' * (count != 1)}"
