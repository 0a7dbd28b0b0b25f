"""What readings lead to, as lists of claims and as tables: in the chapter on readings and on a terminal."""

import math

from himap.paper.claims import CLAIMS, FAILED, IN_PART, INAPPLICABLE, REPRODUCED
from himap.paper.readings import BANDS, readings
from himap.removal.sdecgmca.readings import OPTIONS, READINGS

EVERY, SOME, NONE, VOID = "under every reading", "depends on the reading", "under none", "applies under none"
"""Where a claim stands: it holds, at least in part, under these readings."""

MARKS = {
    REPRODUCED: ("✓", "#00553f", "white"),
    IN_PART: ("≈", "#6fb89f", "black"),
    FAILED: ("✗", "#f7d7bd", "#7a2b00"),
    INAPPLICABLE: ("–", "#ffffff", "#666666"),
}
"""{verdict: (sign, colour, colour of the sign)}, from dark to light, so that they differ in grey too."""

HEADER = (
    "reading",
    "choices off the text",
    "fails",
    *(MARKS[verdict][0] for verdict in MARKS),
    *BANDS,
    "bump",
)
"""Of the columns of `plain_rows`."""

_MANY = 1e3  # from where on one digit and a power of ten are enough


def plain_rows(outcomes):
    """Rows of text, one for each of {label: `Outcome`}, columns as in `HEADER`.

    Of bands and bump the value that is furthest from 1 over all runs, as a factor.
    """
    known = readings()
    return [
        (
            known[label].title,
            f"{known[label].distance}",
            f"{one.n_failing} of {len(one.runs)}",
            *(f"{n}" for n in _count(one)),
            *(_furthest(run.numbers.get(name, math.nan) for run in one.runs) for name in (*BANDS, "bump")),
        )
        for label, one in outcomes.items()
    ]


def with_columns(names, rows):
    """(header, rows) of those columns of `plain_rows` in which some reading has a number."""
    places = [HEADER.index(name) for name in names]
    filled = [place for place in places if any(row[place] != "–" for row in rows)]
    return [HEADER[place] for place in filled], [[row[place] for place in filled] for row in rows]


def _count(outcome):
    verdicts = [entry.verdict for entry in outcome.entries.values()]
    return [verdicts.count(verdict) for verdict in MARKS]


def _furthest(values):
    """Of some ratios the one that is furthest from 1 as a factor; a dash where there is none."""
    there = [value for value in values if math.isfinite(value)]
    if not there:
        return "–"
    furthest = max(there, key=lambda value: abs(math.log(value)) if value > 0 else math.inf)
    if furthest < _MANY:
        return f"{furthest:#.3g}".rstrip(".")
    return f"{furthest:.0e}".replace("e+0", "e")


def robustness(outcomes):
    """{`EVERY`, `SOME`, `NONE` or `VOID`: its claims, in the order of the paper}.

    A claim holds under a reading if it is reproduced there, at least in part. Where it does not apply it does
    not hold.
    """
    places = {EVERY: [], SOME: [], NONE: [], VOID: []}
    for claim in _judged(outcomes):
        there = [one for one in outcomes.values() if claim in one.entries]
        holds = {one.holds(claim) for one in there}
        if all(one.verdict(claim) == INAPPLICABLE for one in there):
            places[VOID].append(claim)
        else:
            places[SOME if len(holds) == 2 else EVERY if True in holds else NONE].append(claim)
    return places


def decisive_options(outcomes, claim):
    """Labels of the readings with one choice changed under which a claim holds and by default does not, or
    the reverse; none where the default was not judged.
    """
    base = outcomes["default"].holds(claim) if "default" in outcomes else None
    single = [label for label, reading in readings().items() if reading.changed and label in outcomes]
    held = {label: outcomes[label].holds(claim) for label in single}
    return [label for label, one in held.items() if None not in (one, base) and one != base]


def insensitive_claims(outcomes):
    """The claims of which every reading says the same, to the last number: no choice about SDecGMCA is in
    them.
    """
    said = {
        claim: {
            tuple((seed, *_said(finding)) for seed, finding in outcome.entries[claim].findings.items())
            for outcome in outcomes.values()
            if claim in outcome.entries
        }
        for claim in _judged(outcomes)
    }
    return [claim for claim, versions in said.items() if len(versions) == 1]


def _said(finding):
    """Verdict, how many parts hold if some do, and the number as text, so that NaN is equal to itself."""
    held = (finding.n_held, len(finding.parts)) if finding.verdict == IN_PART else ()
    return finding.verdict, held, f"{finding.value}"


def _judged(outcomes):
    return [claim for claim in CLAIMS if any(claim in one.entries for one in outcomes.values())]


def closest_converged(outcomes):
    """Labels of the readings of which no run fails, and that have the fewest choices off the text.

    Of several such, those that have the fewest choices unlike the letter.
    """
    known = readings()
    sound = [label for label, one in outcomes.items() if not one.n_failing]
    places = {label: (known[label].distance, known[label].unlike) for label in sound}
    return [label for label in sound if places[label] == min(places.values())]


def option_rows(outcomes):
    """Rows of text for every choice of `OPTIONS`: what is to be decided, the paper's word, what the readings
    with a name take, and of every other choice in how many runs it fails and which claims it decides.
    """
    rows = []
    for option, one in OPTIONS.items():
        changes = {
            r.changed[1]: label for label, r in readings().items() if r.changed and r.changed[0] == option
        }
        for value, meaning in one.choices.items():
            taken = [name for name, named in READINGS.items() if named[option] == value]
            label = changes.get(value)
            found = outcomes.get(label)
            rows.append(
                (
                    f"{option} = {value}",
                    one.question,
                    one.word,
                    meaning,
                    ", ".join(taken),
                    f"{found.n_failing} of {len(found.runs)}" if found else "",
                    _decided(outcomes, label),
                )
            )
    return rows


def _decided(outcomes, label):
    """The claims that a reading with one choice changed decides, one after the other."""
    if label not in outcomes:
        return ""
    return (
        ", ".join(claim for claim in _judged(outcomes) if label in decisive_options(outcomes, claim))
        or "none"
    )
