"""Stored results that take hours to compute: readers, derived quantities, and which are stale.

These are ledgers and records that explain differences between them, the times of the steps at two sizes and
their scaling, and folders of figures. Records and figures carry the fingerprint of the code that made them;
parameters are stored separately. Appearance does not count, and accepted code is equivalent
(`himap.store.verify`). Timings carry none: they are specific to a machine and a day. A stale result is
reported, not recomputed.
"""

import json
import math
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path

from himap.app.notebooks import notebooks
from himap.core.errors import InputError
from himap.core.memory import estimate
from himap.core.survey import PRESETS, Survey
from himap.figures import styles
from himap.paper.claims.entries import entries
from himap.paper.experiments import EXPERIMENTS, find_experiment, measuring_code
from himap.paper.experiments.claims import too_coarse
from himap.paper.ledger_table import READING
from himap.paper.readings import find_reading, outcomes
from himap.paper.record import Record
from himap.store.fingerprint import ACCEPTED, PROBES, CodeTree, moved
from himap.store.provenance import Provenance

RESULTS = Path(__file__).resolve().parents[2] / "book" / "results"
"""The folder of stored results in a checkout."""

LEDGER = RESULTS / "claims_laptop.json"
"""The record of claims shown in the book."""

SIZES = {"paper": "the paper's size", "laptop": "half size", "quick": "quarter size"}
"""{preset: description}."""

GALAXIES = {"templates": "real Galaxy", "synthetic": "synthetic Galaxy"}
"""{source: description}."""

_TIMES = {"HI light cone": 1, "observations, three beams": 1, "BeamSubspace": 0, "all measures": 3 * 6}
"""Number of executions of a step for Figs. 1 and 2, {step: times}; default: once per beam, three times."""

CHOICES = {
    "box_cells": "HI box of {}³ cells",
    "r_smooth": "HI smoothed by {:g} Mpc/h",
    "hi_bias": {"contrast": "HI bias times the density contrast"},
    "average": {"ratios": "mean over channels of C/C0", "middle": "C/C0 of the middle channel"},
    "taper": {"hann": "Hann taper along frequency"},
    "polynomial": {"logarithm": "polynomial of log T in log ν"},
}
"""{parameter of the claims not about SDecGMCA: description of records with it}."""

_HELD = {"HI light cone": "HI light cone", "observations, three beams": "observing"}
_CORES = 2  # of the machine of the measured steps


def read_stored(name, folder=None):
    """The content of a JSON file of stored results, such as ``steps_paper`` or ``paper_templates/figures``.

    `name` is its path in the folder, default `RESULTS`, without the ending. InputError if there is no such
    file, or it is not JSON.
    """
    path = Path(folder or RESULTS, f"{name}.json")
    try:
        return json.loads(path.read_text())
    except FileNotFoundError:
        raise InputError(
            f"there is no stored result {path}; the page on contributing explains how to make it."
        ) from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path} is not a stored result ({error}).") from None


def read_ledger(path=LEDGER):
    """The `himap.paper.claims.entries.Entry` of each claim in a record, and its provenance, (list, dict).

    From a record named as one of restarts, the first reading is used. InputError if there is no such file.
    """
    kind = "restarts" if Path(path).stem.startswith("restarts_") else "claims"
    record = Record.load(find_experiment(kind), path)
    return [*next(iter(_by_reading(record).values())).values()], record.about


def _by_reading(record):
    """{reading: {claim: `Entry`}} of a record of claims, readings or restarts."""
    if record.experiment.name != "claims":
        return {label: one.entries for label, one in outcomes(record.rows).items()}
    reading = dict(record.made.overrides).get("reading", "default")
    return {reading: {entry.claim.id: entry for entry in entries(record.rows)}}


def other_records(about, folder=RESULTS):
    """{difference from a ledger: {claim: `Entry`}} of the stored records, for `ledger_table.cause`.

    The ledger is identified by its provenance, as from `read_ledger`. Records with another method in place of
    SDecGMCA are excluded. In a record of several readings, a claim that holds under that of the ledger, or
    under all of them, is due to the size or the Galaxy, not to a reading.
    """
    made, others = Provenance.of_stored(about), {}
    for path in sorted(Path(folder).glob("*.json")):
        kind = path.stem.partition("_")[0]
        if kind in ("claims", "readings", "restarts"):
            with suppress(InputError):  # outdated claims
                for words, by_id in _judgements(Record.load(find_experiment(kind), path), made):
                    others.setdefault(words, {}).update(by_id)
    return others


