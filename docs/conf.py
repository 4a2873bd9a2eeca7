"""How Sphinx builds the site: Markdown pages, and the docstrings of what is public."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts"))
from oneframe import __version__

project = "OneFrame"
version = release = __version__
author = copyright = "The OneFrame developers"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
exclude_patterns = ["img"]

html_theme = "furo"
html_title = "OneFrame"
html_copy_source = False
html_show_sphinx = False

myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
# Of numpydoc, this project has results as prose.
napoleon_use_rtype = False
napoleon_use_ivar = True
