"""What messages, tooltips and docs call a button is what stands on it."""

import ast
import re
from functools import cache
from pathlib import Path

from oneframe.dataset.options import OPTIONS

ROOT = Path(__file__).resolve().parents[2]
ADDON, PIPELINE, DOCS = ROOT / "blender_addon", ROOT / "pipeline", ROOT / "docs"
KEYS = {"N", "Home", "Tab", "Esc", "Enter", "Space"}
OTHERS = {"Box Select", "OneFrame", "Off By", "Cancel"}
"""In Blender's toolbar, tabs; a ring in the view; of figures; by turns on a button."""


@cache
def nodes(folder: Path) -> tuple[ast.AST, ...]:
    return tuple(node for path in sorted(folder.rglob("*.py")) for node in ast.walk(ast.parse(path.read_text())))


def literal(node: ast.AST | None) -> str | None:
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


@cache
def texts() -> tuple[str, ...]:
    """All texts of add-on and pipeline, docstrings too: they are tooltips. The parts of an f-string come together."""
    parts, found = set(), []
    for node in (*nodes(ADDON), *nodes(PIPELINE)):
        if isinstance(node, ast.JoinedStr):
            parts |= set(map(id, node.values))
            found.append("".join(literal(each) or "{}" for each in node.values))
        elif (text := literal(node)) is not None and id(node) not in parts:
            found.append(" ".join(text.split()))
    return tuple(found)


@cache
def operator_labels() -> dict[str, str]:
    """Operator -> its label."""
    found = {}
    for node in nodes(ADDON):
        if isinstance(node, ast.ClassDef) and node.name.startswith("ONEFRAME_OT_"):
            label = [
                each.value for each in node.body if isinstance(each, ast.Assign) and each.targets[0].id == "bl_label"
            ]
            found[node.name.replace("ONEFRAME_OT_", "oneframe.")] = literal(label[0])
    return found


@cache
def names() -> set[str]:
    """What stands on buttons, fields and tools, and over panels: the label of an operator where a panel draws it."""
    found, labels = set(), operator_labels()
    for node in nodes(ADDON):
        match node:
            case ast.ClassDef(name=name, body=body) if not name.startswith("ONEFRAME_OT_"):
                for line in body:
                    if isinstance(line, ast.Assign) and line.targets[0].id == "bl_label":
                        label = " ".join((literal(line.value) or "").split())
                        # of a step also without its number
                        found |= {label, label.lstrip("0123456789 ")}
            case ast.Tuple(elts=items) | ast.List(elts=items) | ast.Dict(values=items):
                # items of enums, tools, pairs of buttons
                found |= set(map(literal, items))
            case ast.Call(func=function, args=arguments, keywords=words):
                given = {word.arg: literal(word.value) for word in words}
                first, *others = (*map(literal, arguments), None)
                match getattr(function, "attr", getattr(function, "id", "")):
                    case "operator":
                        found.add(given["text"] if "text" in given else labels.get(first))
                    case "prop":
                        found |= {given.get("text"), *others}
                    case _:
                        found.add(given.get("text"))
    return {each for each in found if each}


def test_a_message_names_buttons_that_exist():
    known = names() | KEYS
    asked = [called for text in texts() for called in re.findall(r"\b[Pp]ress ([A-Z].*)", text)]
    assert len(asked) > 10
    is_known = re.compile("|".join(rf"{re.escape(name)}\b" for name in known if name[-1].isalpha()))
    assert not [called for called in asked if not is_known.match(called)]
    unseen = {label for label in operator_labels().values() if " " in label} - known - OTHERS
    assert not [(label, text) for text in texts() for label in unseen if label in text and label != text]


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