def _judgements(record, made):
    """Yield (difference from `made`, {claim: `Entry`}) of each reading in a record, if not in common."""
    usual, words, changed = record_words(made), record_words(record.made), dict(record.made.overrides)
    if words["method"] != usual["method"]:  # not relevant for SDecGMCA
        return
    names = "size", "galaxy", *CHOICES
    words = ", ".join(words[name] for name in names if words[name] not in ("", usual[name]))
    reading = dict(made.overrides).get("reading", "default")
    own = {one.name: changed[one.name] for one in fields(Survey) if one.name in changed}
    coarse = too_coarse(Survey.preset(record.made.preset, **own))
    several = {  # a reading that differs only in name is the ledger's
        reading if find_reading(label).values == find_reading(reading).values else label: {
            id: entry for id, entry in by_id.items() if id not in coarse
        }
        for label, by_id in _by_reading(record).items()
    }
    judging = [several[reading]] if reading in several else list(several.values()) if len(several) > 1 else []
    holding = [{id for id, entry in by_id.items() if entry.holds} for by_id in judging]
    shared = set.intersection(*holding) if holding else set()  # not due to a reading
    for label, by_id in several.items():
        other = {id: entry for id, entry in by_id.items() if id not in shared}
        if label != reading:
            yield ", ".join(filter(None, (words, f"{READING}{label}"))), other
    if words and judging:
        yield words, several.get(reading) or {id: judging[0][id] for id in shared}


def record_words(made):
    """{setting: description, empty if standard} of a record, from its `Provenance`."""
    changed, galaxy = dict(made.overrides), made.galaxy.partition(" ")[0]
    choices = dict.fromkeys(CHOICES, "")
    for name in CHOICES.keys() & changed:
        words, value = CHOICES[name], changed[name]
        choices[name] = words.get(value, "") if isinstance(words, dict) else words.format(value)
    return {
        "size": SIZES.get(made.preset, made.preset),
        "galaxy": GALAXIES.get(galaxy, galaxy),
        "method": styles.numbered(changed["method"], None) if "method" in changed else "",
        "reading": reading if (reading := changed.get("reading", "default")) != "default" else "",
    } | choices


def stored_figures(results=None, folders=None):
    """{folder: {name: stored data of a figure, a dict}} of some folders of figures, default all.

    `results` is the folder as in `read_stored`. InputError if there is no such folder.
    """
    if folders is None:
        folders = sorted(path.parent.name for path in Path(results or RESULTS).glob("*/figures.json"))
    rows = {folder: read_stored(f"{folder}/figures", results)["figures"] for folder in folders}
    return {folder: {row["name"]: row for row in several} for folder, several in rows.items()}


def stored_figure(folder, name, results=None):
    """Stored data of a figure of a folder, a dict: its number in the paper, provenance, and curves.

    InputError if there is no such folder or figure.
    """
    rows = stored_figures(results, [folder])[folder]
    if name not in rows:
        raise InputError(f"there is no stored figure {name} in {folder}; there are {', '.join(rows)}.")
    return rows[name]


