"""Under what else a claim holds, from the stored records: the causes of verdicts."""

from contextlib import suppress
from pathlib import Path

from himap.app.stored import RESULTS
from himap.core.errors import InputError
from himap.figures import styles
from himap.paper.claims import CLAIMS
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

    In a record of several readings a claim that holds under all of them, or by default, is due to the size or
    the Galaxy, not to a reading.

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
    words = _difference(made, record.made)
    if record.experiment.name == "claims":
        several = {"default": {entry.claim.id: entry for entry in entries(record.rows)}}
    else:
        several = {label: one.entries for label, one in outcomes(record.rows).items()}
    shared = set(CLAIMS)
    for by_id in several.values():
        shared &= {id for id, one in several.get("default", by_id).items() if one.holds}
    for label, by_id in several.items():
        if label != "default":
            own = {id: one for id, one in by_id.items() if id not in shared}
            yield ", ".join(filter(None, (f"reading {label}", words))), own
    if words:
        base = next(iter(several.values()))
        yield words, several.get("default") or {id: base[id] for id in shared}


def _difference(made, other):
    """What of another `Provenance` differs, in words: Galaxy, size, method or reading; may be empty."""
    changed = dict(other.overrides)
    words = [
        f"{styles.numbered(changed['method'], None)} in its place" if "method" in changed else "",
        f"reading {changed['reading']}" if changed.get("reading", "all") != "all" else "",
        SIZES.get(other.preset, other.preset) if other.preset != made.preset else "",
        GALAXIES.get(other.galaxy.partition(" ")[0], other.galaxy) if other.galaxy != made.galaxy else "",
    ]
    return ", ".join(filter(None, words))
