"""Sphinx: `make docs` builds the site into docs/_build/html; warnings are errors, code cells run where they changed."""

from __future__ import annotations

import hashlib
import os
import sys
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

import pliant
from pliant.version import __version__

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project = "pliant"
author = "The pliant developers"
copyright = author  # noqa: A001
version = release = __version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml", "reference"]
html_math_renderer = "mathml"
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"pliant {__version__}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False

myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 3

source = sorted(Path(pliant.__file__).parent.rglob("*.py"))
digest = hashlib.sha256(b"".join(path.read_bytes() for path in source)).hexdigest()[:12]
nb_execution_mode = "cache"  # a page runs again when its code or any line of pliant changes
nb_execution_cache_path = str(Path(__file__).parent / "_build" / f"executed-{digest}")
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_merge_streams = True

# figures that code cells return are drawn: sharp, and of the size that the code states
profile = Path(__file__).parent / "_build" / "ipython" / "profile_default"
profile.mkdir(parents=True, exist_ok=True)
(profile / "ipython_kernel_config.py").write_text("""
c.IPKernelApp.matplotlib = "inline"
c.InlineBackend.figure_formats = {"retina"}
c.InlineBackend.print_figure_kwargs = {"bbox_inches": None}
""", encoding="utf-8")
os.environ["IPYTHONDIR"] = str(profile.parent)

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
napoleon_google_docstring = False
napoleon_use_rtype = False
nitpicky = True
nitpick_ignore_regex = [(r"py:(class|obj|exc|data)", r".*")]  # types are words; other packages' need a network


def check_figures(app: Sphinx, failure: Exception | None) -> None:
    """Fail where a page shows the words <Figure size ...> in place of a figure."""
    pages = [] if failure else [p for p in sorted(Path(app.outdir).glob("*.html"))
                                if "&lt;Figure size" in p.read_text(encoding="utf-8")]  # fmt: skip
    if pages:
        raise ExtensionError(f"figures are not drawn on: {', '.join(p.stem for p in pages)}")


def setup(app: Sphinx) -> None:
    app.connect("build-finished", check_figures)
