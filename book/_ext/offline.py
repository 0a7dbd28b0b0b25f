"""Sphinx extension: equations that render without network.

Sphinx links MathJax from a server of its makers. The package sphinx-mathjax-offline holds a copy of it;
this extension puts the parts that a page can ask for beside the pages (2.5 MB of 24 MB).
"""

from importlib.util import find_spec
from pathlib import Path

from sphinx.errors import ExtensionError
from sphinx.util.fileutil import copy_asset

PARTS = ("tex-mml-chtml.js", "input/tex/extensions", "output/chtml/fonts/woff-v2")


def mathjax_folder():
    """The folder of MathJax 3 in the installed package (whose name has a dash, so it has no import)."""
    spec = find_spec("sphinx-mathjax-offline")
    if spec is None:
        raise ExtensionError("sphinx-mathjax-offline is not installed; run: make setup")
    return Path(spec.origin).parent / "static" / "mathjax"


def copy_mathjax(app, error):
    if error is not None or app.builder.format != "html":
        return
    for part in PARTS:
        source = mathjax_folder() / part
        target = Path(app.outdir, "_static", "mathjax", part)
        copy_asset(source, target if source.is_dir() else target.parent)


def setup(app):
    app.config.mathjax_path = "mathjax/" + PARTS[0]
    app.connect("build-finished", copy_mathjax)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
