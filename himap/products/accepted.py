"""Code that gives the numbers of former code: which fingerprints count as which.

``book/results/accepted.json`` holds, for products and named classes by their fixed names, {digest of the code
now: digest of former code}, where `himap.products.verify` found the same numbers. Whoever compares
fingerprints, or makes a key of one, does so here: the stamps of notebooks, stored records, keys of the cache.
"""

import json
from functools import lru_cache
from pathlib import Path

__all__ = ["ACCEPTED", "PROBES", "accepted", "followed", "moved"]

ACCEPTED = Path(__file__).resolve().parents[2] / "book" / "results" / "accepted.json"
"""In a checkout; himap without one accepts nothing."""

PROBES = ACCEPTED.with_name("probes.json")
"""Beside it, the numbers that code is compared with (`himap.products.verify`)."""


def moved(stored, today, *, looks=False):
    """The names under which a stored fingerprint is another today: empty if what was made of it is fresh.

    Parameters
    ----------
    stored, today
        {"code", "look", name of a product or class: digest}, as a `himap.products.fingerprint.CodeTree` has
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
    return [n for n in names if n not in today or followed(n, stored[n]) != followed(n, today[n])]


def followed(name, digest):
    """The digest of the code whose numbers are accepted for those of `digest`; itself if there is none."""
    return accepted().get(name, {}).get(digest, digest)


def accepted():
    """{name: {digest: digest of the former code with the same numbers}}."""
    try:
        return _read(ACCEPTED, ACCEPTED.stat().st_mtime_ns)
    except FileNotFoundError:
        return _NOTHING


_NOTHING = {}


@lru_cache(maxsize=4)
def _read(path, mtime):
    return json.loads(path.read_text(encoding="utf-8"))
