"""The ledger as a table in a notebook, in the rendered book, and on a terminal."""

import html
import math
from collections import Counter

import pandas as pd

from himap.figures.tables import HTML, Table
from himap.paper.claims import FAILED, IN_PART, INAPPLICABLE, REPRODUCED, UNDECIDED
from himap.paper.claims.base import PLACE, SECTIONS

BADGES = {
    REPRODUCED: ("✓", "#00664b"),
    IN_PART: ("≈", "#8a5a00"),
    UNDECIDED: ("?", "#4b4b9b"),
    FAILED: ("✗", "#a33c00"),
    INAPPLICABLE: ("–", "#666666"),
}
"""{verdict: (sign, colour)}; dark enough for white letters, distinct without colours by their signs."""

CONCLUSIONS = {
    "D1 D2": "With all channels at one resolution every method recovers both spectra to better than 10 % "
    "over a broad range of scales.",
    "E1 E2 E3 E4": "With a beam that evolves smoothly with frequency the parametric fit fails, GMCA degrades "
    "from intermediate scales on, and PCA, FastICA and SDecGMCA remain accurate.",
    "O1 O3 O4 O6 S1": "Both fits fail; of the other methods SDecGMCA is the most accurate: it suppresses the "
    "spurious peak near k = 0.3 and recovers the angular spectrum at intermediate multipoles. Beyond l of "
    "about 200 its inversion of the beam is unstable.",
    "N1 N2 N4": "The number of sources is critical; 5 to 7 is the best compromise.",
    "M2 M4 M5 G1 G3 G4": "Excluding contaminated lines of sight after the separation reduces the residual of "
    "SDecGMCA; dimming the Galactic plane before it improves PCA, FastICA and most of all SDecGMCA.",
}
"""The conclusions of the paper (its Sect. 6), {ids of the claims with its numbers: conclusion}."""

READING = "reading "
"""First word of a difference that is the reading of SDecGMCA alone; otherwise the reading comes last."""

_WORDS = ("id", "beam", "statement", "number", "paper", "reading")  # of a claim, in its row


def summary(entries):
    """{verdict: number of claims}, with every verdict, in the order of `BADGES`."""
    count = Counter(entry.verdict for entry in entries)
    return {verdict: count[verdict] for verdict in BADGES}


def plain_table(entries):
    """A DataFrame of texts, with a row for each entry."""
    return pd.DataFrame(
        {
            "claim": entry.claim.id,
            "beam": entry.claim.beam,
            "verdict": entry.label,
            "parts": shares_text(entry.main_shares),
            "measured": measured(entry),
            "paper": entry.claim.paper,
            "what is measured": entry.claim.number,
        }
        for entry in entries
    )


def joint_verdict(entries):
    """The verdict on a conclusion, from the verdicts on its claims, given an `Entry` for each in `entries`.

    It is "reproduced" if all of them are, "in part" if at least one is reproduced at least in part, "not
    reproduced" if none is, and otherwise "undecided". Claims that do not apply do not count.
    """
    verdicts = {entry.verdict for entry in entries} - {INAPPLICABLE}
    if len(verdicts) < 2:
        return verdicts.pop() if verdicts else INAPPLICABLE
    return IN_PART if verdicts & {REPRODUCED, IN_PART} else UNDECIDED


