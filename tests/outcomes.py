"""Outcomes of readings that several tests share."""

import pandas as pd
from ledgers import entry

from himap.paper.claims import INAPPLICABLE
from himap.paper.readings import Outcome

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
