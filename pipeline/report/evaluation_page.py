"""The page that shows an evaluation: pictures side by side, scores with confidence intervals, and charts."""

import json
import string
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..dataset.check.findings import printable
from ..errors import InputError
from ..evaluation.conditions import Conditions
from ..evaluation.record.evaluation_record import EVALUATION, evaluation_bytes, read_evaluation
from ..files.content import read_content
from ..images.image_check import check_image
from ..progress import Progress
from .check_section import problem_list
from .page import asset, escaped, html_page, page_footer, page_header, property_table
from .thumbnails import (
    PAGE_BYTES,
    Quality,
    fitted,
    limited_picture,
    shrunk,
    sized_picture,
)

LISTS = ("cases", "methods", "rows", "summary", "distribution", "bound", "pictures")
FIGURES = (("figure.png", "Real frames and what the methods make of them"), ("pairs.png", "Pairs of novel poses"))
"""Pictures beside the description, and what they show."""
PARTS = ("real", "segmented", "rendered", "difference")
SCRIPTS = ("elements.js", "slider.js", "table.js", "intervals.js", "evaluation.js")
FIGURE_SHARE = 0.3
"""Largest part of the page's pictures that figures and charts may take before they are reduced."""
FIGURES_AT_ONCE = 6
"""Each may take this part of that."""


@dataclass(frozen=True)
class _Folder:
    """The folder of an evaluation, and which of its pictures cannot be used."""

    root: Path
    problems: list[str]

    def file(self, name: str) -> bytes | None:
        """The content of a file in the folder; ``None``, with an entry in ``problems``, if it cannot be had."""
        try:
            path = (self.root / name).resolve()
            if not path.is_relative_to(self.root.resolve()):
                raise InputError(f"{name}: expected a file in the folder of the evaluation, found one elsewhere")
            return read_content(path, "a picture of the evaluation", name)
        except (InputError, OSError, ValueError, RuntimeError) as error:
            self.problems.append(printable(str(error).replace(f"{self.root.resolve()}/", "")))
            return None


def evaluation_page(root: Path) -> bytes:
    """Make the page.

    What is missing in the evaluation's folder is named on the page.

    Raises
    ------
    InputError
        No evaluation, or one of another format.
    """
    evaluation, folder = read_evaluation(root / EVALUATION), _Folder(root, [])
    content = json.loads(evaluation_bytes(evaluation))
    figures = _figures(folder, evaluation.charts, round(FIGURE_SHARE * PAGE_BYTES))
    names = sorted({entry[part] for entry in content["pictures"] for part in PARTS})
    used = sum(len(figure["uri"]) for figure in figures)
    files = _encoded(folder, names, PAGE_BYTES - used)
    resolved = root.resolve()
    facts = [
        _counted(len(evaluation.cases), "case"),
        _counted(len({(row.case, row.image) for row in evaluation.rows}), "photograph"),
        _counted(len(evaluation.ran), "method"),
        evaluation.conditions.measured,
    ]
    data = {
        **{name: content[name] for name in LISTS},
        "files": files,
        "meanings": content["scores"],
        "figures": figures,
    }
    body = string.Template(asset("evaluation.html")).substitute(
        header=page_header(kind="evaluation", name=resolved.name, facts=[fact for fact in facts if fact]),
        missing=f"<p class='muted'>{escaped(evaluation.missing)}</p>" if evaluation.missing else "",
        conditions=_conditions(evaluation.conditions),
        problems=problem_list("Not shown on this page", sorted({*folder.problems})),
        footer=page_footer(),
    )
    return html_page(title=f"{resolved.name} · OneFrame evaluation", body=body, data=data, scripts=SCRIPTS)


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'s' * (count != 1)}"


def _encoded(folder: _Folder, names: list[str], most_bytes: int) -> dict[str, dict[str, Any]]:
    """The pictures by name, with the best quality that fits."""

    def encoded(name: str, quality: Quality) -> dict[str, Any] | None:
        image = _decoded(folder, name)
        return None if image is None else sized_picture(shrunk(image, quality.width_px), quality.webp)

    shown = fitted(
        names,
        encoded,
        lambda picture: 0 if picture is None else len(picture["uri"]),
        most_bytes=most_bytes,
        progress=lambda count: Progress(count, "pictures"),
    )
    return {name: picture for name, picture in zip(names, shown, strict=True) if picture}


def _decoded(folder: _Folder, name: str) -> np.ndarray | None:
    """A picture on white, BGR; ``None``, with a problem, if it is missing or damaged."""
    data = folder.file(name)
    if data is None:
        return None
    try:
        check_image(data, name)
    except InputError as error:
        folder.problems.append(str(error))
        return None
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        folder.problems.append(f"{name}: expected a picture, found a damaged one")
    return image


def _figures(folder: _Folder, charts: Sequence[str], most_bytes: int) -> list[dict[str, Any]]:
    """Figures and charts; earlier versions wrote the latter as SVG and for dark pages too."""
    shown = [(name, title) for name, title in FIGURES if (folder.root / name).is_file()]
    for chart in charts:
        stem, _, kind = chart.rpartition(".")
        if kind.lower() == "png" and not stem.endswith("-dark"):
            shown.append((chart, stem.rpartition("/")[2].replace("_", " ").capitalize()))
    images = [(title, _decoded(folder, name)) for name, title in shown]
    most_bytes //= FIGURES_AT_ONCE
    return [{"title": title, **limited_picture(image, most_bytes)} for title, image in images if image is not None]


def _conditions(conditions: Conditions) -> str:
    machine = {"machine": conditions.machine, "measured": conditions.measured}
    tables = [
        property_table([(name, escaped(value)) for name, value in part.items()], caption=caption)
        for caption, part in (
            ("Machine", machine), ("Versions", conditions.versions), ("Configuration", conditions.configuration),
        )
    ]  # fmt: skip
    return f'<div class="columns">{"".join(tables)}</div>'
