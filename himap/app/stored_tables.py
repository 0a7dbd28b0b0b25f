"""Layout of stored results on the pages: tables and pictures as Markdown, and curves."""

import os

import numpy as np

from himap.app.notebook_files import figure_order, plain_caption
from himap.app.notebooks import notebooks, notebooks_folder
from himap.app.stored import RESULTS, record_words, stored_figure, stored_figures
from himap.figures import styles
from himap.figures.tables import Table
from himap.paper.claims import CLAIMS, INAPPLICABLE
from himap.paper.claims.entries import entries as entries_of
from himap.paper.ledger_table import BADGES, cause, measured, members_text, shares_text, summary
from himap.store.provenance import Provenance

_NO_BREAK = "\N{NO-BREAK SPACE}"
_TOP = 200  # largest l shown
_PARTS = 3  # maximum number listed in a cell
_DISTURBED = {
    "run_killed": ("`himap run` killed", "kills"),
    "claims_killed": ("`himap measure claims` killed, with two processes", "kills"),
    "clean_killed": ("`himap clean` killed", "kills"),
    "four_processes": ("one of four `himap run` on one cache killed; processes", "processes"),
    "full_disk_run": ("disk full under `himap run`", "full_disks"),
    "full_disk_clean": ("disk full under `himap clean`", "full_disks"),
    "dead_worker": ("a process that works for `himap measure claims` killed", "workers_killed"),
}
"""{name in `benchmarks.endurance`: (description, the count of repetitions)}"""


def short(value, digits=2):
    """A number with that many digits, without an exponent.

    >>> short(567.68, 3), short(0.0312), short(12345.0)
    ('568', '0.031', '12,000')
    """
    return f"{float(f'{value:.{digits}g}'):,g}"


def steps_table(stored):
    """Time, memory, floor and alternative of every step written by ``python -m benchmarks``, as Markdown.

    Also the machine and the provenance. Goals are shown for the preset ``paper``, for which they were set;
    missed goals are bold.
    """
    goals, rows = stored["about"]["preset"] == "paper", []
    for step in stored["steps"]:
        time, memory = f"{short(step['seconds'], 3)} s", f"{step['memory_gb']:.1f} GB"
        cells = [time, memory]
        if goals:
            time = f"**{time}**" if step["seconds"] > step["goal_seconds"] else time
            memory = f"**{memory}**" if step["memory_gb"] > step["goal_gb"] else memory
            cells = [time, f"{step['goal_seconds']} s", memory, f"{step['goal_gb']} GB"]
        cells += [f"{short(step['floor_seconds'])} s", f"{short(step['seconds'] / step['floor_seconds'])} ×"]
        other = step.get("alternative")
        times = f"{short(other['seconds'] / step['seconds'])} × {other['name']}" if other else ""
        rows.append([step["step"], *(cell.replace(" ", _NO_BREAK) for cell in cells), times])
    machine = stored["machine"]
    said = (
        f"This machine moved {machine['bandwidth'] / 1e9:.3g} GB/s, did {machine['operations'] / 1e9:.3g} "
        f"GFlop/s in float64 ({machine['operations_single'] / 1e9:.3g} in float32), and took "
        f"{1e3 * machine['transform']:.3g} ms for a spherical harmonic transform "
        f"({1e3 * machine['transform_single']:.3g} in float32)."
    )
    goal = ["Goal"] * goals
    head = ["Step", "Time", *goal, "Memory", *goal, "Floor", "Over it", "Alternative"]
    return "\n\n".join([_markdown(head, rows), said, _footer(stored["about"])])


def growth_table(stored):
    """Exponents of every step, written by ``python -m benchmarks.scaling``, as Markdown."""
    ways = stored["found"].values()
    rows = [[step, *(f"{way[step]['exponent']:.2f}" for way in ways)] for step in next(iter(ways))]
    head = ["Step", "with nside", "with channels"]
    return "\n\n".join([_markdown(head, rows), _footer(stored["about"])])


def endurance_table(stored):
    """Outcomes of disturbed commands, written by ``python -m benchmarks.endurance``, as Markdown.

    Nonzero counts of failures are bold.
    """
    rows = []
    for name, counts in stored["found"].items():
        text, times = _DISTURBED[name]
        failed = sum(counts.get(key, 0) for key in ("reruns_that_failed", "processes_that_failed"))
        endings = [counts[key] for key in ("told_in_a_sentence", "done_all_the_same") if key in counts]
        failed += counts["finished"] - sum(endings) if endings else 0  # a count of zero is left out
        remains = sum(n for key, n in counts.items() if key.startswith("left_") or key == "processes_left")
        numbers = (failed, counts.get("other_results", 0), remains)
        rows.append([text, f"{counts.get(times, 0)}", *(f"**{n}**" if n else "0" for n in numbers)])
    head = ["What was done", "Times", "Failed", "Other results", "Left behind"]
    return "\n\n".join([_markdown(head, rows), _footer(stored["about"])])


