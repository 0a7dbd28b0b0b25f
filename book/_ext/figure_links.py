"""Sphinx extension: under each caption of a notebook the numbers of the figure and the notebook, to download,
and the command that makes it again. Stored pictures that a notebook shows lead to themselves in full size.

The numbers become the file ``_static/data/NAME.csv`` or ``.npz`` beside the pages, NAME being that of the
figure.
"""

from pathlib import Path

from docutils import nodes
from sphinx import addnodes

from himap.companion.figures import figures


def add_links(app, doctree):
    """Write the numbers of a page's figures, and the line under each caption."""
    source = Path(app.env.doc2path(app.env.docname))
    if source.suffix != ".ipynb" or app.builder.format != "html":
        return
    there = {figure.name: figure for figure in figures(source)}
    up = "../" * app.env.docname.count("/")
    for node in doctree.findall(nodes.figure):
        for name in set(node["ids"]) & set(there):
            _write(there[name], Path(app.outdir, "_static", "data"))
            line = _line(there[name], up, app.env.docname)
            next(node.findall(nodes.caption)).append(nodes.raw("", line, format="html"))
    for node in list(doctree.findall(addnodes.download_reference)):
        for picture in node.findall(nodes.image):
            picture["width"] = "100%"  # Sphinx links what it scales
            node.replace_self(picture)


def _write(figure, folder):
    folder.mkdir(parents=True, exist_ok=True)
    for ending, content in figure.data.items():
        (folder / f"{figure.name}.{ending}").write_bytes(content)


def _line(figure, up, docname):
    links = [
        f'<a href="{up}_static/data/{figure.name}.{ending}" download>Data ({ending.upper()})</a>'
        for ending in figure.data
    ]
    links.append(f'<a href="{up}_sources/{docname}.ipynb" download>Notebook</a>')
    links.append(f"<code>himap run {figure.notebook}</code>")
    return f'<span class="himap-links">{" · ".join(links)}</span>'


def setup(app):
    app.connect("doctree-read", add_links)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
