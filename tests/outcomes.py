"""Outcomes of readings that several tests share."""

import math

from himap.paper.claims import FAILED, IN_PART, INAPPLICABLE, REPRODUCED
from himap.paper.readings import Judgement, Outcome, Run

COUNTS = {REPRODUCED: (2, 2), IN_PART: (1, 2), FAILED: (0, 2), INAPPLICABLE: (0, 0)}


def judgement(verdict, value=0.5):
    held, total = COUNTS[verdict]
    value = math.nan if verdict == INAPPLICABLE else value
    return Judgement(verdict=verdict, n_held=held, n_parts=total, value=value)


def run(seed=7, noise_level=1.0, **changed):
    measured = {
        "angular": {"2 to 4": 1.25, "100 to 200": 0.99},
        "frequency": {"k < 0.03": 0.5, "k > 0.1": 1.0},
        "bump": 1.01,
        "mean_error": 0.02,
        "largest_error": 0.07,
        "flagged": 0.01,
        "near_plane": 0.9,
        "n_iterations": 125,
        "settled": True,
        "degrees": (2.0, 3.0, 4.5),
        "angular_ratio": (1.5, 1.25, 1.0),
        "k": (0.1, 0.2),
        "frequency_ratio": (0.5, 1.0),
    }
    return Run(seed=seed, noise_level=noise_level, **measured | changed)


def outcome(verdicts, *, values=None, runs=None):
    """Of {claim: verdict, or one for each of seeds 7, 8, ...} on these seeds."""
    values = values or {}
    judged = {}
    for claim, by_seed in verdicts.items():
        by_seed = [by_seed] if isinstance(by_seed, str) else by_seed
        judged[claim] = {
            7 + n: judgement(verdict, values.get(claim, 0.5)) for n, verdict in enumerate(by_seed)
        }
    n_seeds = max(map(len, judged.values()))
    return Outcome(judged=judged, runs=tuple(runs or [run(7 + n) for n in range(n_seeds)]))
