"""How Sphinx builds the site: Markdown pages, and the reference of the pipeline from its docstrings, not imported."""

import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parents[1]

sys.path.insert(0, str(ROOT))
from pipeline import __version__

project = "OneFrame"
version = release = __version__
author = "The OneFrame developers"
extensions = ["myst_parser", "sphinx.ext.napoleon", "autoapi.extension", "sphinx_copybutton"]
exclude_patterns = ["img"]
# found, but only once the module that it stands in has been read
suppress_warnings = ["autoapi.python_import_resolution"]

html_theme = "furo"
html_title = "OneFrame"
html_copy_source = False
html_show_sphinx = False

myst_heading_anchors = 3

autoapi_dirs = [str(ROOT / "pipeline")]
autoapi_root = "reference"
autoapi_add_toctree_entry = False
autoapi_options = ["members", "undoc-members", "show-module-summary"]
autoapi_member_order = "bysource"
autoapi_python_class_content = "class"
autoapi_keep_files = False

napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False


_LITERAL = re.compile(r"(``.*?``|`.*?`)", re.DOTALL)
_TWO_NAMES = re.compile(r"^(?P<names>\w+(?:, \w+)+)\n(?P<text>(?: +\S.*(?:\n|\Z))+)", re.MULTILINE)
"""The field of two or more attributes or parameters in a numpydoc section, with the text that they share."""


def prepare_docstring(
    _app: Sphinx, _what: str, _name: str, _object: object, _options: object, lines: list[str]
) -> None:
    """Change a docstring's lines in place: bars around a norm are no substitution, ``a, b`` are two attributes."""
    text = "".join(
        part if part.startswith("`") else part.replace("|", r"\|") for part in _LITERAL.split("\n".join(lines))
    )
    lines[:] = _TWO_NAMES.sub(_one_name_each, text).splitlines()


def _one_name_each(field: re.Match) -> str:
    return "".join(f"{name}\n{field['text']}" for name in field["names"].split(", "))


def setup(app: Sphinx) -> None:
    # before napoleon, whose priority is 500
    app.connect("autodoc-process-docstring", prepare_docstring, priority=400)