def extrapolated(smaller, larger, scaling, *, n_realisations, **size):
    """Extrapolated cost of every step at another size, for the paper's Figs. 1 and 2.

    The exponent with channels is that of the scaling; the exponent with nside follows from the remaining
    growth between the two sizes: small maps, used for the scaling, grow more slowly than large ones.

    Parameters
    ----------
    smaller, larger, scaling
        The steps at two sizes and their scaling, as written by ``python -m benchmarks`` and its ``scaling``.
    size
        Fields of the `Survey`: ``nside`` and ``n_channels``, and others that differ from the paper's preset.

    Returns
    -------
    list of dict
        For each step its name ("step"), the time of one execution ("minutes"), the number of executions per
        realisation ("times"), the total ("core_hours"), and the memory required by himap ("gigabytes").
    """
    memory = estimate(replace(PRESETS["paper"], **size))
    before, after = smaller["about"]["size"], larger["about"]["size"]
    rows = []
    for small, large in zip(smaller["steps"], larger["steps"], strict=True):
        name = large["step"]
        times = _TIMES.get(name, 3)
        if not times:
            continue
        with_channels = scaling["found"]["n_channels"][name]["exponent"]
        growth = large["seconds"] / small["seconds"]
        growth /= (after["n_channels"] / before["n_channels"]) ** with_channels
        # 0 for steps that end at the same l at both sizes, such as SDecGMCA.
        with_nside = max(0.0, math.log(growth) / math.log(after["nside"] / before["nside"]))
        exponents = {"nside": with_nside, "n_channels": with_channels}
        factors = [(size[axis] / after[axis]) ** exponent for axis, exponent in exponents.items()]
        once = large["seconds"] * math.prod(factors)
        rows.append(
            {
                "step": name,
                "minutes": once / 60,
                "times": times,
                "core_hours": _CORES * n_realisations * times * once / 3600,
                "gigabytes": memory[_HELD.get(name, "cleaning")] / 1e9,
            }
        )
    return rows


@dataclass(frozen=True, kw_only=True)
class StoredResult:
    """A file of results, and its provenance.

    Attributes
    ----------
    name
        Of the file, or of the folder of figures.
    commits
        {(short commit, whether there were edits)} of its creation.
    codes
        {name: fingerprint of the code}, None if not stored: for a record the name of its experiment, for a
        folder of figures their names, for timings empty.
    checked
        Short commit at which one sky was measured again, with equal numbers; empty if never. The fingerprint
        is then of that code.
    """

    path: Path
    name: str
    preset: str
    galaxy: str
    commits: set[tuple[str, bool]]
    seconds: float
    codes: dict[str, dict | None]
    checked: str = ""


def read_result(path):
    """The `StoredResult` at `path`."""
    content = json.loads(path.read_text(encoding="utf-8"))
    if "figures" in content:
        name, rows, checked = path.parent.name, content["figures"], {}
        made = {"preset": "quick", "galaxy": "synthetic"} | rows[0]["parameters"]
        codes = {row["name"]: row.get("code") for row in rows}
        # Figures of a notebook share an execution.
        runs = {json.dumps(row["execution"]): row["execution"] for row in rows}.values()
    else:
        name, made = path.stem, content["about"]
        checked, runs = made.get("checked", {}), [made]
        code = checked.get("code", made.get("code"))
        codes = {content["experiment"]: code} if "experiment" in content else {}
    return StoredResult(
        path=path,
        name=name,
        preset=made["preset"],
        galaxy=made["galaxy"],
        commits={(run["commit"], run["dirty"]) for run in runs},
        seconds=sum(run["seconds"] for run in runs),
        codes=codes,
        checked=checked.get("commit", ""),
    )


def stored_results(folder):
    """All stored results of a folder by name, a list of `StoredResult`."""
    files = [*folder.glob("*.json"), *folder.glob("*/figures.json")]
    files = [path for path in files if path.name not in (ACCEPTED.name, PROBES.name)]
    return sorted(map(read_result, files), key=lambda result: result.name)


def stale_results(folder, notebooks_folder):
    """Stored results of a folder that the current code and notebooks may not reproduce: {name: reason}."""
    tree, states, results = CodeTree(), {}, stored_results(folder)
    today = {name: measuring_code(name, tree) for name in EXPERIMENTS}
    known = {name for result in results for name in result.codes}
    for notebook in notebooks(notebooks_folder):
        shown = [name for name in notebook.captions if name in known]
        today |= {name: notebook.figure_fingerprint(name, tree) for name in shown}
    for result in results:
        changes = {name: moved(code, today.get(name, "")) for name, code in result.codes.items()}
        changed = [name for name, parts in changes.items() if parts]
        others = dict.fromkeys(part for parts in changes.values() for part in parts if part != "code")
        if changed:
            which = f": {', '.join(others)}" if others else ""
            states[result.name] = f"the code behind {', '.join(changed)} changed{which}"
    return states
