"""Sphinx extension: ``{ledgers}``, verdicts of several ledgers side by side, and ``{beside}``, figures of the
paper at other parameters beside those of the book.

The arguments are names in ``book/results``: files of ledgers, folders that ``book/collect_figures.py``
wrote. What a figure was made with stands under it.
"""

import html
import json
from pathlib import Path

from docutils import nodes
from executed import figures
from gallery import in_order, plain, small_picture
from sphinx.util.docutils import SphinxDirective
from tables import parsed, table

from himap.companion.notebook_files import STAMP, read_notebook
from himap.companion.notebooks import notebooks
from himap.paper.ledger import read_ledger
from himap.paper.ledger_table import BADGES, plain_rows
from himap.products.provenance import Provenance, duration

_WIDTH = 760  # pixels: as wide as the page; a click leads to the whole picture


class Ledgers(SphinxDirective):
    """Its arguments are files of ledgers, each a column."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self):
        read = []
        for name in self.arguments[0].split():
            path = Path(self.env.srcdir, "book", "results", f"{name}.json")
            self.env.note_dependency(str(path))
            entries, about = read_ledger(path)
            read.append((plain_rows(entries), Provenance.of_stored(about)))
        rows = [_claim(of_one) for of_one in zip(*(rows for rows, _ in read), strict=True)]
        columns = [f"{about.preset}, {about.galaxy}" for _, about in read]
        lines = table(
            ["Claim", "Measured", "The paper says", *columns],
            [*rows, ["all", "", "", *(_count(rows) for rows, _ in read)]],
        )
        for column, (_, about) in zip(columns, read, strict=True):
            lines += ["", f"*{column}: {about.footer()}*"]
        return parsed(self, lines)


def _claim(rows):
    """The cells of one claim: what is measured, what the paper has, verdict and number of each ledger."""
    id, beam, _, _, _, paper, number = rows[0]
    return [f"**{id}**", f"{number} ({beam})", paper, *(f"{BADGES[row[2]][0]} {row[4]}" for row in rows)]


def _count(rows):
    verdicts = [row[2] for row in rows]
    return " · ".join(f"{sign} {verdicts.count(one)}" for one, (sign, _) in BADGES.items() if one in verdicts)


class Beside(SphinxDirective):
    """Its arguments are folders of figures."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self):
        ours = {one.name: one for one in self._of_the_book()}
        others = [one for name in self.arguments[0].split() for one in self._of_folder(name)]
        there = {other["name"] for other in others}
        rows = sorted((one for one in ours.values() if one.name in there), key=in_order)
        text = "".join(self._row(one, [o for o in others if o["name"] == one.name]) for one in rows)
        return [nodes.raw("", text, format="html")]

    def _of_the_book(self):
        for chapter in notebooks(Path(self.env.srcdir, "notebooks")):
            self.env.note_dependency(str(chapter.executed))
            yield from (one for one in figures(chapter.executed) if one.paper)

    def _of_folder(self, name):
        folder = Path(self.env.srcdir, "book", "results", name)
        self.env.note_dependency(str(folder / "figures.json"))
        for row in json.loads((folder / "figures.json").read_text())["figures"]:
            yield row | {"folder": name, "png": (folder / f"{row['name']}.png").read_bytes()}

    def _row(self, one, others):
        notebook = Path(self.env.srcdir, "notebooks", f"{one.notebook}.ipynb")
        execution = read_notebook(notebook).metadata[STAMP]["execution"]
        pictures = [self._picture(one.name, "book", one.png, _made({}, execution))]
        for other in others:
            made = _made(other["parameters"], other["execution"])
            pictures.append(self._picture(one.name, other["folder"], other["png"], made))
        caption = html.escape(plain(one.caption))
        up = "../" * self.env.docname.count("/")
        link = f'<a href="{up}notebooks/{one.notebook}.html#{one.name}">{one.notebook}</a>'
        title = f'<h3 id="{one.name}-sizes">Fig. {one.paper}</h3><p>{caption} ({link}).</p>'
        return f'{title}<div class="himap-beside">{"".join(pictures)}</div>'

    def _picture(self, name, folder, png, made):
        place = f"_static/sizes/{folder}/{name}"
        target = Path(self.env.app.outdir, place)
        width, height = small_picture(png, target.with_suffix(".webp"), _WIDTH)
        target.with_suffix(".png").write_bytes(png)
        link, made = "../" * self.env.docname.count("/") + place, html.escape(made)
        return (
            f'<figure><a href="{link}.png"><img src="{link}.webp" width="{width}" height="{height}" '
            f'loading="lazy" alt="{name}: {made}"></a><figcaption>{made}</figcaption></figure>'
        )


def _made(parameters, execution):
    """One line: preset, Galaxy, other parameters that are not the notebook's, version, commit and time."""
    chosen = {"preset": "quick", "galaxy": "synthetic"} | parameters
    size = f"{chosen.pop('preset')}, {chosen.pop('galaxy')} Galaxy"
    changed = [f"{name} = {value}" for name, value in chosen.items()]
    edits = " with edits" if execution["dirty"] else ""
    himap = f"himap {execution['himap']}, commit {execution['commit']}{edits}"
    return " · ".join([size, *changed, himap, duration(execution["seconds"])])


def setup(app):
    app.add_directive("ledgers", Ledgers)
    app.add_directive("beside", Beside)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
