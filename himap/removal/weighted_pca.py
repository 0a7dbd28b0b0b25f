"""Principal components of maps with weights: at once where pixels have them, in turns where voxels have."""

import numpy as np
from scipy import linalg

from himap.core.progress import progress
from himap.maps.blocked import centred, in_threads, projection
from himap.removal.covariance import principal_axes
from himap.removal.separation import Separation
from himap.removal.weighted_fits import least_squares

_SETTLED = 1e-7  # relative change of the squares that are left at which the turns end
_ROUGHLY = 1e-2  # the same while there are fewer components than asked for
_ROUNDING = 1e-28  # of the squares of the maps: what is left of them without HI and noise
_MOST_TURNS = 1000
_BLOCK = 4096  # lines of sight at a time: the float64 copies of a block stay small


def weighted_components(maps, weights, n_sources):
    """The `Separation` with the least weighted squares of the residual, sum w (x - m - A s)^2; `means` are m.

    Where pixels have weights, A are the principal axes of the weighted covariance, S = A^T X. Where voxels
    have, there is no closed form; it is found in turns, which go on until the squares settle:

    1. s of every line of sight, by least squares with its own weights;
    2. what the model m + A s leaves, times the weights over the largest of the line of sight, is added to the
       model: a voxel that is missing is filled by it;
    3. m and A from the maps that are filled so, as if all their pixels had that largest weight.

    No turn makes the squares larger: this is expectation maximisation for principal components with missing
    values (Tipping & Bishop 1999, without noise; Bailey 2012 has weights). Channels are brought to weights
    that are alike in the mean before, so that where weights are a product of one of the pixel and one of
    the channel nothing is left for the turns to do.

    Parameters
    ----------
    maps
        (n_channels, n_pix), mK, less their weighted means; finite where missing too.
    weights
        (n_pix,), or (n_channels, n_pix) with 0 where missing.
    n_sources
        Number of components.
    """
    if weights.ndim == 1:
        mixing = principal_axes(_covariance(maps, weights), n_sources)
        return Separation(mixing=mixing, sources=projection(mixing.T, maps), means=np.zeros(len(mixing)))
    return _Turns(maps, weights).separation(n_sources)


def _covariance(maps, weights):
    """sum w x x^T / sum w of maps less their weighted means, (n_channels, n_channels) float64."""

    def sums(block):
        lines, some = maps[:, block].astype(np.float64), weights[block].astype(np.float64)
        return lines @ some, (lines * some) @ lines.T, some.sum()

    return _central(*map(sum, zip(*in_threads(sums, maps.shape[1], "weighted covariance"), strict=True)))[1]


def _central(first, second, total):
    """Mean and covariance of sums of w x, w x x^T and w."""
    mean = first / total
    return mean, second / total - np.outer(mean, mean)


def seen_covariance(maps, weights, found):
    """The covariance between channels of what is there, (n_channels, n_channels) float64, mK^2.

    Where pixels have weights, that of which `weighted_components` takes the axes. Where voxels have, each
    pair of channels sees another part of a sky that is far brighter than HI, and means over these parts do
    not fit together. So maps are taken as a model, which has no gaps, and what that leaves, which is faint:
    the products of each with each are means over what tells them, with the weights of that, and of the model
    with itself over all pixels, with the largest weight of each. Of equal weights this is the plain
    covariance, whatever the model.

    Parameters
    ----------
    maps, weights
        As in `weighted_components`; maps need not be less their means.
    found
        The `Separation` whose foreground is the model.
    """
    maps = centred(maps, found.means)
    if weights.ndim == 1:
        return _covariance(maps, weights)

    def sums(block):
        some, model = weights[:, block].astype(np.float64), found.foreground.lines(block)
        rest = np.where(some > 0, maps[:, block] - model, 0)
        largest, pull, roots = some.max(axis=0), some * rest, np.sqrt(some)
        own, both = model * largest, roots * rest
        firsts = own.sum(axis=1), pull.sum(axis=1)
        seconds = own @ model.T, model @ pull.T, both @ both.T
        return *firsts, *seconds, largest.sum(), some.sum(axis=1), roots @ roots.T

    parts = in_threads(sums, maps.shape[1], "weighted covariance", _BLOCK)
    model, rest, own, cross, both, largest, total, pairs = map(sum, zip(*parts, strict=True))
    cross /= total
    both = np.divide(both, pairs, out=np.zeros_like(both), where=pairs > 0)
    mean = model / largest + rest / total
    return own / largest + cross + cross.T + both - np.outer(mean, mean)


