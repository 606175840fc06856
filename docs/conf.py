"""How the site is made: `make docs` runs Sphinx with this."""

import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent
sys.path[:0] = [str(ROOT), str(HERE / "_ext")]

_about = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

project = "Quietfix"
author = "The Quietfix developers"
copyright = author
version = release = _about["version"]

extensions = [
    "block_catalogue",  # of this project, in _ext
    "examples",
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",  # formulas without asking a network
    "sphinx_copybutton",
    "sphinx_design",
]
exclude_patterns = ["_build", "_ext", "catalogue/examples", "**/.ipynb_checkpoints"]
_OTHERS = "numpy np npt xarray xr pydrake pandas scipy matplotlib zarr dask pathlib collections typing types"
nitpick_ignore_regex = [
    # Other projects' names have no page here, and theirs cannot be asked without a network.
    (r"py:.*", rf"({'|'.join(_OTHERS.split())})(\..*)?"),
]

myst_enable_extensions = ["attrs_block", "attrs_inline", "colon_fence", "deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # tests/test_notebooks.py runs them; what they show is kept in them
nb_merge_streams = True

default_role = "code"  # in docstrings; a page in Markdown has none
autodoc_typehints = "none"  # numpydoc says them
autosummary_generate = True
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False

copybutton_prompt_text = "$ "
copybutton_only_copy_prompt_lines = True
copybutton_exclude = ".linenos, .gp, .go"

html_theme = "pydata_sphinx_theme"
html_title = "Quietfix"
html_static_path = ["_static"]
html_css_files = ["quietfix.css", "catalogue.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navigation_with_keys": False,
    "show_prev_next": True,
    "show_toc_level": 2,
    "header_links_before_dropdown": 7,
    "navbar_align": "left",
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
}
html_sidebars = {"index": [], "start": [], "own": []}
html_context = {"default_mode": "auto"}

linkcheck_ignore = [r"https?://.*"]
