"""Sphinx extension: what the theme's pages have besides text.

They need no network, and load no more than they use. Sphinx links MathJax from a server of its makers; the
package sphinx-mathjax-offline holds a copy, and the parts of it that a page can ask for are copied to the
pages (2.5 MB of 24 MB). What the theme adds without use is removed: icons as scripts (1.5 MB; there are
fonts of them), icons of brands, and the settings of Thebe, which would run code on a server and come
twice, so that browsers report an error. Results of the search are without the parts of a page that are no
text, by a script that only its page loads.

One setting, ``repository: url`` in ``_config.yml``, turns on the buttons that lead to the source, edit it,
open an issue, and open a notebook in Binder or Colab. While it is empty there are none.
"""

import re
from importlib.util import find_spec
from pathlib import Path

from sphinx.errors import ExtensionError
from sphinx.util.fileutil import copy_asset

PARTS = ("tex-mml-chtml.js", "input/tex/extensions", "output/chtml/fonts/woff-v2")
UNUSED = re.compile(
    r"""<script[^>]*src="[^"]*fontawesome[^"]*/js/[^"]*"[^>]*></script>"""
    r"""|<link[^>]*href="[^"]*fontawesome[^"]*/js/[^"]*"[^>]*>"""
    r"""|<link[^>]*href="[^"]*fa-brands[^"]*"[^>]*>"""
    r"""|<script>const THEBE_JS_URL.*?</script>"""
    r"""|<script[^>]*src="[^"]*sphinx-thebe[^"]*"[^>]*></script>""",
    re.DOTALL,
)
BUTTONS = ("repository", "source", "edit_page", "issues")
LAUNCHERS = {
    "binderhub_url": "https://mybinder.org",
    "colab_url": "https://colab.research.google.com",
    "notebook_interface": "jupyterlab",
}


def turn_on_buttons(app, config):
    options = config.html_theme_options
    if options.get("repository_url"):
        options |= {f"use_{name}_button": True for name in BUTTONS}
        options["launch_buttons"] = LAUNCHERS


def add_search(app, pagename, templatename, context, doctree):
    if pagename == "search":
        app.add_js_file("search.js", loading_method="defer")


def finish(app, error):
    """Copy MathJax 3, of a package whose name has a dash, so it has no import; drop what is unused."""
    if error is not None or app.builder.format != "html":
        return
    spec = find_spec("sphinx-mathjax-offline")
    if spec is None:
        raise ExtensionError("sphinx-mathjax-offline is not installed; run: make setup")
    for part in PARTS:
        source = Path(spec.origin).parent / "static" / "mathjax" / part
        target = Path(app.outdir, "_static", "mathjax", part)
        copy_asset(source, target if source.is_dir() else target.parent)
    for path in Path(app.outdir).rglob("*.html"):
        page = path.read_text(encoding="utf-8")
        path.write_text(UNUSED.sub("", page), encoding="utf-8")


def setup(app):
    app.config.mathjax_path = f"mathjax/{PARTS[0]}"
    app.connect("config-inited", turn_on_buttons, priority=10)  # before the theme reads its options
    app.connect("html-page-context", add_search)
    app.connect("build-finished", finish)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
