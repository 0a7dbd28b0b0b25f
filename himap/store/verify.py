"""Checks whether changed code gives the same numbers: small calls, compared with stored results.

``probes.json`` holds, for every product and named class, a digest of its code, a summary of the results of
its calls, and the digests of all definitions behind them. If calls agree, definitions with another digest now
count as the former ones (``accepted.json``, `himap.store.fingerprint`) wherever they are used, except for
those used by something whose calls differ. The same applies to all definitions behind a product whose calls
agree, which may have moved to other modules. If calls agree, those of its users must agree too, unless these
use another product whose calls differ: results may have methods that are called elsewhere.
"""

import json
import os
import tempfile
import warnings
from collections import defaultdict
from dataclasses import is_dataclass
from hashlib import sha256
from unittest.mock import patch

import numpy as np

from himap.core.checks import fields_on
from himap.core.errors import InputError
from himap.core.files import atomic_files
from himap.core.progress import progress
from himap.store import fingerprint
from himap.store.store import tree_of

RTOL = 1e-5
"""Relative difference up to which two numbers are considered equal."""

_N_SAMPLES = 32  # of an array, and equally many means of its squares
_DIGITS = 8


def verify(module, *, renew=False, report=print):
    """Call changed code, accept what gives the stored numbers, and store numbers that are missing.

    Returns the names of those with other numbers than the stored ones. InputError without a checkout, which
    contains the stored results.

    Parameters
    ----------
    module
        It has ``CALLS``, {fixed name: functions without arguments} of all imported products and named
        classes; ``RTOLS``, {name: relative difference up to which its numbers are equal} if not `RTOL`; and
        ``further_codes``, a function from a `CodeTree` to {name: digest} of other code with calls.
    renew
        Store numbers that differ, as the reference for later comparisons.
    report
        Called with a line for each changed product or class.
    """
    if not fingerprint.ACCEPTED.parent.is_dir():
        raise InputError(
            f"there is no folder {fingerprint.ACCEPTED.parent}: verify code in a checkout of himap."
        )
    calls, names = module.CALLS, moved_names(module)
    probes = {"calls": {}, "places": {}} | fingerprint.stored_dict(fingerprint.PROBES)
    former = {name: one["code"] for name, one in probes["calls"].items()}
    parts = defaultdict(lambda: (set(), {}), tree_of(module).parts_of(module.__name__))
    if not names:
        report("no product, method or beam changed")
    others = []
    for name, (given, differing) in compared(module, names).items():
        others += [name] * bool(differing)
        said = "; ".join(differing[:3]) or ("the stored numbers" if name in former else "new")
        if renew or name not in former:
            probes["calls"][name] = {"gives": given}
        report(f"{name}: {said}{', stored' if differing and renew else ''}")
    agreeing = {*names} - {*others}
    uses = {name: parts[name][0] & agreeing for name in calls if name not in names}
    # If numbers are renewed, code that uses them has other numbers too, with unchanged code.
    rest = [name for name in uses if uses[name] or (renew and names)]
    by_themselves = {*others}
    for name, (given, differing) in compared(module, rest).items():
        if differing:
            if not parts[name][0] & by_themselves:  # which would explain the difference
                others += sorted(uses[name].difference(others))
            if renew:
                probes["calls"][name] = {"gives": given}
            report(f"{name}: {'; '.join(differing[:3])}{', stored' if renew else ''}")
    _accept(module, probes, former, {name: parts[name][1] for name in others}, renew)
    return others


def _accept(module, probes, former, others, renew):
    """Store changed code as its `former` code, except for `others`, {name: places behind it}."""
    stored, refused = probes["places"], {place for places in others.values() for place in places}
    agreeing = {place: code for place, code in stored.items() if place not in refused}
    tree = tree_of(module, former=agreeing, formers=frozenset(stored.values()))
    codes, places = codes_of(tree, module), {}
    for _, definitions in tree.parts_of(module.__name__).values():
        places |= definitions
    if not renew:
        places |= {place: stored[place] for place in refused & stored.keys()}
        # Moved or split definitions have no former digest: all behind a product are accepted together.
    agreeing = former.keys() & codes.keys() - {*others}
    accepts = {codes[name]: former[name] for name in agreeing if codes[name] != former[name]}
    for name in module.CALLS.keys() - ([] if renew else others):
        probes["calls"][name]["code"] = accepts.get(codes[name], codes[name])
    _store(fingerprint.ACCEPTED, fingerprint.stored_dict(fingerprint.ACCEPTED) | tree.accepts | accepts)
    calls_now = {name: probes["calls"][name] for name in sorted(module.CALLS)}
    _store(fingerprint.PROBES, {"calls": calls_now, "places": places})


