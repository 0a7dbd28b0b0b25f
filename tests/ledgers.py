"""Entries of a ledger that several tests share."""

import math

from matplotlib.colors import to_rgb

from himap.paper.claims import FAILED, IN_PART, INAPPLICABLE, REPRODUCED, Finding, Part
from himap.paper.claims.entries import entries, finding_rows
from himap.paper.experiments.claims import EXPERIMENT

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


def luminance(colour):
    """Relative luminance of a colour such as #00664b or white (WCAG)."""
    shares = to_rgb(colour)
    linear = [share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4 for share in shares]
    return sum(weight * share for weight, share in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def contrast(one, two):
    """Of two colours, 1 to 21 (WCAG): 4.5 is what text needs."""
    dark, light = sorted((luminance(one), luminance(two)))
    return (light + 0.05) / (dark + 0.05)
