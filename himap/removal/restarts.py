"""An ensemble of restarts of a chaotic method: its scatter, its medoid, and members that look failed.

No flag needs the truth. Flags were chosen by how often each is right, which is measured
(`himap.paper.restarts`): the condition of A, the last change of S and the cost function do not differ between
runs that fail and others.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from himap.core.checks import whole_number
from himap.core.errors import InputError
from himap.core.progress import progress
from himap.maps.low_rank import blocks

RESTARTS = 4
"""Default number of restarts for a user's cube, for methods that have restarts."""

BRIGHT = 0.1
"""Share of the lines of sight that counts as the brightest foreground."""

FLAGS = {
    "contrast": (2.0, "the residual is strong where the foreground is brightest"),
    "distance": (0.5, "the residual is far from that of the medoid"),
    "remaining": (0.5, "hardly any foreground was subtracted"),
}
"""{flag: (value above which it is set, what it means)}. The values: foreground residual with as much power as
HI and noise, a quarter of the power different, and half of the data remaining: all sources may end at 0,
which then no longer changes."""

_WAY_OUT = (
    "Take beam_subspace, which does not depend on its start; or thresholds=analytic, share=1, n_warmup=1 and "
    "sign=free (each after -p in the shell), with which sdecgmca settles; or more sources."
)
_NO_MAJORITY = (
    "Most restarts do not agree with the medoid, which then is no better than they are: do not use it."
)


def has_restarts(method):
    """Whether a `ForegroundRemover` depends on its start."""
    return hasattr(method, "restart")


def checked_restarts(method, n=None):
    """The number of restarts of a `ForegroundRemover` for `n`; if None, `RESTARTS`, or 1 if it has none.

    InputError if restarts are requested for a method without them, or if `n` is not a positive number.
    """
    if has_restarts(method):
        return RESTARTS if n is None else whole_number("restarts", n, 1, 10_000)
    if n not in (None, 1):
        raise InputError(f"{method.name} does not depend on its start: leave restarts out, got {n}.")
    return 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Ensemble:
    """A `Cleaning` with several starts.

    Attributes
    ----------
    members
        A `Cleaning` for each start, in order, with its `Separation`: a few spectra and maps each.
    """

    members: tuple

    @classmethod
    def of(cls, cleaning, n):
        """Make the ensemble of `n` starts of a `Cleaning`, which is the first of them.

        Raises
        ------
        InputError
            See `checked_restarts`.
        """
        n, method = checked_restarts(cleaning.method, n), cleaning.method
        members = (cleaning, *(cleaning.with_restart(method.restart + k) for k in range(1, n)))
        for member in progress(members, "restarts"):
            _ = member.separation
        return cls(members=members)

    def change(self, k):
        """Residual of member `k` less that of the medoid, a `LowRankCube`."""
        return self.medoid.separation.foreground + -self.members[k].separation.foreground

    @cached_property
    def distances(self):
        """Rms over all voxels of the difference between two residuals, (n, n), mK.

        All subtract a foreground from the same data, so this is the difference of two foregrounds. Angles
        between mixing matrices would also count sources without power.
        """
        found = [member.separation.foreground for member in self.members]
        (n_channels, _), n_pix, products = found[0].spectra.shape, found[0].maps.shape[1], 0.0
        for block in blocks(n_pix):
            lines = np.array([one.lines(block) for one in found]).reshape(len(found), -1)
            lines -= lines[0].copy()  # far brighter than their differences
            products += lines @ lines.T
        squares = products.diagonal()[:, None] + products.diagonal() - 2 * products
        return np.sqrt(np.maximum(squares, 0) / (n_channels * n_pix))

    @cached_property
    def medoid_index(self):
        """Index of the member with the smallest sum of distances to the others; the first if several."""
        return int(self.distances.sum(axis=1).argmin())

    @property
    def medoid(self):
        """The `Cleaning` that represents all: the member with the smallest sum of distances to the others."""
        return self.members[self.medoid_index]

    @cached_property
    def values(self):
        """For each member its `_values`, and the distance to the medoid over the rms of its residual."""
        values = []
        rms = np.sqrt(np.mean(np.square(self.medoid.residual, dtype=np.float64)))
        for k, distance in enumerate(self.distances[self.medoid_index]):
            one = _values(self.medoid, self.members[k].separation.foreground, self.change(k))
            values.append(one | {"distance": float(distance / rms)})
        return values

    @property
    def flags(self):
        """The names of the flags of each member, a list of lists."""
        return list(map(flags_of, self.values))

    @property
    def remarks(self):
        """Sentences for the user: which member is the medoid, which members are flagged, and what to do."""
        method, n, failing, reasons = self.medoid.method, len(self.members), set(), []
        for name, (_, meaning) in FLAGS.items():
            pairs = zip(self.members, self.flags, strict=True)
            if failed := [member.method.restart for member, names in pairs if name in names]:
                failing.update(failed)
                reasons.append(f"{meaning} (restart {', '.join(map(str, failed))})")
        first = (
            f"{method.name} is chaotic: this is restart {method.restart}, the medoid of {n}, of which "
            f"{len(failing)} look failed{': ' if failing else ''}{', '.join(reasons)}."
        )
        said = [first] + [_NO_MAJORITY] * (2 * len(failing) > n)
        return [*said, _WAY_OUT] if 2 * len(failing) >= n or method.restart in failing else said


def remarks_on_one(cleaning):
    """Remarks for the user on one run, a list of sentences; empty for methods without restarts."""
    if not has_restarts(cleaning.method):
        return []
    flags = flags_of(_values(cleaning, cleaning.separation.foreground))
    why, name = ", ".join(FLAGS[flag][1] for flag in flags), cleaning.method.name
    one = f"{name} is chaotic, so that one run is one draw: compare several, with --restarts 8 or restarts=8."
    return [one, f"This one looks failed: {why}. {_WAY_OUT}"] if flags else [one]


def flags_of(values):
    """Names of the `FLAGS` that {flag: value} sets, a list."""
    return [name for name, value in values.items() if value > FLAGS[name][0]]


def _values(cleaning, foreground, change=None):
    """{flag: value} of the residual of a `Cleaning`, plus a change: `contrast`, and its share of the data."""
    powers, data = line_powers(cleaning.residual, foreground, change), cleaning.data
    variance = data.get_or_compute("variance", lambda: np.mean([row.var(dtype=float) for row in data.maps]))
    remaining = powers[1].mean() / variance if variance > 0 else 0.0
    return {"contrast": float(contrast(*powers)), "remaining": float(remaining)}


def line_powers(residual, foreground, change=None):
    """Mean squares over channels of a foreground and of a residual on each line of sight, (2, n_pix) mK^2.

    Parameters
    ----------
    residual
        (n_channels, n_pix), mK.
    foreground, change
        `LowRankCube`; the change is added to the residual.
    """
    powers = np.empty((2, residual.shape[1]))
    for block in blocks(residual.shape[1]):
        remaining = residual[:, block] if change is None else residual[:, block] + change.lines(block)
        for power, lines in zip(powers[:, block], (foreground.lines(block), remaining), strict=True):
            power[:] = np.mean(np.square(lines, dtype=np.float64), axis=0)
    return powers


def contrast(foreground, residual):
    """Power of a residual on the lines of sight with the brightest foreground, over that elsewhere.

    HI and noise do not depend on the foreground: for them it is 1. Arguments are rows of `line_powers`.
    """
    bright = foreground > np.quantile(foreground, 1 - BRIGHT)
    elsewhere = residual[~bright].mean()
    return residual[bright].mean() / elsewhere if bright.any() and elsewhere > 0 else 1.0
