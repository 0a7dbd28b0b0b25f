"""Outcomes of readings that several tests share."""

import numpy as np
from ledgers import entry

from himap.paper.claims import INAPPLICABLE
from himap.paper.readings import Outcome, Run


def run(seed=7, restart=0, curves=None, without=(), **changed):
    """A `Run`; `changed` and `without` are of its numbers, with _ for spaces in names."""
    numbers = {
        "C/C0, 2 to 4": 1.25,
        "C/C0, 100 to 200": 0.99,
        "P/P0, k < 0.03": 0.5,
        "P/P0, k > 0.1": 1.0,
        "bump": 1.01,
        "mean error": 0.02,
        "largest error": 0.07,
        "flagged": 0.01,
        "near the plane": 0.9,
        "iterations": 125.0,
        "converged": 1.0,
    } | {name.replace("_", " "): value for name, value in changed.items()}
    curves = curves or {
        "C/C0": (np.array([2.0, 3.0, 4.5]), np.array([1.5, 1.25, 1.0])),
        "P/P0": (np.array([0.1, 0.2]), np.array([0.5, 1.0])),
    }
    numbers = {name: value for name, value in numbers.items() if name not in without}
    return Run(seed=seed, restart=restart, numbers=numbers, curves=curves)


def outcome(verdicts, *, values=None, runs=None):
    """Of {claim: verdict, or one for each of seeds 7, 8, ...} on these seeds."""
    entries = {}
    for claim, by_seed in verdicts.items():
        by_seed = [by_seed] if isinstance(by_seed, str) else by_seed
        value = (values or {}).get(claim, 0.5)
        measured = [None if verdict == INAPPLICABLE else value for verdict in by_seed]
        entries[claim] = entry(*by_seed, values=measured, id=claim, first=7)
    n_seeds = max(len(one.findings) for one in entries.values())
    return Outcome(entries=entries, runs=tuple(runs or [run(7 + n) for n in range(n_seeds)]))