class _Turns:
    """The maps and weights, with channels scaled so that their mean weights are alike."""

    def __init__(self, maps, weights):
        self.maps, self.weights = maps, weights
        means = weights.sum(axis=1, dtype=np.float64) / np.count_nonzero(weights, axis=1)
        self.scale = np.sqrt(means / means.max())[:, None]

    def separation(self, n_sources):
        """The `Separation`: turns with one component, then with two, and so on, each time until they settle.

        To begin with all of them is not safe: what is missing of the brightest is far above the faintest, and
        would be taken for it.
        """
        offset, covariance, power = self._start()
        for n in progress(range(1, n_sources + 1), "components"):
            mixing, squares, settled = principal_axes(covariance, n), np.inf, False
            n_turns = 0
            while not settled and n_turns < _MOST_TURNS:
                before, n_turns = squares, n_turns + 1
                move, covariance, squares = self._turn(offset, mixing)
                offset, mixing = offset + move, principal_axes(covariance, n)
                small = (_SETTLED if n == n_sources else _ROUGHLY) * squares
                settled = squares <= _ROUNDING * power or before - squares <= small
        mixing, sources = _principal(mixing / self.scale, self._sources(offset, mixing))
        return Separation(
            mixing=mixing,
            sources=sources,
            means=offset / self.scale[:, 0],
            converged=bool(settled),
            n_iterations=n_turns,
        )

    def _block(self, block):
        """Lines of sight and their weights, (n_channels, n) float64."""
        weights = self.weights[:, block] / self.scale**2
        return self.scale * self.maps[:, block], weights

    def _each(self, work):
        """The sums over all blocks of what ``work(lines, weights)`` returns."""
        found = in_threads(lambda block: work(*self._block(block)), self.maps.shape[1], "turn", _BLOCK)
        return list(map(sum, zip(*found, strict=True)))

    def _start(self):
        """m = 0, the covariance of what pairs of channels see together, and the squares of the maps."""

        def sums(lines, weights):
            roots = np.sqrt(weights)
            both = roots * lines
            return both @ both.T, roots @ roots.T, np.vdot(both, both)

        products, pairs, power = self._each(sums)
        covariance = np.divide(products, pairs, out=np.zeros_like(products), where=pairs > 0)
        return np.zeros(len(self.maps)), covariance, power

    def _turn(self, offset, mixing):
        """What one turn adds to m, the covariance for its A, and the squares that were left before it."""

        def sums(lines, weights):
            lines -= offset[:, None]
            model = mixing @ least_squares(mixing, lines, weights)
            lines -= model
            pull, largest = weights * lines, weights.max(axis=0)
            squares = np.vdot(pull, lines)
            filled = model + pull / largest
            return filled @ largest, (filled * largest) @ filled.T, largest.sum(), squares

        *moments, squares = self._each(sums)
        return *_central(*moments), squares

    def _sources(self, offset, mixing):
        sources = np.empty((mixing.shape[1], self.maps.shape[1]))

        def find(block):
            lines, weights = self._block(block)
            sources[:, block] = least_squares(mixing, lines - offset[:, None], weights)

        in_threads(find, self.maps.shape[1], "sources", _BLOCK)
        return sources


def _principal(mixing, sources):
    """A and S turned so that A is orthonormal and the sources are uncorrelated, by variance."""
    axes, triangle = linalg.qr(mixing, mode="economic")
    sources = triangle @ sources
    turn = principal_axes(sources @ sources.T, len(sources))
    mixing, sources = axes @ turn, turn.T @ sources
    signs = np.sign(mixing[np.abs(mixing).argmax(axis=0), np.arange(len(sources))])
    return mixing * signs, sources * signs[:, None]
