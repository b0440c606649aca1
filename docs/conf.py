"""Settings of Sphinx; `make docs` builds the site. CONTRIBUTING.md says why these tools."""

import sys
from pathlib import Path

from sphinx.application import Sphinx

import emsid

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

suppress_warnings = ["ref.python"]  # `name` in a docstring may be an argument, not one of many attributes
project, author, version = "emsid", "the emsid developers", emsid.__version__
copyright = "the emsid developers; BSD-3-Clause"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "executed",  # runs what the pages show
    "generated",  # pages made from the program: command line, findings
    "mathml",
]
exclude_patterns = ["_extensions"]
myst_enable_extensions = ["dollarmath", "deflist", "attrs_inline", "colon_fence"]
myst_heading_anchors = 3

default_role = "py:obj"  # `x` in a docstring
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # signatures on a phone; docstrings say shapes and units
autodoc_default_options = {
    "members": True,
    "inherited-members": "object,tuple,int,str,Enum,Protocol,BaseException",
    "show-inheritance": False,
}
python_use_unqualified_type_names = True
napoleon_use_rtype = False
napoleon_use_ivar = True  # attributes as a list, not each as an object
add_module_names = False

smartquotes = False  # "--fix" in a sentence is an option, not a dash

html_theme = "pydata_sphinx_theme"
html_title = f"emsid {version}"
html_static_path = ["_static"]
html_css_files = ["emsid.css"]
html_math_renderer = "mathml"
html_show_sourcelink = False
html_copy_source = False
html_show_sphinx = False
html_permalinks_icon = "#"
# Pages without a section have no list of its pages.
html_sidebars = {page: [] for page in ("start", "accuracy", "from-matlab", "coming-from", "glossary", "cite")}
html_theme_options = {
    "logo": {"text": "emsid"},
    "navbar_end": ["theme-switcher"],
    "navigation_depth": 2,
    "show_nav_level": 1,
    "header_links_before_dropdown": 6,
    "secondary_sidebar_items": {"reference/**": ["page-toc"], "glossary": ["page-toc"]},
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}


def readable(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Read |x| as an absolute value, and an indented block of a module as an equation with its line breaks."""
    if what == "module":
        for k in range(len(lines) - 1, 0, -1):
            begins = lines[k].startswith("    ") and not lines[k - 1].strip()
            before = next((line for line in reversed(lines[:k]) if line.strip()), "")
            if begins and not before.startswith((" ", "=", "-")) and not before.endswith("::"):
                lines[k:k] = ["::", ""]
    if what == "property" and ": " in lines[0]:  # otherwise read as the type of the property
        lines[0] = lines[0].replace(": ", " – ", 1)
    literal = False
    for k, line in enumerate(lines):
        if literal and line.strip() and not line.startswith("    "):
            literal = False
        if not literal:
            parts = line.split("``")
            lines[k] = "``".join(part if j % 2 else part.replace("|", "\\|") for j, part in enumerate(parts))
        literal = literal or (what == "module" and line.endswith("::"))


def skip_fields(app: Sphinx, what: str, name: str, thing: object, skip: bool, options: object) -> bool | None:
    """Fields of a named tuple stand in its docstring."""
    return True if type(thing).__name__ == "_tuplegetter" else None


def setup(app: Sphinx) -> None:
    """Connect with autodoc."""
    app.connect("autodoc-process-docstring", readable, priority=400)  # before napoleon
    app.connect("autodoc-skip-member", skip_fields)
