"""How Sphinx builds the site: Markdown pages, and the reference of the pipeline from its docstrings, not imported."""

import re
import sys
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.ext.napoleon import Config, NumpyDocstring

ROOT = Path(__file__).resolve().parents[1]

sys.path.insert(0, str(ROOT / "scripts"))
from oneframe import __version__

project = "OneFrame"
version = release = __version__
author = copyright = "The OneFrame developers"
extensions = ["myst_parser", "autoapi.extension", "sphinx_copybutton"]
exclude_patterns = ["img"]

html_theme = "furo"
html_title = "OneFrame"
html_copy_source = False
html_show_sphinx = False

myst_heading_anchors = 3

autoapi_dirs = [str(ROOT / "scripts" / "dev" / "mypy-path" / "oneframe")]
autoapi_root = "reference"
autoapi_add_toctree_entry = False
autoapi_options = ["members", "undoc-members", "show-module-summary"]
autoapi_member_order = "bysource"
autoapi_python_class_content = "class"
autoapi_keep_files = False
# it finds them all the same, once the module that they stand in has been read
suppress_warnings = ["autoapi.python_import_resolution"]

# every role in a docstring leads to something of the pipeline, but for what autoapi does not list: other packages,
# constants of one assignment to two names, and types in signatures under the name of another module that imports them
nitpicky = True
nitpick_ignore_regex = [
    (
        "py:.*",
        r"\.?(argparse|bpy|collections|contextlib|cv2|distributed|json|mathutils|numpy|pathlib|struct|tempfile|tomllib|types)(\..*)?",
    ),
    ("py:data", r"\.?[A-Z_]+"),
    ("py:meth", r"\w+"),
    ("py:class", r"oneframe\..*"),
]

NAPOLEON = Config(napoleon_use_ivar=True, napoleon_use_rtype=False)
LITERAL = re.compile(r"(``.*?``|`.*?`)", re.DOTALL)
RESULT = re.compile(r"^(?P<kind>Returns|Yields)\n-+\n(?P<text>.+?)(?=\n\n\w+\n---|\Z)", re.MULTILINE | re.DOTALL)
BARE_ROLE = re.compile(r"(?!:meth:`\w+`)(:\w+:`)(?=[A-Za-z_])(?!oneframe\b)")
"""A role with a name alone: with a leading dot, Sphinx looks for it here first, then anywhere. Not so
a method without its class: many have the same name."""
TWO_NAMES = re.compile(r"^(?P<names>\w+(?:, \w+)+)\n(?P<text>(?: +\S.*(?:\n|\Z))+)", re.MULTILINE)
"""The field of two or more attributes or parameters in a numpydoc section, with the text that they share."""


def rst_from_numpydoc(_app: Sphinx, what: str, _name: str, _object: object, _options: object, lines: list[str]) -> None:
    """Change the lines of a docstring in place.

    Of numpydoc, this project has sections only where they belong, and results as prose. Bars stand around norms; to
    reStructuredText they would be substitutions.
    """
    text = "".join(
        part if part.startswith("`") else part.replace("|", r"\|") for part in LITERAL.split("\n".join(lines))
    )
    text = BARE_ROLE.sub(r"\1.", text)
    if what in ("module", "package", "class", "exception", "function", "method"):
        results = [_field(section) for section in RESULT.finditer(text)]
        text = TWO_NAMES.sub(_one_name_each, RESULT.sub("", text))
        text = "\n".join([str(NumpyDocstring(text, NAPOLEON, what=what)).rstrip(), "", *results, ""])
    lines[:] = text.splitlines()


def _one_name_each(field: re.Match) -> str:
    return "".join(f"{name}\n{field['text']}" for name in field["names"].split(", "))


def _field(section: re.Match) -> str:
    text = section["text"].strip().replace("\n", "\n    ")
    return f":{section['kind'].lower()}: {text}"


def setup(app: Sphinx) -> None:
    app.connect("autodoc-process-docstring", rst_from_numpydoc)
