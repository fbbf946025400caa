"""Sphinx: the site of sinan, from the pages of this folder and from what `docs/make` writes out of the code."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE / "make")]

project = "sinan"
author = "the authors of sinan"
extensions = ["myst_parser", "generated", "mathml"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build", "make", "notebooks/*.py"]
nitpicky = True

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist", "attrs_block"]
myst_heading_anchors = 4
myst_dmath_double_inline = True
suppress_warnings = ["toc.not_included"]  # a page that others link to need not be in the list at the side

html_theme = "furo"
html_title = "sinan"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False
pygments_style = "friendly"
pygments_dark_style = "native"
highlight_language = "none"
html_show_copyright = False
