"""Entries of a ledger, and outcomes of readings, that several tests share."""

import math

import pandas as pd
from matplotlib.colors import to_rgb

from himap.paper.claims import FAILED, IN_PART, INAPPLICABLE, REPRODUCED
from himap.paper.claims.base import Finding, Part
from himap.paper.claims.entries import entries, finding_rows
from himap.paper.experiments.claims import EXPERIMENT
from himap.paper.readings import Outcome

ABOUT = {"preset": "ci", "overrides": [], "galaxy": "synthetic", "seed": 1, "commit": "abc1234"}
ABOUT |= {"dirty": False, "seconds": 10.0, "version": "0.1.0", "packages": [], "code": {"code": "today"}}
"""What a record says of what made it."""

TINY = {"preset": "ci", "survey": {"nside": 8, "box_cells": 16, "n_channels": 25, "freq_max": 1025.0}}
SHORT = ("n_warmup", 2), ("n_refinement", 2), ("warmup_tolerance", 1e300), ("tolerance", 1e300)
"""A sky on which all claims can be judged, and options of an SDecGMCA that ends soon."""

PCA, NOT_PCA = Part("PCA/ICA a", True, True, "PCA/ICA"), Part("PCA/ICA a", False, True, "PCA/ICA")
SD, NOT_SD = Part("SD a", True, True, "SD"), Part("SD a", False, True, "SD")
PARTS = {REPRODUCED: (PCA, SD), IN_PART: (PCA, NOT_SD), FAILED: (NOT_PCA, NOT_SD), INAPPLICABLE: ()}


def finding(verdict, value=0.5, sentence=""):
    """The `Finding` of a member in which a claim about two methods holds for both, one, or none."""
    return Finding(value=math.nan if value is None else value, parts=PARTS[verdict], sentence=sentence)


def entry_of(findings, id="D1"):
    """The `Entry` of {(seed, restart): `Finding`}."""
    rows = [
        {"seed": seed} | row
        for (seed, restart), found in findings.items()
        for row in finding_rows({id: found}, restart)
    ]
    (one,) = entries(EXPERIMENT.frame(rows))
    return one


def entry(*verdicts, values=None, id="D1", first=0):
    """An `Entry` of seeds `first`, `first` + 1, ..., each with one restart."""
    values = values or [0.5] * len(verdicts)
    pairs = enumerate(zip(verdicts, values, strict=True), first)
    return entry_of({(seed, 0): finding(*pair, f"{seed}.") for seed, pair in pairs}, id)


def judged(*skies, value=0.5):
    """An `Entry` of skies, each a list of tuples of `Part`, one for each restart."""
    return entry_of(
        {
            (seed, restart): Finding(value, parts, "")
            for seed, restarts in enumerate(skies)
            for restart, parts in enumerate(restarts)
        }
    )


NUMBERS = {
    "C/C0, 2 to 4": 1.25,
    "C/C0, 100 to 200": 0.99,
    "P/P0, k < 0.03": 0.5,
    "P/P0, k > 0.1": 1.0,
    "bump": 1.01,
    "mean error": 0.02,
}
CURVES = {"C/C0": ((2.0, 1.5), (3.0, 1.25), (4.5, 1.0)), "P/P0": ((0.1, 0.5), (0.2, 1.0))}


def run(seed=7, restart=0, **changed):
    """Numbers of one member; None for what is missing."""
    return {"seed": seed, "restart": restart} | NUMBERS | changed


def outcome(verdicts, *, values=None, runs=None):
    """Of {claim: verdict, or one for each of seeds 7, 8, ...} on these seeds."""
    entries = {}
    for claim, by_seed in verdicts.items():
        by_seed = [by_seed] if isinstance(by_seed, str) else by_seed
        value = (values or {}).get(claim, 0.5)
        measured = [None if verdict == INAPPLICABLE else value for verdict in by_seed]
        entries[claim] = entry(*by_seed, values=measured, id=claim, first=7)
    n_seeds = max((len(one.members) for one in entries.values()), default=1)
    numbers = pd.DataFrame(runs or [run(7 + n) for n in range(n_seeds)]).set_index(["seed", "restart"])
    curves = [
        {"seed": seed, "restart": restart, "quantity": name, "x": x, "value": value}
        for seed, restart in numbers.index
        for name, points in CURVES.items()
        for x, value in points
    ]
    return Outcome(entries=entries, numbers=numbers, curves=pd.DataFrame(curves), statements=0.0)


def luminance(colour):
    """Relative luminance of a colour such as #00664b or white (WCAG)."""
    shares = to_rgb(colour)
    linear = [share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4 for share in shares]
    return sum(weight * share for weight, share in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def contrast(one, two):
    """Of two colours, 1 to 21 (WCAG): 4.5 is what text needs."""
    dark, light = sorted((luminance(one), luminance(two)))
    return (light + 0.05) / (dark + 0.05)
