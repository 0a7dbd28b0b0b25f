"""Sphinx extension: pages that need no network, and no more than they use.

Sphinx links MathJax from a server of its makers. The package sphinx-mathjax-offline holds a copy of it;
this extension puts the parts that a page can ask for beside the pages (2.5 MB of 24 MB). What the theme adds
without use is taken out: icons as scripts (1.5 MB; they are there as fonts too), icons of brands, and the
settings of Thebe, which would run code on a server and come twice, so that browsers report an error.
"""

import re
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


UNUSED = re.compile(
    r"""<script[^>]*src="[^"]*fontawesome[^"]*/js/[^"]*"[^>]*></script>"""
    r"""|<link[^>]*href="[^"]*fontawesome[^"]*/js/[^"]*"[^>]*>"""
    r"""|<link[^>]*href="[^"]*fa-brands[^"]*"[^>]*>"""
    r"""|<script>const THEBE_JS_URL.*?</script>"""
    r"""|<script[^>]*src="[^"]*sphinx-thebe[^"]*"[^>]*></script>""",
    re.DOTALL,
)


def drop_unused(app, error):
    if error is not None or app.builder.format != "html":
        return
    for path in Path(app.outdir).rglob("*.html"):
        page = path.read_text(encoding="utf-8")
        path.write_text(UNUSED.sub("", page), encoding="utf-8")


def setup(app):
    app.config.mathjax_path = "mathjax/" + PARTS[0]
    app.connect("build-finished", copy_mathjax)
    app.connect("build-finished", drop_unused)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
