"""Outcomes of readings as lists of claims and as tables, for the chapter on readings and a terminal."""

import math

import pandas as pd

from himap.paper.claims import CLAIMS, FAILED, IN_PART, INAPPLICABLE, REPRODUCED, UNDECIDED
from himap.paper.ensembles import failures
from himap.paper.readings import BANDS, candidates, ranked_candidates, readings, shares_first
from himap.removal.sdecgmca.readings import OPTIONS, READINGS

EVERY, SOME, NONE, VOID = "under every reading", "depends on the reading", "under none", "does not apply"
"""Robustness of a claim: under which readings it holds, at least in part."""

MARKS = {
    REPRODUCED: ("✓", "#00382a", "white"),
    IN_PART: ("≈", "#3f9c82", "black"),
    UNDECIDED: ("?", "#a8bfe6", "black"),
    FAILED: ("✗", "#fbe0ca", "#7a2b00"),
    INAPPLICABLE: ("–", "#ffffff", "#666666"),
}
"""{verdict: (sign, colour, colour of the sign)}, from dark to light, distinct in grey, too."""

_MANY = 1e3  # above, one digit and a power of ten are enough


def summary_table(outcomes):
    """A DataFrame of texts with a row for each of {label: `Outcome`}.

    Entries for bands and bump are the value furthest from 1 over all runs, as a factor, or a dash.
    """
    known, rows = readings() | candidates(), []
    for label, one in outcomes.items():
        verdicts = [entry.verdict for entry in one.entries.values()]
        rows.append(
            {
                "reading": known[label].title,
                "departures from the text": f"{len(known[label].departures)}",
                "statements on SD": f"{one.statements:.1f}",
                "fails": one.fails,
                **{sign: f"{verdicts.count(verdict)}" for verdict, (sign, *_) in MARKS.items()},
                **{name: _furthest(one.numbers.get(name, ())) for name in (*BANDS, "bump")},
            }
        )
    return pd.DataFrame(rows)


def shares_table(outcomes):
    """A DataFrame of texts with a row for each claim and a column for each of {label: `Outcome`}.

    Entries are the share of the members in which a main part holds, averaged over parts, in per cent; a dash
    if the claim does not apply.
    """
    rows = []
    for name, claim in CLAIMS.items():
        row = {"claim": name, "statement": claim.statement}
        for label, one in outcomes.items():
            share = one.entries[name].main_shares["mean"].mean() if name in one.entries else math.nan
            row[label] = "–" if math.isnan(share) else f"{100 * share:.0f}"
        rows.append(row)
    return pd.DataFrame(rows)


def _furthest(values):
    """The ratio furthest from 1 as a factor; a dash if there is none."""
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return "–"
    furthest = max(finite, key=lambda value: abs(math.log(value)) if value > 0 else math.inf)
    short = f"{furthest:#.3g}".rstrip(".")
    return short if furthest < _MANY else f"{furthest:.0e}".replace("e+0", "e")


def robustness(outcomes):
    """{`EVERY`, `SOME`, `NONE` or `VOID`: its claims, in the order of the paper}.

    A claim holds under a reading if it is reproduced, at least in part. If it does not apply, it does not
    hold.
    """
    claims = {EVERY: [], SOME: [], NONE: [], VOID: []}
    for claim in CLAIMS:
        judging = [one.entries[claim] for one in outcomes.values() if claim in one.entries]
        holds = {entry.holds for entry in judging}
        kind = SOME if len(holds) == 2 else EVERY if True in holds else NONE
        if judging:
            claims[VOID if {entry.verdict for entry in judging} == {INAPPLICABLE} else kind].append(claim)
    return claims


def decisive_options(outcomes, claim):
    """Labels of readings with one choice changed under which a claim holds although it fails by default, or
    the reverse; none if the default was not judged.
    """
    holds = {label: one.entries[claim].holds for label, one in outcomes.items() if claim in one.entries}
    single = [label for label, reading in readings().items() if reading.changed]
    return [label for label in single if {holds.get("default"), holds.get(label)} == {True, False}]


def insensitive_claims(outcomes):
    """The claims whose verdicts and numbers are the same under every reading."""
    versions = {}
    for outcome in outcomes.values():
        for claim, entry in outcome.entries.items():
            numbers = entry.members["value"].map(str)  # as text, NaN is equal to itself
            versions.setdefault(claim, set()).add((entry.label, *numbers))
    return [claim for claim in CLAIMS if len(versions.get(claim, ())) == 1]


def candidates_table(rows, counts):
    """A DataFrame of texts with a row for each candidate for the default, the most charitable first.

    `rows` are those of a record of restarts, and `counts` their `statement_counts`.
    """
    known, first, failed = readings() | candidates(), shares_first(counts), failures(rows)
    failed = failed[failed["case"] == "oscillating"].set_index("reading")
    return pd.DataFrame(
        {
            "candidate": known[label].title,
            "statements on SD that hold": f"{count:.1f}",
            f"on the skies {', '.join(map(str, counts.index))}": ", ".join(
                map("{:.1f}".format, counts[label])
            ),
            "first": f"{100 * first[label]:.0f} %",
            "departures from the text": f"{distance}",
            "which": ", ".join(f"{name} = {value}" for name, value in known[label].departures.items())
            or "none",
            "fails": "{failed} of {members}".format(**failed.loc[label]),
        }
        for label, count, distance in ranked_candidates(counts)
    )


def option_rows(outcomes):
    """Rows of text for every choice of `OPTIONS`: question, the paper's words, choice, named readings with
    it, and for every other choice the number of failing runs and the claims that it decides.
    """
    changes = {reading.changed: label for label, reading in readings().items()}
    decisive = {claim: decisive_options(outcomes, claim) for claim in CLAIMS}
    rows = []
    for option, one in OPTIONS.items():
        for value, meaning in one.choices.items():
            named = [name for name, values in READINGS.items() if values[option] == value]
            row = [f"{option} = {value}", one.question, one.word, meaning, ", ".join(named), "", ""]
            label = changes.get((option, value))
            if label in outcomes:
                decided = [claim for claim, labels in decisive.items() if label in labels]
                row[-2:] = [outcomes[label].fails, ", ".join(decided) or "none"]
            rows.append(tuple(row))
    return rows
