"""Sphinx extension: ``{gallery} paper``, thumbnails of the figures of the paper that lead to them, and
``{gallery} chapters``, those of all figures, chapter by chapter.
"""

import html
import io
from pathlib import Path

from docutils import nodes
from PIL import Image
from sphinx.util.docutils import SphinxDirective

from himap.app.figures import figure_order, figures, plain_caption
from himap.app.notebooks import notebooks

WIDTH = 320  # pixels: sharp at the 160 of the page on a fine screen


class Gallery(SphinxDirective):
    """The directive; its argument says which figures."""

    required_arguments = 1

    def run(self):
        chapters = notebooks(Path(self.env.srcdir, "notebooks"))
        there = {chapter: figures(chapter.executed) for chapter in chapters}
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
        width, height = small_picture(figure.png, path, WIDTH)
        number = f"<b>Fig. {figure.paper}</b> " if figure.paper else ""
        caption = html.escape(plain_caption(figure.caption))
        return (
            f'<li><a href="{up}notebooks/{figure.notebook}.html#{figure.name}">'
            f'<img src="{up}_static/thumbnails/{figure.name}.webp" alt="{caption}" width="{width}" '
            f'height="{height}" loading="lazy"><span>{number}{caption}</span></a></li>'
        )


def small_picture(png, path, width):
    """Write a picture at most `width` pixels wide as WebP; returns its width and height."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with Image.open(io.BytesIO(png)) as picture:
        small = picture.convert("RGB")
    small.thumbnail((width, 2 * width), Image.Resampling.LANCZOS)
    small.save(path, quality=42, method=6)
    return small.size


def _raw(text):
    return nodes.raw("", text, format="html")


def setup(app):
    app.add_directive("gallery", Gallery)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
