"""Under what else a claim holds, from the stored records: the causes of verdicts."""

from contextlib import suppress
from pathlib import Path

from himap.app.stored import RESULTS
from himap.core.errors import InputError
from himap.figures import styles
from himap.paper.claims.entries import entries
from himap.paper.experiments import find_experiment
from himap.paper.readings import outcomes
from himap.paper.record import Record
from himap.store.provenance import Provenance

SIZES = {"paper": "the paper's size", "laptop": "half size", "quick": "quarter size"}
"""{preset: in words}."""

GALAXIES = {"templates": "real Galaxy", "synthetic": "synthetic Galaxy"}
"""{source: in words}."""


def other_records(about, folder=RESULTS):
    """{what differs from a ledger: {claim: `Entry`}} of the stored records, for `ledger_table.cause`.

    In a record of several readings a claim that holds under that of the ledger, or under all of them, is due
    to the size or the Galaxy, not to a reading.

    Parameters
    ----------
    about
        Provenance of the ledger, as `himap.app.stored.read_ledger` gives it.
    folder
        Of the records.
    """
    made, found = Provenance.of_stored(about), {}
    for path in sorted(Path(folder).glob("*.json")):
        kind = path.stem.partition("_")[0]
        if kind in ("claims", "readings", "restarts"):
            with suppress(InputError):  # of claims as they were judged before
                for words, by_id in _judgements(Record.load(find_experiment(kind), path), made):
                    found.setdefault(words, {}).update(by_id)
    return found


def _judgements(record, made):
    """(what differs from `made`, {claim: `Entry`}) of each reading in a record, without what is the same."""
    words, changed = _difference(made, record.made), dict(record.made.overrides)
    own = dict(made.overrides).get("reading", "default")
    if record.experiment.name == "claims":
        label = own if "method" in changed else changed.get("reading", "default")
        several = {label: {entry.claim.id: entry for entry in entries(record.rows)}}
    else:
        several = {label: one.entries for label, one in outcomes(record.rows).items()}
    judging = [several[own]] if own in several else list(several.values()) if len(several) > 1 else []
    holding = [{id for id, entry in by_id.items() if entry.holds} for by_id in judging]
    shared = set.intersection(*holding) if holding else set()  # which are not due to a reading
    for label, by_id in several.items():
        other = {id: entry for id, entry in by_id.items() if id not in shared}
        if label != own:
            yield ", ".join(filter(None, (f"reading {label}", words))), other
    if words and judging:
        yield words, several.get(own) or {id: judging[0][id] for id in shared}


def _difference(made, other):
    """What of another `Provenance` differs, in words: method, size or Galaxy; may be empty."""
    changed = dict(other.overrides)
    words = [
        f"{styles.numbered(changed['method'], None)} in its place" if "method" in changed else "",
        SIZES.get(other.preset, other.preset) if other.preset != made.preset else "",
        GALAXIES.get(other.galaxy.partition(" ")[0], other.galaxy) if other.galaxy != made.galaxy else "",
        box_words(other) if box_words(other) != box_words(made) else "",
    ]
    return ", ".join(filter(None, words))


def box_words(made):
    """The HI box of a `Provenance` in words, if it is not that of the preset."""
    n_cells = dict(made.overrides).get("box_cells")
    return f"HI box of {n_cells}³ cells" if n_cells else ""
