"""One HTML file with everything in it: style, scripts, data and pictures.

The page asks for nothing from anywhere. Its content security policy forbids all requests, and allows only the very
scripts and styles that it was written with, by their hashes: text from a dataset cannot become code.
"""

import base64
import hashlib
import html
import json
import string
from collections.abc import Mapping, Sequence
from importlib import resources

from .. import __version__

MARK = "<!DOCTYPE html>\n<!-- OneFrame report -->\n"


def asset(name: str) -> str:
    """The text of a file of the folder ``assets``."""
    return resources.files(__package__).joinpath("assets", name).read_text("utf-8")


def escaped(text: object) -> str:
    """Text of a file for use in HTML, also within quotes."""
    return html.escape(str(text), quote=True)


def spaced(number: int) -> str:
    """A whole number with thin spaces between thousands."""
    return f"{number:,}".replace(",", "\u202f")


def html_page(*, title: str, body: str, data: Mapping[str, object], scripts: Sequence[str]) -> bytes:
    """The content of the file.

    Parameters
    ----------
    title
        Plain text.
    body
        HTML in which :func:`escaped` was applied to everything that comes from files.
    data
        What the scripts show: JSON types, finite numbers only.
    scripts
        Names of assets that share one scope, in their order.
    """
    style = asset("report.css")
    code = "(() => {\n'use strict';\n" + "\n".join(asset(name) for name in scripts) + "\n})();\n"
    policy = (
        f"default-src 'none'; script-src {_source_hash(code)}; style-src {_source_hash(style)}; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )
    text = (
        f'{MARK}<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{escaped(policy)}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        '<meta name="referrer" content="no-referrer">\n'
        f'<meta name="generator" content="OneFrame {escaped(__version__)}">\n'
        f"<title>{escaped(title)}</title>\n<style>{style}</style>\n</head>\n<body>\n{body}\n"
        f'<script type="application/json" id="data">{embedded_json(data)}</script>\n'
        f"<script>{code}</script>\n</body>\n</html>\n"
    )
    return text.encode("utf-8", "replace")


def embedded_json(data: object) -> str:
    """JSON that cannot end the element that it stands in."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _source_hash(block: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(block.encode()).digest()).decode()}'"


def page_header(*, kind: str, name: str, facts: Sequence[str], status: str = "") -> str:
    """The head of a page: what it shows, its name, facts in one line, and a badge (HTML)."""
    line = "".join(f"<li>{escaped(fact)}</li>" for fact in facts)
    return (
        '<a class="skip" href="#main">Skip to the content</a>\n<header class="top"><div class="bar">'
        f'<p class="brand">OneFrame <span>{escaped(kind)}</span></p>'
        '<button id="theme" class="quiet" type="button" aria-label="Switch between light and dark" '
        'title="Switch between light and dark"><span aria-hidden="true">◐</span></button></div>'
        f'<div class="title"><h1>{escaped(name)}</h1>{status}</div><ul class="facts">{line}</ul></header>\n'
        "<noscript><p class='muted'>This page shows its pictures with JavaScript, which is switched off here."
        "</p></noscript>"
    )


def poses_section(noun: str) -> str:
    """The section with the poses; each is that of a ``noun``."""
    return string.Template(asset("poses.html")).substitute(noun=noun).rstrip()


def property_table(rows: Sequence[tuple[str, str]], *, caption: str) -> str:
    """A table of names and values; the values are HTML."""
    body = "".join(f'<tr><th scope="row">{escaped(name)}</th><td>{value}</td></tr>' for name, value in rows)
    return f'<div class="scroll"><table class="properties"><caption>{escaped(caption)}</caption>{body}</table></div>'


def findings(lines: Sequence[str]) -> str:
    """A list of sentences that warn."""
    return '<ul class="findings">' + "".join(f"<li>{escaped(line)}</li>" for line in lines) + "</ul>"


def page_footer() -> str:
    """Where the page comes from."""
    made = f"Made by OneFrame {escaped(__version__)}."
    return f"<footer><p>{made} This file needs no network and sends nothing.</p></footer>"
