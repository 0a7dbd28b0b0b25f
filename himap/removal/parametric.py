"""Parametric fit along each line of sight: free-free emission plus a power law (paper, Sect. 3.2.2)."""

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.polynomial import chebyshev
from scipy.special import exprel

from himap.core.errors import InputError
from himap.maps.low_rank import LowRankCube, in_threads
from himap.removal.base import ForegroundRemover, Separation, parameter

FIXED_INDEX = -2.13
"""Spectral index of the first term, free-free emission (Bennett et al. 1992)."""

_BLOCK = 4096  # pixels per block, to keep its float64 copies small
_N_PARAMETERS = 3  # a1, a2 and beta
_RANK = 1e-13  # directions of q2(beta) below this share of the largest are rounding errors
_DEGREE = 31  # of the Chebyshev series in beta; exact to rounding for any band and indices the fields allow
_N_GRID = 65  # starting values of beta
_MAX_STEPS = 60  # bisection alone needs 45
_TOLERANCE = 1e-11  # in units of half the range of beta
_value = partial(chebyshev.chebval, tensor=False)  # of series (degree + 1, n), at one point each, (n,)


@dataclass(frozen=True, kw_only=True)
class Parametric(ForegroundRemover):
    """Two power laws in frequency, fitted to each line of sight.

    T(nu) = a1 (nu / nu0)^-2.13 + a2 (nu / nu0)^beta (Eq. 19), fitted by least squares in mK. All channels
    have the same weight, as the paper gives none, unless voxels have weights; weights of pixels change
    nothing. The amplitudes are linear and may have either sign, so for a given beta they follow directly,
    and only beta remains to be optimised (variable projection, Golub & Pereyra 1973). beta is bounded,
    because the two terms coincide at beta = -2.13, where the amplitudes diverge. The default range
    includes every plausible synchrotron index: electrons of energy index p = 2 to 3 give -2.5 to -3,
    energy losses and the steepest sources up to one more, and -2.2 is flatter than any mixture of them.

    A line of sight whose best beta is a bound, or that used all its steps, is in `Separation.flagged`. Only
    the second is a failed search, which makes the result not converged. The first says that the model does
    not describe the sky; the fit is still the best within the bounds. The sources are a1 and a2 in mK, and
    beta; the mixing matrix has the derivatives of the model in these, at the sky's median parameters.
    """

    name: ClassVar[str] = "parametric"
    uses: ClassVar[frozenset] = frozenset({"weights"})
    beta_min: float = parameter(-4.0, "steepest spectral index of the second term", minimum=-6)
    beta_max: float = parameter(-2.2, "flattest spectral index of the second term", maximum=-2.14)
    nu0: float = parameter(1150.0, "frequency of the amplitudes, MHz", minimum=0, above=True)

    def __post_init__(self):
        super().__post_init__()
        if self.beta_min >= self.beta_max:
            raise InputError(
                f"beta_min must be below beta_max, got {self.beta_min} and {self.beta_max}; "
                "plausible are -4 and -2.2."
            )

    def least_channels(self, n_channels):
        return _N_PARAMETERS

    def _separate(self, data):
        maps, n_pix = data.total, data.maps.shape[1]
        by_voxel = np.ndim(data.weights) == 2
        weights = data.weights if by_voxel else np.ones((len(maps), 1))
        n_bad = np.count_nonzero(np.sum(maps * weights, axis=0, dtype=np.float64) <= 0)
        if n_bad:
            raise InputError(
                "parametric fits power laws to the total brightness, which is positive, but the mean along "
                f"{n_bad} of {n_pix} lines of sight is not; give maps from which no mean was removed."
            )
        model = _TwoPowerLaws(data.freqs / self.nu0, self.beta_min, self.beta_max)
        fits, sources = np.empty((model.spectra.shape[1], n_pix)), np.empty((_N_PARAMETERS, n_pix))
        flagged = np.empty(n_pix, dtype=bool)

        def fit(block):
            lines = maps[:, block].astype(np.float64)
            shares = weights[:, block] / weights[:, block].max(axis=0) if by_voxel else weights
            t, at_bound, converged, n_steps = _highest(model.series(lines, shares))
            fits[:, block], sources[:, block] = model.fit(lines, shares, t)
            flagged[block] = at_bound | ~converged
            return n_steps, converged.all()

        n_steps, converged = zip(*in_threads(fit, n_pix, "parametric", _BLOCK), strict=True)
        return Separation(
            low_rank=LowRankCube(spectra=model.spectra, maps=fits),
            means=np.zeros(len(maps)),  # power laws describe the total brightness
            mixing=model.derivatives(*np.median(sources, axis=1)),
            sources=sources,
            converged=all(converged),
            n_iterations=max(n_steps),
            flagged=flagged,
        )


