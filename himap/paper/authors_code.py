"""Compare SDecGMCA with its authors' public code: step by step on a small problem, and as an ensemble.

The problem and the results of the code of Carloni Gertosio & Bobin (2021) are in a file of arrays
(``tests/data/sdecgmca_small.npz``): 16 channels, l <= 64, nside 32, 4 sources, beams three times as wide as
MeerKAT's. The ensemble (``tests/data/authors_ensemble.json``) holds runs of that code on the sky of the
preset ci, and some on that of laptop, seed 2025, whose starts differ by 1e-10; the experiment `authors`
measures the same quantities with himap.
"""

import itertools
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from himap.core.errors import InputError
from himap.removal import harmonic
from himap.removal.blurred_mixture import BlurredMixture
from himap.removal.sdecgmca.method import SDecGMCA
from himap.removal.sdecgmca.scales import Scales

VARIANTS = {
    "mad": {},
    "analytic": {"thresholds": "analytic"},
    "nonnegative": {"sign": "nonnegative"},
    "matrix": {"coefficients": "matrix", "last_coefficients": "matrix"},
}
"""{variant of the code that was run: options of `SDecGMCA` in addition to the reading "code"}."""

ITERATIONS = (1, 2, 3, 5, 10)
"""Iterations after which A is compared."""

CHANGE = 1e-12
"""Relative change of the first A, which shows the effect of rounding alone."""

_NSIDE = 32
_COMMON = {"n_sources": 4, "regularisation": 0.01, "share": 0.7, "reading": "code", "pixels": "healpix"}


@dataclass(frozen=True, kw_only=True)
class AuthorsCode:
    """The small problem and the results of that code, {name: array}."""

    arrays: dict

    @classmethod
    def read(cls, path):
        """Read the file; InputError if there is none, or it is another one."""
        try:
            arrays = dict(np.load(Path(path)))
            if missing := {"alms", "beams", "noise"} - set(arrays):
                raise ValueError(f"it lacks {', '.join(sorted(missing))}")
        except (OSError, ValueError) as error:
            raise InputError(
                f"{path} does not hold the numbers of the authors' code ({error}); they are in tests/data of "
                "a checkout."
            ) from None
        return cls(arrays=arrays)

    def method(self, variant, **options):
        """The `SDecGMCA` that should reproduce a variant."""
        return SDecGMCA(**_COMMON | VARIANTS[variant] | options)

    def problem(self, floor=1e-9):
        """The data as a `BlurredMixture`."""
        beams = self.arrays["beams"]
        variance = float(self.arrays["noise"]) ** 2 * 4 * np.pi / (12 * _NSIDE**2)
        return BlurredMixture(
            modes=harmonic.to_modes(self.arrays["alms"]),
            beams=beams / beams.max(axis=0),
            noise=np.full(len(beams), variance),
            floor=floor,
        )

    def scales(self, method):
        """The `Scales` of a method, whose thresholds work on HEALPix maps as in that code."""
        return Scales(method, self.arrays["beams"].shape[1] - 1, _NSIDE)

    def mixing(self, variant, iteration):
        """A of that code after some iterations, (n_channels, n_sources)."""
        place = list(self.arrays[f"{variant}_iterations"]).index(iteration)
        return self.arrays[f"{variant}_mixing"][place]

    def mixings(self, method, start, n_iterations, *, done=0):
        """A of `method` after each iteration from `done` + 1 to `n_iterations`, a list."""
        steps = method.iterate(self.problem(), self.scales(method), start, done=done)
        return [step.mixing for step in itertools.islice(steps, n_iterations - done)]

    def compared(self, variant):
        """Differences of A from that of the code, from its own start, after each of `ITERATIONS`.

        Two lists: the largest difference of A; and the one due to a change of the start by `CHANGE`.
        """
        method, start = self.method(variant), self.mixing(variant, 0)
        change = 1 + CHANGE * np.random.default_rng(0).standard_normal(start.shape)
        plain, moved = (self.mixings(method, one, max(ITERATIONS)) for one in (start, start * change))
        return (
            [difference(plain[n - 1], self.mixing(variant, n)) for n in ITERATIONS],
            [difference(plain[n - 1], moved[n - 1]) for n in ITERATIONS],
        )


def read_authors_ensemble(path):
    """Results of the authors' code from many starts, a DataFrame with a row for each number.

    Columns are "preset", "galaxy", "thresholds", "sign", "alms" (whose harmonic coefficients), "restart", and
    "quantity", "x", "value": x is the iteration, or the floor for results of the last S. InputError if there
    is no such file, or it is another one.
    """
    try:
        stored = json.loads(Path(path).read_text())
        keys, axes = stored["keys"], stored["x"]
        rows = [
            (*run[: len(keys)], quantity, x, value)
            for run in stored["runs"]
            for (quantity, places), values in zip(axes.items(), run[len(keys) :], strict=True)
            for x, value in zip(places, values or (), strict=bool(values))
            if value is not None
        ]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path} does not hold the ensemble of the authors' code ({error!r}); it is in tests/data of a "
            "checkout."
        ) from None
    return pd.DataFrame(rows, columns=[*keys, "quantity", "x", "value"])


def difference(one, two):
    """Largest difference between two mixing matrices, ignoring signs of columns."""
    return float(np.abs(one * np.sign(np.sum(one * two, axis=0)) - two).max())
