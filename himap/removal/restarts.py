"""An ensemble of restarts of a chaotic method: its scatter, its medoid, and which members look wrong.

No flag needs the truth; how often each is right is measured in the chapter on restarts. The condition of A,
the last change of S and the cost function are no flags: they are the same of runs that fail and of others.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from himap.core.checks import whole_number
from himap.core.errors import InputError
from himap.core.progress import progress
from himap.maps.low_rank import blocks

RESTARTS = 4
"""How many a cube of one's own is cleaned with, where the method has restarts."""

BRIGHT = 0.1
"""Share of the lines of sight that are the brightest of the foreground."""

FLAGS = {
    "floor": (0.0, "its last S is a numerical floor at {:.0%} of the multipoles"),
    "contrast": (2.0, "its residual has {:.3g} times the power where the foreground is brightest"),
    "distance": (0.5, "its residual differs by {:.3g} of its rms from that of the medoid"),
}
"""{flag: (value above which it is set, what it means)}."""

_WAY_OUT = (
    "Take beam_subspace, which does not depend on its start; or share=1, n_warmup=1, sign='free', with which "
    "sdecgmca settles; or more sources."
)


def has_restarts(method):
    """Whether a `ForegroundRemover` depends on its start."""
    return hasattr(method, "restart")


@dataclass(frozen=True, kw_only=True, eq=False)
class Ensemble:
    """A `Cleaning` from several starts.

    Attributes
    ----------
    members
        A `Cleaning` for each start, in their order, with its `Separation`: a few spectra and maps each.
    """

    members: tuple

    @classmethod
    def of(cls, cleaning, n):
        """The ensemble of `n` starts of a `Cleaning`, its own first.

        Raises
        ------
        InputError
            A method without restarts, or a number that is not 1 or more.
        """
        whole_number("restarts", n, 1, 10_000)
        method = cleaning.method
        if not has_restarts(method):
            raise InputError(
                f"{method.name} does not depend on its start: it has no restarts, got {n}; leave them out."
            )
        members = (cleaning, *(cleaning.with_restart(method.restart + k) for k in range(1, n)))
        for member in progress(members, "restarts"):
            _ = member.separation
        return cls(members=members)

    def change(self, k):
        """By how much the residual of member `k` is more than that of the medoid, a `LowRankCube`."""
        return self.medoid.separation.foreground + -self.members[k].separation.foreground

    @cached_property
    def distances(self):
        """Rms over all voxels of the difference of two residuals, (n, n), mK.

        All subtract a foreground from the same data, so it is that of two foregrounds. Angles between mixing
        matrices would count sources that hold nothing.
        """
        found = np.zeros((len(self.members),) * 2)
        for i, j in combinations(range(len(self.members)), 2):
            one, other = (self.members[k].separation.foreground for k in (i, j))
            found[i, j] = found[j, i] = _rms(one + -other)
        return found

    @cached_property
    def medoid_index(self):
        """Which member has the smallest sum of distances to the others; the first of several."""
        return int(self.distances.sum(axis=1).argmin())

    @property
    def medoid(self):
        """The `Cleaning` that stands for all, the one that is not far from most of the others."""
        return self.members[self.medoid_index]

    @cached_property
    def flags(self):
        """What speaks against each member, a list of {flag: value}; see `FLAGS`."""
        residual = self.medoid.residual
        rms = np.sqrt(np.mean(np.square(residual, dtype=np.float64)))
        return [
            _flags(member, residual, self.change(k), distance / rms)
            for k, (member, distance) in enumerate(
                zip(self.members, self.distances[self.medoid_index], strict=True)
            )
        ]

    @property
    def remarks(self):
        """Sentences: which member is the medoid, which ones have flags, and what then to do."""
        numbers = [member.method.restart for member in self.members]
        found = [
            f"restart {number}: {meaning(flags)}"
            for number, flags in zip(numbers, self.flags, strict=True)
            if flags
        ]
        said = [
            f"{self.medoid.method.name} is chaotic: this is restart {numbers[self.medoid_index]}, the medoid "
            f"of {len(numbers)}, of which {len(found)} look failed{''.join(f'; {one}' for one in found)}."
        ]
        return [*said, _WAY_OUT] if 2 * len(found) >= len(numbers) or self.flags[self.medoid_index] else said


def remarks_on_one(cleaning):
    """What the user should know of one run, a list of sentences; empty for methods without restarts."""
    if not has_restarts(cleaning.method):
        return []
    flags = _flags(cleaning, cleaning.residual)
    name = cleaning.method.name
    one = f"{name} is chaotic, so that one run is one draw: compare several, with --restarts 8 or restarts=8."
    return [one, f"This one looks failed: {meaning(flags)}. {_WAY_OUT}"] if flags else [one]


def meaning(flags):
    """What {flag: value} says, in words."""
    return ", ".join(FLAGS[name][1].format(value) for name, value in flags.items())


def _flags(cleaning, residual, change=None, distance=0.0):
    """{flag: value} of those that are set, of a `Cleaning` whose residual is `residual` and a change."""
    separation = cleaning.separation
    values = {
        "floor": (separation.diagnostics or {}).get("floored", 0.0),
        "contrast": contrast(residual, separation.foreground, change),
        "distance": distance,
    }
    return {name: float(value) for name, value in values.items() if value > FLAGS[name][0]}


def contrast(residual, foreground, change=None):
    """Power of a residual on the lines of sight where the foreground is brightest, over that elsewhere.

    HI and noise know nothing of the foreground: of these it is 1.

    Parameters
    ----------
    residual
        (n_channels, n_pix), mK.
    foreground, change
        `LowRankCube`; the change is added to the residual.
    """
    powers = np.empty((2, residual.shape[1]))
    for block in blocks(residual.shape[1]):
        left = residual[:, block] if change is None else residual[:, block] + change.lines(block)
        for power, lines in zip(powers[:, block], (foreground.lines(block), left), strict=True):
            power[:] = np.mean(np.square(lines, dtype=np.float64), axis=0)
    bright = powers[0] > np.quantile(powers[0], 1 - BRIGHT)
    return powers[1, bright].mean() / powers[1, ~bright].mean() if bright.any() else 1.0


def _rms(cube):
    """Of a `LowRankCube`, whose terms may cancel, mK."""
    axes, triangle = np.linalg.qr(cube.spectra)
    squares = sum(np.sum((triangle @ cube.maps[:, block]) ** 2) for block in blocks(cube.maps.shape[1]))
    return np.sqrt(squares / (len(axes) * cube.maps.shape[1]))