def ledgers_table(ledgers, only=None, others=None):
    """Verdicts and numbers of several ledgers side by side, and the parts that fail, as Markdown.

    Parameters
    ----------
    ledgers
        A list of (entries, about), from `himap.app.stored.read_ledger`.
    only
        Function from the entries of a claim, one per ledger, to whether it is shown; default all claims,
        with the count of verdicts of ledgers with several runs.
    others
        As in `himap.paper.ledger_table.cause`, for a column with where the parts that fail in the first hold.
    """
    pairs = zip(_ledger_names(ledgers), ledgers, strict=True)
    names = [f"{name}, {members_text(entries[0])}" for name, (entries, _) in pairs]
    rows, by_id = [], [{entry.claim.id: entry for entry in entries} for entries, _ in ledgers]
    for id, claim in CLAIMS.items():
        several = [ledger.get(id) for ledger in by_id]  # an older ledger may lack a claim
        judged = [entry for entry in several if entry]
        if judged and (only is None or only(judged)):
            first = [f"**{id}**", f"{claim.number} ({claim.beam})", claim.paper]
            why = [] if others is None else [cause(judged[0], others)]
            rows.append([*first, *(_cell(entry) if entry else "not judged" for entry in several), *why])
    if only is None:
        counts = [
            [f"{BADGES[verdict][0]} {n}" for verdict, n in summary(entries).items() if n]
            if not any(entry.is_single_run for entry in entries)
            else ["one run"]
            for entries, _ in ledgers
        ]
        rows.append(["all", "", "", *map(" · ".join, counts), *([] if others is None else [""])])
    more = [] if others is None else ["Fails for; holds in"]
    table = _markdown(["Claim", "Measured", "The paper, or limit", *names, *more], rows)
    # Words common to all are in a separate paragraph.
    footers = [Provenance.of_stored(about).footer().split(" · ") for _, about in ledgers]
    shared = [word for word in footers[0] if len(footers) > 1 and all(word in words for words in footers)]
    notes = [f"*All: {' · '.join(shared)}*"] if shared else []
    for name, words in zip(names, footers, strict=True):
        notes.append(f"*{name}: {' · '.join(word for word in words if word not in shared)}*")
    return "\n\n".join([table, *notes])


def verdicts_table(ledgers):
    """Number of claims with each verdict for some ledgers, as Markdown; `ledgers` as in `ledgers_table`."""
    rows = [
        [name, members_text(entries[0]), *summary(entries).values()]
        for name, (entries, _) in zip(_ledger_names(ledgers), ledgers, strict=True)
    ]
    signs = [f"{sign} {verdict}" for verdict, (sign, _) in BADGES.items()]
    return _markdown(["", "members", *signs], rows)


def choices_table(ledger, others):
    """Verdicts of a ledger that change with other choices, as Markdown: a row for each other record.

    All are a `Record` of the claims; the others differ in `stored.CHOICES`, or in the run of SDecGMCA. Each
    is compared with the ledger on their common skies and restarts.
    """
    rows, usual = [], record_words(ledger.made)
    for other in others:
        members = [record.rows.set_index(["seed", "restart"]).index for record in (ledger, other)]
        shared = members[0].intersection(members[1])
        both = [
            entries_of(record.rows[of_record.isin(shared)])
            for record, of_record in zip((ledger, other), members, strict=True)
        ]
        changes = []
        for before, after in zip(*both, strict=True):
            if before.verdict == after.verdict:
                continue
            signs = f"{after.claim.id} {BADGES[before.verdict][0]} → {BADGES[after.verdict][0]}"
            shares = [entry.main_shares["mean"] for entry in (before, after)]
            parts = shares[0].compare(shares[1]).index if shares[0].index.equals(shares[1].index) else ()
            methods = dict.fromkeys(filter(None, after.main_shares["method"].reindex(parts)))
            which = f" ({', '.join(methods)})" if methods else ""
            changes.append(signs.replace(" ", _NO_BREAK) + which)
        words = [word for name, word in record_words(other.made).items() if word != usual[name]]
        choice = ", ".join(words) or "none: another run of SDecGMCA"
        rows.append([choice, members_text(both[1][0]), ", ".join(changes) or "none"])
    return _markdown(["Choice", "Members", "Verdicts that change (methods whose parts do)"], rows)


def _ledger_names(ledgers):
    """Size of each ledger, its Galaxy if there are several, and the replacement of the default reading."""
    every = [record_words(Provenance.of_stored(about)) for _, about in ledgers]
    if len({words["galaxy"] for words in every}) == 1:
        every = [words | {"galaxy": ""} for words in every]
    return [", ".join(filter(None, words.values())) for words in every]


