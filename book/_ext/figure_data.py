"""Sphinx extension: the numbers behind a figure, to download under its caption.

A notebook keeps the numbers of a figure beside its picture, as an output of type text/csv. They become the
file ``_static/data/NAME.csv`` beside the pages, NAME being that of the figure.
"""

from pathlib import Path

import nbformat
from docutils import nodes


def figures_with_data(path):
    """{name of the figure: its numbers as CSV} of an executed notebook."""
    found = {}
    for cell in nbformat.read(path, as_version=4).cells:
        name = cell.metadata.get("mystnb", {}).get("figure", {}).get("name")
        for output in cell.get("outputs", []):
            if name and "text/csv" in output.get("data", {}):
                found[name] = output.data["text/csv"]
    return found


def link_data(app, doctree):
    """Write the numbers of a page's figures, and add a link to each caption."""
    source = Path(app.env.doc2path(app.env.docname))
    if source.suffix != ".ipynb" or app.builder.format != "html":
        return
    data = figures_with_data(source)
    folder = Path(app.outdir, "_static", "data")
    up = "../" * app.env.docname.count("/")
    for figure in doctree.findall(nodes.figure):
        for name in set(figure["ids"]) & set(data):
            folder.mkdir(parents=True, exist_ok=True)
            (folder / f"{name}.csv").write_text(data[name])
            link = f' <a class="himap-data" href="{up}_static/data/{name}.csv" download>Data (CSV)</a>'
            caption = next(figure.findall(nodes.caption))
            caption.append(nodes.raw("", link, format="html"))


def setup(app):
    app.connect("doctree-read", link_data)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
