"""Code that gives the numbers of former code, and what moved between two fingerprints.

``book/results/accepted.json`` holds {digest of a definition: digest of the former one}, where
`himap.store.verify` found the same numbers. A `himap.store.fingerprint.CodeTree` counts the one as the
other, so that all that names it, stamps of notebooks, stored results and keys of the cache, stays as it was.
"""

import json
from functools import lru_cache
from pathlib import Path

ACCEPTED = Path(__file__).resolve().parents[2] / "book" / "results" / "accepted.json"
"""In a checkout; himap without one accepts nothing."""

PROBES = ACCEPTED.with_name("probes.json")
"""Beside it, the numbers that code is compared with (`himap.store.verify`)."""


def moved(stored, today, *, looks=False):
    """The names under which a stored fingerprint is another today: empty if what was made of it is fresh.

    Parameters
    ----------
    stored, today
        {"code", "look", name of a product or class: digest}, as a `himap.store.fingerprint.CodeTree` has
        them. A name that only `today` has, say of a new method, moves nothing. None, or a text as it was once
        kept, for one that cannot be compared.
    looks
        Whether what only shows numbers counts too.
    """
    if stored == today:
        return []
    if not (isinstance(stored, dict) and isinstance(today, dict)):
        return ["code"]
    names = [name for name in stored if looks or name != "look"]
    return [name for name in names if stored[name] != today.get(name)]


def accepted():
    """{digest: digest of former code with the same numbers}, the same object while the file is the same."""
    try:
        return _read(ACCEPTED, ACCEPTED.stat().st_mtime_ns)
    except FileNotFoundError:
        return _NOTHING


_NOTHING = {}


@lru_cache(maxsize=4)
def _read(path, mtime):
    return json.loads(path.read_text(encoding="utf-8"))
