"""Where a dataset comes from: the content of ``dataset.json``, as HTML."""

import json
import math
from collections.abc import Mapping
from typing import Any

from ..dataset.dataset_file import Description
from .page import escaped, property_table

LONGEST = 200
"""Characters of a value."""


def part_of(content: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """A table of ``dataset.json``, empty if it is no table."""
    value = content.get(name)
    return value if isinstance(value, dict) else {}


def provenance_section(description: Description) -> str:
    """The content of the section: run, options, cameras, and hashes of the inputs."""
    given = description.content
    run = [(name, _value(value)) for name, value in part_of(given, "versions").items()]
    run += [("views", _value(given.get("count"))), ("surface", _value(given.get("object")))]
    run += [("units", f"{_value(given.get('mm_per_unit'))} mm"), ("conventions", _value(given.get("conventions")))]
    run += [("identity", _hash(description.identity))]
    options = [(name, _value(value)) for name, value in part_of(given, "options").items()]
    hashes = [(name, _hash(value)) for name, value in part_of(given, "inputs_sha256").items()]
    hashes += [("geometry", _hash(given.get("geometry_sha256")))]
    if "poses_sha256" in given:
        hashes.append(("listed poses", _hash(given["poses_sha256"])))
    structures = [(name, _swatch(colour)) for name, colour in part_of(given, "structures").items()]
    tables = [
        property_table(run, caption="Run"),
        property_table(options, caption="Options"),
        property_table(_camera(part_of(given, "camera")), caption="Camera of the views"),
        property_table(_camera(part_of(given, "frame")), caption="Camera of the source frame"),
        property_table(hashes, caption="SHA-256 of the inputs"),
    ]
    if structures:
        tables.append(property_table(structures, caption="Structures"))
    return f'<div class="columns">{"".join(tables)}</div>'


def _camera(given: Mapping[str, Any]) -> list[tuple[str, str]]:
    names = ("fx", "fy", "cx", "cy")
    rows = [("size", f"{_value(given.get('width'))} × {_value(given.get('height'))} px")]
    rows += [(name, f"{_value(given.get(name))} px") for name in names]
    if "distortion" in given:
        rows.append(("distortion", _value(given["distortion"])))
    return rows


def _value(value: object) -> str:
    if value is None:
        return "<span class='muted'>none</span>"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float) and math.isfinite(value):
        return escaped(f"{value:.10g}")
    text = value if isinstance(value, str) else json.dumps(value)
    return escaped(text if len(text) <= LONGEST else text[: LONGEST - 1] + "…")


def _hash(value: object) -> str:
    return f'<code class="hash">{_value(value)}</code>'


def _swatch(colour: object) -> str:
    """A square of the colour; an SVG's attribute, which the page's policy allows, unlike a style."""
    if not (isinstance(colour, list) and len(colour) == 3 and all(isinstance(part, int | float) for part in colour)):
        return _value(colour)
    code = "#" + "".join(f"{round(255 * min(max(part, 0), 1)):02x}" for part in colour)
    return (
        f'<svg class="swatch" viewBox="0 0 1 1" aria-hidden="true"><rect width="1" height="1" fill="{code}"/></svg> '
        f"<code>{code}</code>"
    )