def cause(entry, others):
    """Changes under which all failing parts of a claim hold, in words: measured, not guessed.

    `others` are {what is different: {claim: its `Entry`}}, such as "reading code" or "the paper's size,
    reading code", see `READING`. The text lists those in which all these parts hold, or says "none found"; it
    is empty for a claim that is reproduced or does not apply. If no part about SDecGMCA fails, the failing
    methods come first, and readings are not considered.
    """
    if entry.verdict in (REPRODUCED, INAPPLICABLE):
        return ""
    failing, causes = entry.main_shares[~entry.main_shares["holds"].eq(True)], []
    methods = {*failing["method"]}
    of_sd = entry.about_sd and bool(methods & {"SD", ""})
    if methods and not methods & {"SD", ""}:
        causes.append(f"{', '.join(sorted(methods))}, not SD")
    for name, several in others.items():
        other = several.get(entry.claim.id)
        if not of_sd and not name.startswith(READING):
            name = name.partition(f", {READING}")[0]
        # One run of SDecGMCA is a draw, and a reading affects no other method.
        if other is None or (other.is_single_run if of_sd else name.startswith(READING)):
            continue
        held = other.main_shares["holds"].eq(True).reindex(failing.index, fill_value=False)
        causes += [name] if len(held) and held.all() and name not in causes else []
    return "; ".join(causes) or "none found"


class LedgerTable:
    """The ledger, a list of `Entry`, grouped by section of the paper, for the end of a notebook cell.

    `links` are {notebook: {figure of the paper: name of the figure in the book}}, and `others` as in `cause`.
    """

    def __init__(self, entries, links=None, others=None):
        self.entries, self.links, self.others = entries, links or {}, others or {}

    def __repr__(self):
        return repr(Table([], plain_table(self.entries).to_numpy().tolist()))

    def _repr_html_(self):
        rows = []
        for section, (title, _) in SECTIONS.items():
            claims = [self._row(entry) for entry in self.entries if entry.claim.section == section]
            if claims:
                rows += [["", HTML(f"<strong>{title}</strong>"), "", "", "", ""], *claims]
        header = ["", "claim", "verdict", "measured", "paper, or limit", "fails for; holds in"]
        return Table(header, rows).html()

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
        parts = html.escape(shares_text(entry.shares[~entry.shares.index.str.contains(PLACE)]))
        shares = f"<br>Holds in what share of the members: {parts}" if parts else ""
        places = ", ".join(f"{place} in {share:.0%}" for place, share in sorted(entry.places.items()))
        where = html.escape(f" ({places})") if places else ""
        cells = (
            f'<span id="claim-{claim["id"]}">{claim["id"]}</span>',
            # Wide enough to be read: on a phone the table scrolls.
            f'<div style="min-width:16em">{claim["statement"]} <em>({claim["beam"]})</em> '
            f"{link}<details><summary>reading and numbers</summary>{claim['reading']} "
            f"{html.escape(entry.sentence)}{shares}</details></div>",
            f"{badge}<br>{members_text(entry)}",
            f"{html.escape(measured(entry))}<br><em>{claim['number']}</em>{where}",
            claim["paper"],
            html.escape(cause(entry, self.others)),
        )
        return [HTML(cell) for cell in cells]


def shares_text(shares):
    """Rows of `Entry.shares` in words, with their interval and how often the premise is absent."""
    texts = []
    for share in shares.itertuples():
        interval = f" ({share.low:.0%} to {share.high:.0%})" if share.low < share.high else ""
        absent = f", premise absent in {share.absent:.0%}" if share.absent else ""
        texts.append(f"{share.Index} {share.mean:.0%}{interval}{absent}")
    return "; ".join(texts)


def members_text(entry):
    """Number of members of an entry, in words."""
    skies = f"{entry.n_skies} sk{'y' if entry.n_skies == 1 else 'ies'}"
    runs = "one run each" if entry.n_skies > 1 else "one run"
    return f"{skies}, {runs if entry.n_restarts == 1 else f'{entry.n_restarts} restarts'}"


def measured(entry):
    """Median, and the range from 16 to 84 %, over members with a number; and their count, if not all."""
    median, low, high = entry.values
    spread = f" ({low:.3g} to {high:.3g})" if low < high else ""
    number, total = entry.members["value"].map(math.isfinite).sum(), len(entry.members)
    some = f", in {number} of {total} members" if number < total else ""
    return "–" if math.isnan(median) else f"{median:.3g}{spread}{some}"
