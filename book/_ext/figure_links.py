"""Sphinx extension: what every figure of a notebook comes with. A text in place of the picture, from its
caption; below the caption its numbers, its notebook, the command that makes it again, a link that stays, how
to cite it, and the numbers at the paper's size where they are stored.

The numbers become the file ``_static/data/NAME.csv`` or ``.npz`` with the pages, NAME being that of the
figure; those of the paper's size ``_static/data/FOLDER.json``.

``{gallery} paper`` has thumbnails of the figures of the paper that lead to them, ``{gallery} chapters`` those
of all figures, chapter by chapter.
"""

import html
import io
import shutil
from functools import cache
from pathlib import Path

import yaml
from docutils import nodes
from PIL import Image
from sphinx import addnodes
from sphinx.util.docutils import SphinxDirective

from himap.app.notebook_files import STAMP, figure_order, figures, plain_caption, read_notebook
from himap.app.notebooks import notebooks
from himap.app.stored import stored_figures

PAPER = "Gkogkou et al. (2025), arXiv:2511.13328"
WIDTH = 320  # pixels of a thumbnail: sharp at the 160 of the page on a fine screen


def describe(app, doctree):
    """Give every picture a text, and show stored ones as wide as the page."""
    there = _figures(app.env.doc2path(app.env.docname))
    for node in doctree.findall(nodes.figure):
        for name in set(node["ids"]) & set(there):
            for picture in node.findall(nodes.image):
                picture["alt"] = plain_caption(there[name].caption)
    for node in list(doctree.findall(addnodes.download_reference)):
        for picture in node.findall(nodes.image):
            picture["width"] = "100%"  # Sphinx links what it scales
            node.replace_self(picture)


def add_links(app, doctree, docname):
    """Write the numbers of a page's figures, and the lines under each caption."""
    if app.builder.format != "html":
        return
    there = _figures(app.env.doc2path(docname))
    folder = Path(app.outdir, "_static", "data")
    for node in doctree.findall(nodes.figure):
        for name in set(node["ids"]) & set(there):
            figure = there[name]
            folder.mkdir(parents=True, exist_ok=True)
            for ending, content in figure.data.items():
                (folder / f"{name}.{ending}").write_bytes(content)
            results = Path(app.srcdir, "book", "results")
            stored = [one for one, rows in _stored_figures(results).items() if name in rows]
            for one in stored:
                shutil.copy(results / one / "figures.json", folder / f"{one}.json")
            line = _line(figure, "../" * docname.count("/"), docname, stored)
            text = line + _citation(app, docname, figure)
            node.append(nodes.legend("", _raw(text)))


_stored_figures = cache(stored_figures)


@cache
def _figures(path):
    """{name: `Figure`} of the notebook at `path`; none of a page that is no notebook."""
    return {one.name: one for one in figures(path)} if Path(path).suffix == ".ipynb" else {}


def _line(figure, up, docname, folders):
    """What there is to download, the command and the link."""
    data = f"{up}_static/data"
    links = [
        f'<a href="{data}/{figure.name}.{ending}" download>Data ({ending.upper()})</a>'
        for ending in figure.data
    ]
    links.append(f'<a href="{up}_sources/{docname}.ipynb" download>Notebook</a>')
    links.append(f"<code>himap run {figure.notebook}</code>")
    links.append(f'<a class="himap-permalink" href="#{figure.name}">Link to this figure</a>')
    links += [
        f'<a href="{data}/{name}.json" download>{_said(name)} (JSON)</a>' for name in folders if figure.data
    ]
    return f'<div class="himap-links">{" · ".join(links)}</div>'


def _said(folder):
    """``paper_templates`` in words."""
    galaxy = folder.partition("_")[2]
    return f"At the paper’s size, {'real' if galaxy == 'templates' else galaxy} Galaxy"


def _citation(app, docname, figure):
    """How to cite the figure, folded; the script of the page puts its address where it has one."""
    number = app.env.toc_fignumbers.get(docname, {}).get("figure", {}).get(figure.name, ())
    book, execution = _book(app.srcdir), _execution(app.env.doc2path(docname))
    authors = ", ".join(one["name"] for one in book["authors"])
    after = f" After Fig. {figure.paper} of {PAPER}." if figure.paper else ""
    text = (
        f"{authors}: “{app.env.titles[docname].astext()}”, Fig. {'.'.join(map(str, number))}, in: "
        f"{book['title']}, version {book['version']}, commit {execution.get('commit', 'unknown')}.{after}"
    )
    return (
        '<details class="himap-cite"><summary>Cite this figure</summary>'
        f'<p><span class="himap-citation" data-anchor="{figure.name}">{html.escape(text)}</span></p>'
        "</details>"
    )


@cache
def _book(root):
    return yaml.safe_load(Path(root, "CITATION.cff").read_text())


@cache
def _execution(path):
    return read_notebook(path).metadata[STAMP].get("execution", {})


class Gallery(SphinxDirective):
    """The directive; its argument says which figures."""

    required_arguments = 1

    def run(self):
        chapters = notebooks(Path(self.env.srcdir, "notebooks"))
        there = {chapter: list(_figures(chapter.executed).values()) for chapter in chapters}
        for chapter in there:
            self.env.note_dependency(str(chapter.executed))
        if self.arguments[0] == "paper":
            shown = [one for many in there.values() for one in many if one.paper]
            return [self._grid(sorted(shown, key=lambda figure: figure_order(figure.paper)))]
        if self.arguments[0] == "chapters":
            return [node for one, many in there.items() if many for node in self._chapter(one.title, many)]
        raise self.error(f"a gallery of `paper` or of `chapters`, not of {self.arguments[0]!r}")

    def _chapter(self, title, many):
        count = f"{len(many)} figure{'s' if len(many) > 1 else ''}"
        label = f"<summary>{html.escape(title)} <small>({count})</small></summary>"
        opening = f'<details class="himap-chapter">{label}'
        return [_raw(opening), self._grid(many), _raw("</details>")]

    def _grid(self, many):
        up = "../" * self.env.docname.count("/")
        return _raw(f'<ul class="himap-gallery">{"".join(self._item(one, up) for one in many)}</ul>')

    def _item(self, figure, up):
        path = Path(self.env.app.outdir, "_static", "thumbnails", f"{figure.name}.webp")
        width, height = _small_picture(figure.png, path)
        number = f"<b>Fig. {figure.paper}</b> " if figure.paper else ""
        caption = html.escape(plain_caption(figure.caption))
        return (
            f'<li><a href="{up}notebooks/{figure.notebook}.html#{figure.name}">'
            f'<img src="{up}_static/thumbnails/{figure.name}.webp" alt="{caption}" width="{width}" '
            f'height="{height}" loading="lazy"><span>{number}{caption}</span></a></li>'
        )


def _small_picture(png, path):
    """Write a thumbnail as WebP; returns its width and height."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with Image.open(io.BytesIO(png)) as picture:
        small = picture.convert("RGB")
    small.thumbnail((WIDTH, 2 * WIDTH), Image.Resampling.LANCZOS)
    small.save(path, quality=42, method=6)
    return small.size


def _raw(text):
    return nodes.raw("", text, format="html")


def setup(app):
    app.add_directive("gallery", Gallery)
    app.connect("doctree-read", describe)
    app.connect("doctree-resolved", add_links)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