class _TwoPowerLaws:
    """The model over the channels, in an orthonormal basis that is valid for every beta.

    At a given beta the model spans two directions: q1, the unit vector along x^-2.13, and q2(beta), the unit
    vector along what x^beta adds to it. It is computed from (x^beta - x^-2.13) / (beta + 2.13), written with
    exprel, which loses no digits where the power laws coincide. q2 is smooth in beta: a short Chebyshev
    series in t, from -1 to 1 over the range of beta, represents it to rounding. `spectra` are orthonormal and
    span every model, q1 first, (n_channels, n_spectra).
    """

    def __init__(self, x, beta_min, beta_max):
        self.logx = np.log(x)
        self.middle, self.half = 0.5 * (beta_max + beta_min), 0.5 * (beta_max - beta_min)
        first = np.exp(FIXED_INDEX * self.logx)
        self.norm = np.linalg.norm(first)
        self.q1 = first / self.norm
        table = chebyshev.chebinterpolate(np.vectorize(self._table, signature="()->(n)"), _DEGREE)
        self.q2, self.overlap, self.inverse_norm = table[:, :-2], table[:, -2], table[:, -1]
        # All possible q2 lie in a few directions, to the rounding of the series.
        _, size, axes = np.linalg.svd(self.q2, full_matrices=False)
        axes = axes[size > _RANK * size[0]]
        self.spectra = np.stack([self.q1, *axes], axis=1)
        self._along = self.q2 @ axes.T

    def _table(self, t):
        """q2, and the product with q1 and the inverse norm of the vector it comes from, in one row."""
        delta = self.middle + self.half * t - FIXED_INDEX
        second = np.exp(FIXED_INDEX * self.logx) * self.logx * exprel(delta * self.logx)
        overlap = self.q1 @ second
        second -= overlap * self.q1
        norm = np.linalg.norm(second)
        return np.concatenate([second / norm, [overlap / norm, 1 / norm]])

    def series(self, lines, weights):
        """Chebyshev series of each line's coefficient along q2(beta), (degree + 1, n_pix).

        It is along the unit vector that q2(beta) adds to q1, in the scalar product sum w x y: the weighted
        squares of the residual are least where its square is largest. Lines, (n_channels, n_pix) float64, are
        finite; weights have that shape, or (n_channels, 1).
        """
        nodes = chebyshev.chebvander(chebyshev.chebpts1(_DEGREE + 1), _DEGREE)
        second = nodes @ self.q2
        norm, shared = self.q1**2 @ weights, (second * self.q1) @ weights
        rest = lines - np.outer(self.q1, (self.q1 @ (weights * lines)) / norm)
        heights = second @ (weights * rest) / np.sqrt(second**2 @ weights - shared**2 / norm)
        return np.linalg.solve(nodes, heights)

    def fit(self, lines, weights, t):
        """Fit at t, (n_pix,): coefficients of `spectra`, (n_spectra, n_pix), and a1, a2, beta, (3, n_pix)."""
        powers = chebyshev.chebvander(t, _DEGREE).T
        second = self.q2.T @ powers
        norm = self.q1**2 @ weights
        flat, shared = (self.q1 @ (weights * lines)) / norm, (self.q1 @ (weights * second)) / norm
        alone = weights * (second - np.outer(self.q1, shared))
        height = np.einsum("ij,ij->j", alone, lines - np.outer(self.q1, flat))
        height /= np.einsum("ij,ij->j", alone, second)
        flat -= height * shared
        beta = self.middle + self.half * t
        steep = height * (self.inverse_norm @ powers) / (beta - FIXED_INDEX)
        first = (flat - height * (self.overlap @ powers)) / self.norm - steep
        return np.vstack([flat, (self._along.T @ powers) * height]), np.stack([first, steep, beta])

    def derivatives(self, first, second, beta):
        """Derivatives of the model with respect to a1, a2 and beta, (n_channels, 3)."""
        power = np.exp(beta * self.logx)
        return np.stack([np.exp(FIXED_INDEX * self.logx), power, second * power * self.logx], axis=1)


def _highest(series):
    """Position of the largest absolute value in [-1, 1] of Chebyshev series, (degree + 1, n_pix).

    A grid finds the highest peak, and Newton steps on the derivative refine it, with bisection whenever they
    leave the bracket. Returns the positions, whether each is a bound, and whether the search converged,
    (n_pix,) each, and the number of steps.
    """
    grid = np.linspace(-1, 1, _N_GRID)
    values = chebyshev.chebvander(grid, _DEGREE) @ series
    top = np.abs(values).argmax(axis=0)
    series = series * np.sign(values[top, np.arange(len(top))])
    slope, curvature = chebyshev.chebder(series), chebyshev.chebder(series, 2)
    t = grid[top]
    outward = np.sign(t) * _value(t, slope)
    at_bound = (np.abs(t) == 1) & (outward >= 0)
    low, high = grid[np.maximum(top - 1, 0)], grid[np.minimum(top + 1, _N_GRID - 1)]
    active = np.flatnonzero(~at_bound)
    n_steps = 0
    while len(active) and n_steps < _MAX_STEPS:
        n_steps += 1
        gradient, bend = (_value(t[active], one[:, active]) for one in (slope, curvature))
        low[active] = np.where(gradient > 0, t[active], low[active])
        high[active] = np.where(gradient > 0, high[active], t[active])
        step = -gradient / np.where(bend < 0, bend, -np.inf)
        inside = (bend < 0) & (t[active] + step >= low[active]) & (t[active] + step <= high[active])
        updated = np.where(inside, t[active] + step, 0.5 * (low[active] + high[active]))
        moved = np.abs(updated - t[active])
        t[active] = updated
        active = active[moved > _TOLERANCE]
    converged = ~np.isin(np.arange(len(t)), active)
    return t, at_bound, converged, n_steps
