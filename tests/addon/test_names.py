"""What messages, tooltips and docs call a button is a text of the window."""

import ast
import re
from functools import cache
from pathlib import Path

from oneframe.dataset.options import OPTIONS

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
KEYS = {"N", "Home", "Tab", "Esc", "Enter", "Space"}
OTHERS = {"Box Select", "OneFrame", "Off By", "Cancel"}
"""In Blender's toolbar, tabs; a ring in the view; of figures; by turns on a button."""


@cache
def literals(folder: str) -> set[str]:
    """All texts of a part of the code, docstrings too: they are tooltips."""
    nodes = (node for path in (ROOT / folder).rglob("*.py") for node in ast.walk(ast.parse(path.read_text())))
    values = (node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str))
    return {" ".join(value.split()) for value in values}


@cache
def names() -> set[str]:
    """What may stand on buttons, fields, tools and over panels; of a step also without its number."""
    short = {text for text in literals("blender_addon") if text[:1].isupper() or text[:1].isdigit()}
    return {name for text in short if len(text) < 40 for name in (text, text.lstrip("0123456789 ")) if name}


def test_a_message_names_buttons_that_exist():
    texts = literals("blender_addon") | literals("pipeline")
    asked = [(text, called) for text in texts for called in re.findall(r"\b[Pp]ress ([A-Z].*)", text)]
    assert len(asked) > 10
    known = {name for name in names() | KEYS if name[-1].isalpha()}
    is_known = {text: re.compile("|".join(rf"{re.escape(name)}\b" for name in known - {text})) for text, _ in asked}
    assert not [called for text, called in asked if not is_known[text].match(called)]


def test_docs_name_what_is_there():
    known = names() | OTHERS | {option.label for option in OPTIONS.values()}
    pages = {page: (DOCS / page).read_text() for page in ("aligning.md", "first-session.md")}
    called = [
        (page, name) for page, text in pages.items() for name in re.findall(r"(?<!\*)\*([A-Z][^*›]+)\*(?!\*)", text)
    ]
    steps = [
        (page.name, step)
        for page in DOCS.glob("*.md")
        for step in re.findall(r"\*\*(\d [A-Z][\w ]+)", page.read_text())
    ]
    assert len(called) > 50
    assert len(steps) > 3
    assert not [(page, name) for page, name in called + steps if " ".join(name.split()) not in known]
