"""How stored results are laid out on the pages: tables and pictures as Markdown."""

import os

from himap.app.figures import figure_order, plain_caption
from himap.app.notebooks import notebooks, notebooks_folder
from himap.app.stored import RESULTS, read_stored, stored_figure
from himap.figures import styles
from himap.figures.tables import Table
from himap.paper.claims import FAILED, IN_PART, INAPPLICABLE
from himap.paper.ledger_table import BADGES, measured, summary
from himap.store.provenance import Provenance

_NO_BREAK = "\N{NO-BREAK SPACE}"
_PARTS = 3  # of a claim that a cell can list
_SIZES = {"paper": "the paper's size", "laptop": "half size", "quick": "quarter size"}
_GALAXIES = {"templates": "real Galaxy", "synthetic": "synthetic Galaxy"}
_DISTURBED = {
    "run_killed": ("`himap run` killed", "kills"),
    "claims_killed": ("`himap measure claims` killed, with two processes", "kills"),
    "clean_killed": ("`himap clean` killed", "kills"),
    "four_processes": ("one of four `himap run` on one cache killed; processes", "processes"),
    "full_disk_run": ("disk full under `himap run`", "full_disks"),
    "full_disk_clean": ("disk full under `himap clean`", "full_disks"),
    "dead_worker": ("a process that works for `himap measure claims` killed", "workers_killed"),
}
"""{name in `benchmarks.endurance`: (in words, which of its counts says how often)}"""


def short(value, digits=2):
    """A number with that many digits, without an exponent.

    >>> short(567.68, 3), short(0.0312), short(12345.0)
    ('568', '0.031', '12,000')
    """
    return f"{float(f'{value:.{digits}g}'):,g}"


def steps_table(found):
    """Time, memory, floor and alternative of every step, the machine, and what was measured, as Markdown.

    Parameters
    ----------
    found
        What ``python -m benchmarks`` wrote. The goals are shown at the preset ``paper``, for which they were
        set; what misses its goal is bold.
    """
    head = ["Step", "Time", "Goal", "Memory", "Goal", "Floor", "Over it", "Alternative"]
    goals = found["about"]["preset"] == "paper"
    rows = [_step(row, goals) for row in found["steps"]]
    head = head if goals else [word for word in head if word != "Goal"]
    return "\n\n".join([_markdown(head, rows), _machine(found["machine"]), _footer(found["about"])])


def _step(row, goals):
    beside = row.get("alternative")
    cells = [f"{short(row['seconds'], 3)} s", f"{row['goal_seconds']} s"]
    cells += [f"{row['memory_gb']:.1f} GB", f"{row['goal_gb']} GB", f"{short(row['floor_seconds'])} s"]
    cells.append(f"{short(row['seconds'] / row['floor_seconds'])} ×")
    cells = [cell.replace(" ", _NO_BREAK) for cell in cells]
    if goals:
        cells[0] = f"**{cells[0]}**" if row["seconds"] > row["goal_seconds"] else cells[0]
        cells[2] = f"**{cells[2]}**" if row["memory_gb"] > row["goal_gb"] else cells[2]
    cells.append(f"{short(beside['seconds'] / row['seconds'])} × {beside['name']}" if beside else "")
    return [row["step"], *(cells if goals else [cell for n, cell in enumerate(cells) if n not in (1, 3)])]


def _machine(machine):
    return (
        f"This machine moved {machine['bandwidth'] / 1e9:.3g} GB/s, did {machine['operations'] / 1e9:.3g} "
        f"GFlop/s in float64 ({machine['operations_single'] / 1e9:.3g} in float32), and took "
        f"{1e3 * machine['transform']:.3g} ms for a spherical harmonic transform "
        f"({1e3 * machine['transform_single']:.3g} in float32)."
    )


def growth_table(found):
    """The exponents of every step, of what ``python -m benchmarks.scaling`` wrote, as Markdown."""
    ways = found["found"]
    names = list(next(iter(ways.values())))
    rows = [[name, *(f"{way[name]['exponent']:.2f}" for way in ways.values())] for name in names]
    head = ["Step", "with nside", "with channels"]
    return "\n\n".join([_markdown(head, rows), _footer(found["about"])])


