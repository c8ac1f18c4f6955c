"""Sphinx builds the site from this directory, without a network: `make docs`."""

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent)]
os.environ.setdefault("MPLBACKEND", "agg")

from mjsheaf import __version__  # noqa: E402 - the path comes first

project = "mjsheaf"
copyright = "the authors of mjsheaf, Apache 2.0"
version = release = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
    "mathml",
    "generated",
]
exclude_patterns = ["generated/*_fields.md", "**/README*", "examples/*.ipynb", "examples/*.py", "examples/*.zip"]

myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
smartquotes = False  # `--set` is an option, not a dash
myst_heading_anchors = 3
myst_dmath_allow_labels = True
suppress_warnings = ["myst.strikethrough"]

default_role = "code"  # a name between single backquotes, as docstrings have it

html_theme = "furo"
html_title = f"mjsheaf {version}"
html_static_path = ["_static"]
EXTRA = HERE / "generated" / "extra"  # replays and pictures of scenarios, which are made as the build begins
EXTRA.mkdir(parents=True, exist_ok=True)
html_extra_path = ["generated/extra"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_math_renderer = "mathml"
pygments_style = "friendly"
pygments_dark_style = "monokai"

copybutton_prompt_text = "$ "
copybutton_exclude = ".linenos, .gp, .go"

autodoc_typehints = "none"  # docstrings give shapes and units
autodoc_member_order = "bysource"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

sphinx_gallery_conf = {
    "examples_dirs": str(HERE.parent / "examples"),
    "gallery_dirs": "examples",
    "filename_pattern": os.environ.get("EXAMPLES") or r"\.py$",
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 1e9,  # s: times of one machine say nothing
    "plot_gallery": True,
    "reset_modules": ("matplotlib",),
    "backreferences_dir": None,
}


def _plain(app, what, name, obj, options, lines):
    """Docstrings are plain text: |e| and q* are no markup."""
    lines[:] = [line.replace("|", r"\|").replace("*", r"\*") if "``" not in line else line for line in lines]


def setup(app):
    """Take docstrings as they are, before napoleon reads their sections."""
    app.connect("autodoc-process-docstring", _plain, priority=100)
