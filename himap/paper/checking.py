"""Stored results held against one sky that is measured again, and marked as what today's code gives."""

import math

from himap.errors import InputError
from himap.paper.ledger import read_ledger, write_ledger
from himap.products.provenance import environment

__all__ = ["check_ledger", "marked", "same"]

_SAME = 1e-3  # relative, and absolute below 1
_OF_ALL = ("n_realisations", "nudged")  # what one sky again does not have


def same(one, other):
    """Whether two values agree, numbers to a thousandth, in lists and tuples too."""
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other) <= _SAME * max(1, abs(one)) or (math.isnan(one) and math.isnan(other))
    return one == other


def marked(about, code):
    """`about`, what made a result, with "checked": the fingerprint of the code that gave the same again."""
    made = environment()
    return about | {"checked": {"code": code, "commit": made["commit"], "dirty": made["dirty"]}}


def check_ledger(entries, path, about):
    """Mark a ledger as what today's code gives, if one of its realisations says so.

    Parameters
    ----------
    entries
        Of one realisation of it, judged again, a list of `himap.paper.ledger.Entry`.
    path
        Of the ledger; it gets "checked" beside what made it.
    about
        What made the entries, of the same names as in the ledger; "code" is the fingerprint of their code.

    Raises
    ------
    InputError
        The ledger was made with other parameters, or has other findings; it stays as it is.
    """
    stored, told = read_ledger(path)
    differing = [name for name in ("preset", "galaxy") if about[name] != told[name]]
    differing += sorted(_changed(about) ^ _changed(told))
    if differing:
        raise InputError(
            f"{path} was made with other parameters ({', '.join(map(str, differing))}): give those that it "
            "was made with."
        )
    (seed,) = entries[0].findings
    own = {entry.claim["id"]: entry.findings.get(seed) for entry in stored}
    again = {entry.claim["id"]: entry.findings[seed] for entry in entries}
    moved = [name for name in {**again, **own} if not _agree(again.get(name), own.get(name))]
    if moved:
        raise InputError(
            f"{len(moved)} of {len(own)} claims are not those of the realisation {seed} in {path} any more, "
            f"{', '.join(moved)}; judge all of it again."
        )
    write_ledger(stored, path, marked(told, about["code"]))


def _changed(about):
    """The parameters that differ from their defaults, of one sky, as texts."""
    return {f"{name}={value}" for name, value in about["overrides"] if name not in _OF_ALL}


def _agree(found, stored):
    if found is None or stored is None:
        return False
    numbers, parts = zip(*(_of(one) for one in (found, stored)), strict=True)
    return same(*numbers) and same(*parts)


def _of(finding):
    """Its number, and which parts hold."""
    return float(finding.value), [(part.name, bool(part.held)) for part in finding.parts]
