"""The page that shows an evaluation: pictures side by side, scores with confidence intervals, and charts."""

import re
import string
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TextIO

import cv2
import numpy as np

from ..errors import InputError
from ..images.image_check import check_image
from ..progress import Progress
from .check_section import problem_list
from .evaluation_folder import EVALUATION, FIGURES, EvaluationFolder, open_evaluation
from .page import asset, escaped, html_page, page_footer, page_header, property_table
from .thumbnails import (
    PAGE_BYTES,
    Quality,
    data_uri,
    fitted,
    limited_picture,
    shrunk,
    sized_picture,
)

PARTS = ("real", "segmented", "rendered", "difference")
SCRIPTS = ("elements.js", "slider.js", "table.js", "intervals.js", "evaluation.js")
FIGURE_SHARE = 0.3
"""Of the page's pictures, the most that figures and charts may take before they are reduced."""
FIGURES_AT_ONCE = 6
"""Each may take this part of that."""
_VIEW_BOX = re.compile(rb'viewBox="[-\d.]+ [-\d.]+ (\d+(?:\.\d+)?) (\d+(?:\.\d+)?)"')
DARK = "-dark"
"""Ends the name of a chart for dark pages."""


def evaluation_page(root: Path, *, most_bytes: int = PAGE_BYTES, stream: TextIO | None = None) -> bytes:
    """Make the page.

    Parameters
    ----------
    root
        The evaluation's folder. What is missing in it is named on the page.
    most_bytes
        Of all pictures together, as text.
    stream
        Stream for the progress.

    Raises
    ------
    InputError
        No evaluation, or one of another format.
    """
    folder = open_evaluation(root)
    methods, cases = folder.rows("methods"), folder.rows("cases")
    figures = _figures(folder, round(FIGURE_SHARE * most_bytes))
    pictures = folder.rows("pictures")
    names = sorted({entry[part] for entry in pictures for part in PARTS if isinstance(entry.get(part), str)})
    used = sum(len(figure[theme]["uri"]) for figure in figures for theme in ("light", "dark") if figure[theme])
    files = _encoded(folder, names, most_bytes - used, stream)
    rows = folder.rows("rows")
    resolved = root.resolve()
    facts = [
        _counted(len(cases), "case"), _counted(len({*_frames(rows)}), "photograph"),
        _counted(sum("skipped" not in method for method in methods), "method"),
        str(folder.content.get("conditions", {}).get("measured") or ""),
    ]  # fmt: skip
    distribution = folder.rows("distribution")
    missing = folder.content.get("missing")
    data = {
        # without their paths, which are of this computer
        "cases": [{"name": case.get("name")} for case in cases],
        "methods": methods,
        "rows": rows,
        "summary": folder.rows("summary"),
        "distribution": distribution,
        "bound": folder.rows("bound"),
        "pictures": [
            {key: entry.get(key) for key in ("case", "image", "method", *PARTS)} for entry in pictures
        ],
        "files": files,
        "meanings": {str(name): str(text) for name, text in folder.content.get("scores", {}).items()},
        "figures": figures,
    }  # fmt: skip
    body = string.Template(asset("evaluation.html")).substitute(
        header=page_header(kind="evaluation", name=resolved.name, facts=[fact for fact in facts if fact]),
        missing="" if not isinstance(missing, str) else f"<p class='muted'>{escaped(missing)}</p>",
        conditions=_conditions(folder.content.get("conditions", {})),
        problems=problem_list("Not shown on this page", sorted({*folder.problems})),
        footer=page_footer(three=False),
    )
    return html_page(title=f"{resolved.name} · OneFrame evaluation", body=body, data=data, scripts=SCRIPTS)


def _frames(rows: list[dict[str, Any]]) -> list[tuple[object, object]]:
    return [(row.get("case"), row.get("image")) for row in rows]


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'s' * (count != 1)}"


def _encoded(
    folder: EvaluationFolder, names: list[str], most_bytes: int, stream: TextIO | None
) -> dict[str, dict[str, Any]]:
    """The pictures by name, with the best quality that fits."""

    def encoded(name: str, quality: Quality) -> dict[str, Any] | None:
        image = _decoded(folder, name)
        return None if image is None else sized_picture(shrunk(image, quality.width_px), quality.webp)

    shown = fitted(
        names,
        encoded,
        lambda picture: 0 if picture is None else len(picture["uri"]),
        most_bytes=most_bytes,
        progress=lambda count: Progress(count, "pictures", stream=stream),
    )
    return {name: picture for name, picture in zip(names, shown, strict=True) if picture}


def _decoded(folder: EvaluationFolder, name: str) -> np.ndarray | None:
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


def _figures(folder: EvaluationFolder, most_bytes: int) -> list[dict[str, Any]]:
    """Figures and charts, each for light and for dark pages where both are there."""
    charts = [(name, "") for name in folder.content.get("charts", [])]
    fixed = [(name, title) for name, title in FIGURES if (folder.root / name).is_file()]
    by_stem: dict[str, dict[str, Any]] = {}
    for name, title in [*fixed, *charts]:
        stem, _, kind = name.rpartition(".")
        theme = "dark" if stem.endswith(DARK) else "light"
        entry = by_stem.setdefault(stem.removesuffix(DARK), {"light": None, "dark": None, "title": title})
        # an SVG is smaller and sharper than the PNG of the same chart
        if entry[theme] is None or kind.lower() == "svg":
            entry[theme] = name
    figures = []
    for stem, entry in by_stem.items():
        title = entry["title"] or stem.rpartition("/")[2].replace("_", " ").replace("-", " ").capitalize()
        shown = {theme: _figure(folder, entry[theme], most_bytes) for theme in ("light", "dark")}
        if shown["light"] or shown["dark"]:
            figures.append({"title": title, **shown})
    return figures


def _figure(folder: EvaluationFolder, name: str | None, most_bytes: int) -> dict[str, Any] | None:
    if name is None:
        return None
    if name.lower().endswith(".svg"):
        data = folder.file(name)
        # as an image, an SVG runs no scripts and loads nothing
        return None if data is None else {"uri": data_uri(data, "image/svg+xml"), **_svg_size(data)}
    image = _decoded(folder, name)
    if image is None:
        return None
    return limited_picture(image, most_bytes // FIGURES_AT_ONCE)


def _svg_size(data: bytes) -> dict[str, float]:
    """Width and height of an SVG by its ``viewBox``; nothing if it has none."""
    found = _VIEW_BOX.search(data[:4096])
    return {} if found is None else {"width": float(found[1]), "height": float(found[2])}


def _conditions(conditions: Mapping[str, Any]) -> str:
    if not conditions:
        return f"<p class='muted'>{EVALUATION} names no conditions.</p>"
    versions, configuration = (conditions.get(name) for name in ("versions", "configuration"))
    rows = [(name, escaped(conditions[name])) for name in ("machine", "measured") if conditions.get(name)]
    tables = [property_table(rows, caption="Machine")]
    for caption, part in (("Versions", versions), ("Configuration", configuration)):
        if isinstance(part, dict) and part:
            tables.append(
                property_table([(str(name), escaped(value)) for name, value in part.items()], caption=caption)
            )
    return f'<div class="columns">{"".join(tables)}</div>'
