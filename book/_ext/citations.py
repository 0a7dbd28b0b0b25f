"""Sphinx extension: citations as astronomers write them, (Author et al. 2025) and Author et al. (2025)."""

import re
from dataclasses import dataclass, field

from docutils import nodes
from sphinxcontrib.bibtex.plugin import register_plugin
from sphinxcontrib.bibtex.style.referencing import BracketStyle
from sphinxcontrib.bibtex.style.referencing.author_year import AuthorYearReferenceStyle


def _round():
    return BracketStyle(left="(", right=")")


@dataclass
class RoundStyle(AuthorYearReferenceStyle):
    """The author-year style with round brackets and no comma before the year."""

    bracket_parenthetical: BracketStyle = field(default_factory=_round)
    bracket_textual: BracketStyle = field(default_factory=_round)
    bracket_author: BracketStyle = field(default_factory=_round)
    bracket_label: BracketStyle = field(default_factory=_round)
    bracket_year: BracketStyle = field(default_factory=_round)
    author_year_sep: str = " "


_OTHERS = re.compile(r",? and others\b")


def _names_authors(node):
    is_cited = isinstance(node, nodes.inline) and "bibtex-citation" in node["classes"]
    return is_cited or isinstance(node, nodes.citation | nodes.reference)


def spell(app, doctree, docname):
    """*et al.* also where a list of authors ends with ``and others``, which is no name."""
    for place in doctree.findall(_names_authors):
        if "reftitle" in place:
            place["reftitle"] = _OTHERS.sub(" et al.", place["reftitle"])
        for text in [one for one in place.findall(nodes.Text) if _OTHERS.search(one)]:
            before, after = _OTHERS.split(text, maxsplit=1)
            new = [
                nodes.Text(f"{before} "),
                nodes.emphasis("", "et al."),
                nodes.Text(after.removeprefix(".")),
            ]
            text.parent.replace(text, new)


def setup(app):
    app.connect("doctree-resolved", spell)
    register_plugin("sphinxcontrib.bibtex.style.referencing", "author_year_round", RoundStyle)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
