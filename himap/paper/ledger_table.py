"""The ledger as a table: in a notebook, in the rendered book, and on a terminal."""

import html
from collections import Counter

import pandas as pd

from himap.figures.tables import HTML, Table
from himap.paper.claims import FAILED, IN_PART, INAPPLICABLE, REPRODUCED

_SECTIONS = {
    "1": "Sect. 1: the sky",
    "4.2": "Sect. 4.2: methods and beams",
    "4.3": "Sect. 4.3: the number of sources",
    "4.1, B": "Sect. 4.1 and App. B: masking of peaks",
    "5.1": "Sect. 5.1: lines of sight left out",
    "5.2": "Sect. 5.2: the Galaxy dimmed",
    "6": "Sect. 6: conclusions",
    "A": "App. A: diagnostics",
}
BADGES = {
    REPRODUCED: ("✓", "#00664b"),
    IN_PART: ("≈", "#8a5a00"),
    FAILED: ("✗", "#a33c00"),
    INAPPLICABLE: ("–", "#666666"),
}
"""{verdict: (sign, colour)}; dark enough for white letters, and distinct without colours by the sign."""

_WORDS = ("id", "beam", "statement", "number", "paper", "reading")  # of a claim, in its row


def summary(entries):
    """{verdict: how many claims}, every verdict there, in the order of `BADGES`."""
    count = Counter(entry.verdict for entry in entries)
    return {verdict: count[verdict] for verdict in BADGES}


def plain_table(entries):
    """A DataFrame of texts, with a row for each entry."""
    return pd.DataFrame(
        {
            "claim": entry.claim.id,
            "beam": entry.claim.beam,
            "verdict": entry.label,
            "in": f"{entry.agreeing}/{len(entry.findings)}",
            "measured": measured(entry),
            "paper": entry.claim.paper,
            "what is measured": entry.claim.number,
        }
        for entry in entries
    )


class LedgerTable:
    """To end a notebook cell with: the ledger, grouped by section of the paper.

    Parameters
    ----------
    entries
        A list of `himap.paper.claims.entries.Entry`.
    links
        {notebook: {figure of the paper: name of the figure in the book}}, for links from claims to figures.
    """

    def __init__(self, entries, links=None):
        self.entries, self.links = entries, links or {}

    def __repr__(self):
        return repr(Table([], plain_table(self.entries).to_numpy().tolist()))

    def _repr_html_(self):
        rows = []
        for section, title in _SECTIONS.items():
            claims = [self._row(entry) for entry in self.entries if entry.claim.section == section]
            if claims:
                rows += [["", HTML(f"<strong>{title}</strong>"), "", "", ""], *claims]
        return Table(["", "claim", "verdict", "measured", "paper"], rows).html()

    def _row(self, entry):
        claim = {name: html.escape(getattr(entry.claim, name)) for name in _WORDS}
        sign, colour = BADGES[entry.verdict]
        badge = (
            f'<span style="background:{colour};color:white;padding:1px 6px;border-radius:4px;'
            f'white-space:nowrap">{sign} {entry.label}</span>'
        )
        page, figure = entry.claim.notebook, entry.claim.figure
        name = self.links.get(page, {}).get(figure, "")
        link = f'<a href="{page}.html{name and "#"}{name}">{f"Fig. {figure}" if figure else "chapter"}</a>'
        parts = "; ".join(f"{html.escape(part)} ({n})" for part, n in entry.failed_parts().items())
        total = len(entry.findings)
        failed = f"<br>Does not hold (in how many of {total} realisations): {parts}" if parts else ""
        cells = (
            f'<span id="claim-{claim["id"]}">{claim["id"]}</span>',
            # As wide as can be read: on a phone the table scrolls.
            f'<div style="min-width:16em">{claim["statement"]} <em>({claim["beam"]})</em> '
            f"{link}<details><summary>reading and numbers</summary>{claim['reading']} "
            f"{html.escape(entry.sentence)}{failed}</details></div>",
            f"{badge}<br>{entry.agreeing} of {total} realisations",
            f"{html.escape(measured(entry))}<br><em>{claim['number']}</em>",
            claim["paper"],
        )
        return [HTML(cell) for cell in cells]


def measured(entry):
    """Median, and the range over realisations where there are several."""
    median, low, high = entry.values
    if median != median:
        return "–"
    if len(entry.findings) == 1 or low == high:
        return f"{median:.3g}"
    return f"{median:.3g} ({low:.3g} to {high:.3g})"
