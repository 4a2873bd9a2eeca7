"""One HTML file with everything in it: style, script, data and pictures.

The page asks for nothing from anywhere. Its content security policy forbids all requests, and allows only the very
script and style that it was written with, by their hashes: text from a dataset cannot become code.
"""

import base64
import hashlib
import html
import json
import string
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import resources

import cv2
import numpy as np

from .. import __version__
from ..errors import printable


@dataclass(frozen=True)
class Column:
    """A figure of each item: its key, its name, what it means; ``digits`` and ``unit`` of a number."""

    key: str
    name: str
    about: str
    digits: int | None = None
    unit: str = ""

    def data(self) -> dict[str, object]:
        """For the page."""
        given: dict[str, object] = {"key": self.key, "name": self.name, "about": self.about, "unit": self.unit}
        return given if self.digits is None else given | {"digits": self.digits}


@dataclass(frozen=True)
class Item:
    """What has a place in the grid.

    Attributes
    ----------
    name, note, state
        Plain text; the note is a sentence, the state one of the page's.
    pictures
        WebP, one for each layer of the page; ``None`` where there is none.
    figures
        By the keys of the columns: finite numbers and texts.
    """

    name: str
    pictures: tuple[bytes | None, ...]
    figures: dict[str, float | str] = field(default_factory=dict)
    note: str = ""
    state: str = ""

    def data(self) -> dict[str, object]:
        """For the page."""
        pictures = [None if each is None else base64.b64encode(each).decode() for each in self.pictures]
        words = {"name": self.name, "note": self.note, "state": self.state}
        return {"pictures": pictures, **{key: printable(text) for key, text in words.items()}, **self.figures}


def escaped(text: object) -> str:
    """Text of a file for use in HTML, also within quotes."""
    return html.escape(printable(str(text)), quote=True)


def html_page(
    title: str,
    kind: str,
    facts: Sequence[str],
    columns: Sequence[Column],
    items: Sequence[Item],
    *,
    layers: Sequence[str],
    sections: Sequence[tuple[str, str]],
) -> bytes:
    """The content of the file.

    Parameters
    ----------
    title, kind, facts
        Plain text: what is shown, what that is, and figures of it in one line.
    columns, items
        What the grid holds.
    layers
        Names of the pictures of an item.
    sections
        Headings (plain text) and contents (HTML: :func:`escaped` was applied to everything that comes from files).
    """
    style, code = _asset("page.css"), "(() => {\n'use strict';\n" + _asset("page.js") + "})();\n"
    policy = (
        f"default-src 'none'; script-src {_source_hash(code)}; style-src {_source_hash(style)}; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )
    data = {
        "columns": [column.data() for column in columns],
        "items": [item.data() for item in items],
        "layers": layers,
        "states": list(dict.fromkeys(item.state for item in items if item.state)),
    }
    text = string.Template(_asset("page.html")).substitute(
        policy=escaped(policy),
        version=escaped(__version__),
        title=escaped(title),
        kind=escaped(kind),
        style=style,
        script=code,
        facts="".join(f"<li>{escaped(fact)}</li>" for fact in facts),
        sections="\n".join(
            f'<section class="card"><h2>{escaped(name)}</h2>{content}</section>' for name, content in sections
        ),
        data=_embedded_json(data),
    )
    return text.encode("utf-8", "replace")


def _asset(name: str) -> str:
    return resources.files(__package__).joinpath("assets", name).read_text("utf-8")


def _embedded_json(data: object) -> str:
    """JSON that cannot end the element that it stands in."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _source_hash(block: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(block.encode()).digest()).decode()}'"


def lines_of(lines: Sequence[str]) -> str:
    """Sentences as a list."""
    return '<ul class="lines">' + "".join(f"<li>{escaped(line)}</li>" for line in lines) + "</ul>" if lines else ""


def picture_of(data: bytes, alt: str) -> str:
    """A WebP as an element."""
    return f'<img class="wide" alt="{escaped(alt)}" src="data:image/webp;base64,{base64.b64encode(data).decode()}">'


def webp(image: np.ndarray, width_px: int, quality: int) -> bytes:
    """``(H, W, 3)`` uint8 in OpenCV's order (BGR), reduced to a width by averaging over areas, as WebP."""
    height, width = image.shape[:2]
    if width > width_px:
        size = width_px, max(1, round(height * width_px / width))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".webp", image, [cv2.IMWRITE_WEBP_QUALITY, quality])[1].tobytes()