def endurance_table(found):
    """What disturbed commands came to, of what ``python -m benchmarks.endurance`` wrote, as Markdown.

    A count that ought to be zero and is not is bold.
    """
    rows = []
    for name, counts in found["found"].items():
        text, times = _DISTURBED[name]
        failed = sum(counts.get(key, 0) for key in ("reruns_that_failed", "processes_that_failed"))
        if "told_in_a_sentence" in counts or "done_all_the_same" in counts:  # a count of zero is left out
            failed += (
                counts["finished"] - counts.get("told_in_a_sentence", 0) - counts.get("done_all_the_same", 0)
            )
        left = sum(n for key, n in counts.items() if key.startswith("left_") or key == "processes_left")
        lost = (failed, counts.get("other_results", 0), left)
        rows.append([text, f"{counts.get(times, 0)}", *(f"**{n}**" if n else "0" for n in lost)])
    head = ["What was done", "Times", "Failed", "Other results", "Left behind"]
    return "\n\n".join([_markdown(head, rows), _footer(found["about"])])


def ledgers_table(ledgers, only=None):
    """Verdicts and numbers of several ledgers side by side, and the parts that fail, as Markdown.

    Parameters
    ----------
    ledgers
        A list of (entries, about), as `himap.app.stored.read_ledger` gives them.
    only
        Function from the entries of one claim, one of each ledger, to whether it is shown, such as
        `of_chapter("10_results")` or `differing`; all claims unless given, and then their count as well.
    """
    rows = list(zip(*(entries for entries, _ in ledgers), strict=True))
    made = [Provenance.of_stored(about) for _, about in ledgers]
    names = [
        f"{_ledger_name(one, made)}, {_skies(entries)}"
        for one, (entries, _) in zip(made, ledgers, strict=True)
    ]
    shown = [_claim(entries) for entries in rows if only is None or only(entries)]
    total = [["all", "", "", *map(_count, zip(*rows, strict=True))]] if only is None else []
    table = _markdown(["Claim", "Measured", "The paper says", *names], shown + total)
    return "\n\n".join([table, *_notes(names, made)])


def _notes(names, made):
    """What made each ledger, as paragraphs; what several have in common stands in one of its own."""
    lines = [one.footer().split(" · ") for one in made]
    shared = [word for word in lines[0] if len(lines) > 1 and all(word in line for line in lines)]
    common = [f"*All: {' · '.join(shared)}*"] if shared else []
    own = [" · ".join(word for word in line if word not in shared) for line in lines]
    return [*common, *(f"*{name}: {one}*" for name, one in zip(names, own, strict=True))]


def of_chapter(notebook):
    """Function for `ledgers_table`: the claims that a chapter shows."""
    return lambda entries: entries[0].claim.notebook == notebook


def differing(entries):
    """Function for `ledgers_table`: the claims whose verdict is not the same in all ledgers."""
    return len({entry.verdict for entry in entries}) > 1


def verdicts_table(ledgers):
    """How many claims of some ledgers have which verdict, as Markdown; `ledgers` as in `ledgers_table`."""
    every = [Provenance.of_stored(about) for _, about in ledgers]
    rows = []
    for entries, about in ledgers:
        made, realisations = Provenance.of_stored(about), len(entries[0].findings)
        rows.append([_ledger_name(made, every), f"{realisations}", *summary(entries).values()])
    signs = [f"{sign} {verdict}" for verdict, (sign, _) in BADGES.items()]
    return _markdown(["", "skies", *signs], rows)


def failed_table(entries):
    """What does not hold of each claim, and the numbers of its first realisation, as Markdown.

    Claims of which every part holds in every realisation, and those that do not apply, have no row.
    """
    rows = []
    for entry in entries:
        parts = [f"{part} ({n})" for part, n in entry.failed_parts().items()]
        if parts:
            rows.append([f"**{entry.claim.id}**", _signed(entry), "; ".join(parts), entry.sentence])
    return _markdown(["Claim", "", f"Does not hold (in how many of {_most(entries)})", "Numbers"], rows)


def _most(entries):
    return max(len(entry.findings) for entry in entries)


def _ledger_name(made, every):
    """Size of a ledger, its Galaxy if `every` has several, and what stands for SDecGMCA's default reading."""
    changed = dict(made.overrides)
    galaxies = {one.galaxy for one in every}
    galaxy = [_GALAXIES.get(made.galaxy.partition(" ")[0], made.galaxy)] if len(galaxies) > 1 else []
    method = [styles.numbered(changed["method"], None)] if "method" in changed else []
    reading = [str(changed["reading"])] if "reading" in changed else []
    return ", ".join([_SIZES.get(made.preset, made.preset), *galaxy, *method, *reading])


