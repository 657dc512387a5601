"""The site: ``python -m sphinx -W -b html docs build/site``."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from made import filled  # noqa: E402  (a module beside this file)

from cutbench import __version__  # noqa: E402

project = "cutbench"
author = "cutbench developers"
copyright = author
version = release = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["**/README.md"]
source_suffix = {".md": "markdown"}
root_doc = "index"
highlight_language = "none"
smartquotes = False
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

add_module_names = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
maximum_signature_line_length = 88
autodoc_preserve_defaults = True
autodoc_default_options = {"no-value": True}
python_use_unqualified_type_names = True

# Docstrings have the sections of numpydoc; attributes stand in a list, as some have a text of their own, too.
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False

html_theme = "pydata_sphinx_theme"
html_title = "cutbench"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_copyright = False
html_show_sourcelink = False
html_theme_options = {
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "show_prev_next": True,
    "navbar_align": "left",
    "footer_start": ["sphinx-version"],
    "footer_end": ["theme-version"],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}


def setup(app) -> None:
    """Put what the code says of itself where a page asks for it."""

    def read(app, page: str, source: list[str]) -> None:
        source[0] = filled(source[0])

    def skip(app, what, name, member, skip, options) -> bool | None:
        return True if (getattr(member, "__doc__", "") or "").startswith("Alias for field") else None

    app.connect("source-read", read)
    app.connect("autodoc-skip-member", skip)