def compared(module, names):
    """{name: (summary of the results of its calls in a module, differences from the stored one)}.

    Uses a separate cache, so that no results of former code are read.
    """
    probes, results = fingerprint.stored_dict(fingerprint.PROBES).get("calls", {}), {}
    quiet = warnings.catch_warnings(action="ignore")  # about small maps
    with tempfile.TemporaryDirectory() as folder, patch.dict(os.environ, HIMAP_CACHE=folder), quiet:
        for name in progress(names, "canonical calls"):
            given = [summary(call()) for call in module.CALLS[name]]
            stored = probes[name]["gives"] if name in probes else given
            results[name] = given, differences(stored, given, module.RTOLS.get(name, RTOL))
    return results


def moved_names(module):
    """Names with stored numbers of other code, and names without stored numbers."""
    probes = fingerprint.stored_dict(fingerprint.PROBES).get("calls", {})
    codes = codes_of(tree_of(module), module)
    return [name for name in module.CALLS if probes.get(name, {}).get("code") != codes[name]]


def codes_of(tree, module):
    """{name: digest} of all code with calls in a module."""
    return tree.fingerprint(module.__name__) | module.further_codes(tree)


def summary(value):
    """Stored summary of a value: numbers and text unchanged; for an array, some values and means of squares.

    Samples detect changes everywhere, means of squares large local changes.
    """
    if isinstance(value, np.ndarray) and value.ndim:
        kind = f"{value.dtype} {list(value.shape)}"
        if value.dtype.kind not in "fc":
            return {"kind": kind, "sha256": sha256(np.ascontiguousarray(value).tobytes()).hexdigest()[:16]}
        flat = np.ravel(value).view(value.real.dtype).astype(float)
        places = np.linspace(0, len(flat) - 1, min(_N_SAMPLES, len(flat))).astype(int)
        parts = np.array_split(flat, len(places)) if len(flat) else []
        squares = [np.sqrt(np.mean(part**2)) for part in parts]
        return {"kind": kind, "at": list(map(_round, flat[places])), "rms": list(map(_round, squares))}
    if isinstance(value, (np.generic, np.ndarray)):
        value = value.item()
    if isinstance(value, float):
        return {"kind": "number", "at": [_round(value)]}
    if is_dataclass(value):
        return {item.name: summary(one) for item, one in fields_on(value)}
    if isinstance(value, dict):
        return {str(key): summary(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [summary(item) for item in value]
    return value if value is None or isinstance(value, (bool, int, str)) else repr(value)


def _round(value):
    return float(f"{value:.{_DIGITS}g}")


def differences(stored, given, rtol=RTOL, place=""):
    """Differences between two summaries, and their size: a list of texts."""
    if isinstance(stored, dict) and isinstance(given, dict) and stored.keys() == given.keys():
        if "at" in stored and stored["kind"] == given["kind"]:
            is_single = stored["kind"].startswith(("float32", "complex"))
            worst = max(
                _worst(stored[part], given[part], is_single) for part in ("at", "rms") if part in stored
            )
            return [f"{place or 'result'} by {worst:.1e}"] if not worst <= rtol else []
        pairs = [(f"{place}.{name}", stored[name], given[name]) for name in stored]
    elif isinstance(stored, list) and isinstance(given, list) and len(stored) == len(given):
        pairs = [(f"{place}[{n}]", *pair) for n, pair in enumerate(zip(stored, given, strict=True))]
    else:
        return (
            [] if stored == given else [f"{place or 'result'}: {given!r:.60} in the place of {stored!r:.60}"]
        )
    return [text for where, one, other in pairs for text in differences(one, other, rtol, where.lstrip("."))]


def _worst(stored, given, is_single):
    """Largest difference relative to a number, or to the median of all if that is larger.

    If `is_single`, relative to their root mean square: small coefficients and single-precision numbers have
    the rounding errors of large ones.
    """
    one, other = np.array(stored, dtype=float), np.array(given, dtype=float)
    if one.shape != other.shape or not np.array_equal(np.isnan(one), np.isnan(other)):
        return np.inf
    if not one.size:
        return 0.0
    known = ~np.isnan(one) & (one != other)
    common = np.sqrt(np.nanmean(one**2)) if is_single else np.nanmedian(np.abs(one))
    scale = np.maximum(np.abs(one), common)[known]
    with np.errstate(divide="ignore"):
        return float(np.max(np.abs(one - other)[known] / scale, initial=0))


def _store(path, content):
    """Write a dict of dicts, or of texts, with a line for each innermost one that is not a number."""
    text = json.dumps(content, sort_keys=True, indent=0, separators=(",", ": "))
    with atomic_files(path) as (temporary,):
        temporary.write_text(text + "\n")