def _skies(entries):
    n = len(entries[0].findings)
    return f"{n} sk{'y' if n == 1 else 'ies'}"


def _claim(entries):
    """The cells of one claim: what is measured, what the paper has, verdict and number of each ledger."""
    claim = entries[0].claim
    cells = [_cell(entry) for entry in entries]
    return [f"**{claim.id}**", f"{claim.number} ({claim.beam})", claim.paper, *cells]


def _cell(entry):
    """Sign, number and failing parts of an entry; words where sign and number would both be a dash."""
    number = measured(entry)
    if entry.verdict == INAPPLICABLE and number == BADGES[INAPPLICABLE][0]:
        number = entry.verdict
    return f"{_signed(entry)} {number}{_which_fail(entry)}"


def _which_fail(entry):
    """The parts of a claim that its verdict hangs on: those that fail on half of the skies or more."""
    often = [part for part, n in entry.failed_parts().items() if 2 * n >= len(entry.findings)]
    if not often or entry.verdict not in (FAILED, IN_PART):
        return ""
    more = f"; and {len(often) - _PARTS} more" if len(often) > _PARTS else ""
    return f"<br>fails: {'; '.join(often[:_PARTS])}{more}"


def _signed(entry):
    """The sign of the verdict, and of one in part how many parts hold."""
    return f"{BADGES[entry.verdict][0]}{entry.label.removeprefix(entry.verdict)}"


def _count(entries):
    count = summary(entries)
    return " · ".join(f"{sign} {count[one]}" for one, (sign, _) in BADGES.items() if count[one])


def pictures(folders, results=None):
    """The stored figures of the paper, each from all folders, as Markdown: pictures by their relative path.

    Parameters
    ----------
    folders
        Names in the folder of results, each with a ``figures.json``.
    results
        Default: `RESULTS`.
    """
    chapters = {name: (one, text) for one in notebooks() for name, text in one.captions.items()}
    place = os.path.relpath(results or RESULTS, notebooks_folder())
    stored = {}
    for folder in folders:
        for row in read_stored(f"{folder}/figures", results)["figures"]:
            stored.setdefault((figure_order(row["paper"]), row["name"]), []).append((folder, row))
    parts = []
    for (_, name), several in sorted(stored.items()):
        chapter, caption = chapters[name]
        link = f"[{chapter.name}]({chapter.name}.ipynb)"
        parts.append(f"**Fig. {several[0][1]['paper']}.** {plain_caption(caption)} ({link}).")
        for folder, row in several:
            parts += _picture(f"{place}/{folder}/{name}.png", row)
    return "\n\n".join(parts)


def picture(folder, name, results=None):
    """One stored figure as Markdown: its picture by the relative path, its caption, and what made it."""
    place = os.path.relpath(results or RESULTS, notebooks_folder())
    row = stored_figure(folder, name, results)
    shown, made = _picture(f"{place}/{folder}/{name}.png", row)
    captions = [f": {plain_caption(one.captions[name])}" for one in notebooks() if name in one.captions]
    return f"{shown}\n\n*The paper's Fig. {row['paper']}, made again{''.join(captions)}.*\n\n{made}"


def _picture(path, row):
    """Two paragraphs: a stored figure that leads to itself in full size, and what made it."""
    made = _made(row["parameters"], row["execution"])
    return f"[![Fig. {row['paper']}, {made}]({path})]({path})", f"*{made}*"


def _made(parameters, execution):
    """One line: preset, Galaxy, other parameters that are not the notebook's, version and commit.

    Not the time: the picture says when it was drawn, which is before its notebook ended.
    """
    chosen = {"preset": "quick", "galaxy": "synthetic"} | parameters
    size = f"{chosen.pop('preset')}, {chosen.pop('galaxy')} Galaxy"
    changed = [f"{name} = {value}" for name, value in chosen.items()]
    edits = " with edits" if execution["dirty"] else ""
    return " · ".join([size, *changed, f"himap {execution['himap']}, commit {execution['commit']}{edits}"])


def _footer(about):
    return f"*{Provenance.of_stored(about).footer()}*"


def _markdown(head, rows):
    return "\n".join(Table(head, rows).markdown())