def _cell(entry):
    """Sign and number of an entry, and the main parts that do not hold, or not in enough members.

    In words if sign and number would both be a dash. A single run is mentioned if results can vary.
    """
    number = measured(entry)
    if entry.verdict == INAPPLICABLE and number == BADGES[INAPPLICABLE][0]:
        number = entry.verdict
    failing = entry.main_shares[~entry.main_shares["holds"].eq(True)]
    more = f"; and {len(failing) - _PARTS} more" if len(failing) > _PARTS else ""
    once = "one run, " if entry.is_single_run else ""
    sign = f"{once}{BADGES[entry.verdict][0]}{entry.label.removeprefix(entry.verdict)}"
    parts = f"<br>holds in: {shares_text(failing[:_PARTS])}{more}" if len(failing) else ""
    return f"{sign} {number}{parts}"


def pictures(folders, results=None):
    """The stored figures of the paper, each from all given folders of results, as Markdown.

    Pictures have relative paths.
    """
    chapters = {name: (one, text) for one in notebooks() for name, text in one.captions.items()}
    stored = {}
    for folder, rows in stored_figures(results, folders).items():
        for name, row in rows.items():
            stored.setdefault((figure_order(row["paper"]), name), []).append((folder, row))
    parts = []
    for (_, name), several in sorted(stored.items()):
        chapter, caption = chapters[name]
        link = f"[{chapter.name}]({chapter.name}.ipynb)"
        parts.append(f"**Fig. {several[0][1]['paper']}.** {plain_caption(caption, whole=True)} ({link}).")
        parts += [part for folder, row in several for part in _picture(folder, row, results)]
    return "\n\n".join(parts)


def picture(folder, name, results=None):
    """A stored figure as Markdown: its picture with a relative path, its caption, and its provenance."""
    row = stored_figure(folder, name, results)
    shown, made = _picture(folder, row, results)
    captions = [one.captions[name] for one in notebooks() if name in one.captions]
    captions = [f": {plain_caption(caption, whole=True)}" for caption in captions]
    return f"{shown}\n\n*The paper's Fig. {row['paper']}, reproduced{''.join(captions)}.*\n\n{made}"


def _picture(folder, row, results):
    """Two paragraphs: a stored figure linked to its full size, and its provenance.

    The provenance includes parameters that differ from those of the notebook, but not the time: the picture
    was drawn before the end of its notebook.
    """
    path = f"{os.path.relpath(results or RESULTS, notebooks_folder())}/{folder}/{row['name']}.png"
    chosen, execution = {"preset": "quick", "galaxy": "synthetic"} | row["parameters"], row["execution"]
    size = f"{chosen.pop('preset')}, {chosen.pop('galaxy')} Galaxy"
    changed = [f"{name} = {value}" for name, value in chosen.items()]
    code = f"himap {execution['himap']}, commit {execution['commit']}{' with edits' * execution['dirty']}"
    made = " · ".join([size, *changed, code])
    return f"[![Fig. {row['paper']}, {made}]({path})]({path})", f"*{made}*"


def stored_curves(folder, figure, results=None):
    """The curves of a stored figure, {panel: {label: (x, y)}}; arguments as in `stored_figure`."""
    return {
        panel: {
            label: (np.array(group["x"]), np.array(y)) for group in groups for label, y in group["y"].items()
        }
        for panel, groups in stored_figure(folder, figure, results)["panels"].items()
    }


def angular_ratios(curves, **settings):
    """A panel of `himap.figures.plotting.ratios`: C/C0 of all methods among some curves, 2 <= l <= 200.

    For an ensemble, the median and 16 to 84 % range. The curves are {label: (l, C_l)} of a panel of a figure,
    from `stored_curves`; `settings` are those of the panel, such as its title.
    """
    at, true = curves["HI + noise"]
    drawn = []
    for look in styles.METHOD_STYLES.values():
        for label in curves:
            name, _, part = label.partition(": ")
            if name.partition(", median of ")[0] != look["label"] or part not in ("", "median"):
                continue
            degrees, _ = curves[label]
            shown = (degrees >= 2) & (degrees <= _TOP)
            ends = [f"{name}: {end}" for end in ("16 %", "84 %")] if part else [label] * 2
            over = true[np.searchsorted(at, degrees)]
            ratios = [(curves[one][1] / over)[shown] for one in (label, *ends)]
            drawn.append((degrees[shown], *ratios, look | {"label": name}))
    return {"curves": drawn, "xlabel": styles.AXES["angular"]["xlabel"]} | settings


def _footer(about):
    return f"*{Provenance.of_stored(about).footer()}*"


def _markdown(head, rows):
    return "\n".join(Table(head, rows).markdown())
