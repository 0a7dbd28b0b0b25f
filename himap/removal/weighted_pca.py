"""Principal components of maps with weights: at once where pixels have them, in turns where voxels have."""

import numpy as np
from scipy import linalg

from himap.core.progress import progress
from himap.maps.low_rank import centred, in_threads, projection
from himap.removal.covariance import principal_axes
from himap.removal.separation import Separation, ordered

_SETTLED = 1e-7  # relative change of the squares of the residual at which the turns end
_ROUGHLY = 1e-2  # the same while there are fewer components than asked for
_ROUNDING = 1e-28  # of the squares of the maps: the residual of maps without HI and noise
_MOST_TURNS = 1000
_BLOCK = 4096  # lines of sight at a time: the float64 copies of a block stay small


def least_squares(basis, lines, weights):
    """Coefficients with the least sum of w (x - B a)^2 of each line of sight, (n_coefficients, n).

    Solved twice, the second time for the residual: the normal equations of a bright sky lose digits. B is
    (n_channels, n_coefficients), with columns of one length; x, (n_channels, n) float64, is finite where w is
    0 too, and w above 0 in as many channels as there are coefficients.
    """
    n_coefficients = basis.shape[1]
    weights = weights / weights.max(axis=0)
    products = (basis[:, :, None] * basis[:, None, :]).reshape(len(basis), -1)
    normal = (weights.T @ products).reshape(-1, n_coefficients, n_coefficients)
    coefficients = np.zeros((n_coefficients, lines.shape[1]))
    for _ in range(2):
        pull = (weights * (lines - basis @ coefficients)).T @ basis
        coefficients += np.linalg.solve(normal, pull[:, :, None])[:, :, 0].T
    return coefficients


def weighted_components(maps, weights, n_sources):
    """The `Separation` with the least weighted squares of the residual, sum w (x - m - A s)^2; `means` are m.

    Where pixels have weights, A are the principal axes of the weighted covariance, S = A^T X. Where voxels
    have, there is no closed form; it is fitted in turns, which go on until the squares settle:

    1. s of every line of sight, by least squares with its own weights;
    2. the residual of the model m + A s, times the weights over the largest of the line of sight, is added to
       the model: a voxel that is missing is filled by it;
    3. m and A from the maps that are filled so, as if all their pixels had that largest weight.

    No turn makes the squares larger: this is expectation maximisation for principal components with missing
    values (Tipping & Bishop 1999, without noise; Bailey 2012 has weights). Channels are brought to weights
    that are alike in the mean before, so that where weights are a product of one of the pixel and one of
    the channel the turns have nothing to do.

    Turns start with one component, then two, and so on, each time until they settle. To begin with all of
    them is not safe: what is missing of the brightest is far above the faintest, and would be
    mistaken for it.

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
    means = weights.sum(axis=1, dtype=np.float64) / np.count_nonzero(weights, axis=1)
    scale = np.sqrt(means / means.max())[:, None]

    def lines_of(block):
        return scale * maps[:, block], weights[:, block] / scale**2

    def start(block):
        lines, some = lines_of(block)
        roots = np.sqrt(some)
        pull = roots * lines
        return pull @ pull.T, roots @ roots.T, np.vdot(pull, pull)

    def turn(block):
        lines, some = lines_of(block)
        lines -= offset[:, None]
        model = mixing @ least_squares(mixing, lines, some)
        lines -= model
        pull, largest = some * lines, some.max(axis=0)
        filled = model + pull / largest
        return filled @ largest, (filled * largest) @ filled.T, largest.sum(), np.vdot(pull, lines)

    products, pairs, power = _sums(start, maps, "turn")
    offset, covariance = np.zeros(len(maps)), _ratio(products, pairs)
    for n in progress(range(1, n_sources + 1), "components"):
        mixing, squares, settled, n_turns = principal_axes(covariance, n), np.inf, False, 0
        while not settled and n_turns < _MOST_TURNS:
            before, n_turns = squares, n_turns + 1
            *moments, squares = _sums(turn, maps, "turn")
            move, covariance = _central(*moments)
            offset, mixing = offset + move, principal_axes(covariance, n)
            small = (_SETTLED if n == n_sources else _ROUGHLY) * squares
            settled = squares <= _ROUNDING * power or before - squares <= small
    sources = np.empty((n_sources, maps.shape[1]))

    def find(block):
        lines, some = lines_of(block)
        sources[:, block] = least_squares(mixing, lines - offset[:, None], some)

    in_threads(find, maps.shape[1], "sources", _BLOCK)
    # Turned so that A is orthonormal and the sources are uncorrelated.
    axes, triangle = linalg.qr(mixing / scale, mode="economic")
    sources = triangle @ sources
    turned = principal_axes(sources @ sources.T, n_sources)
    mixing, sources = ordered(axes @ turned, turned.T @ sources)
    return Separation(
        mixing=mixing,
        sources=sources,
        means=offset / scale[:, 0],
        converged=bool(settled),
        n_iterations=n_turns,
    )


def seen_covariance(maps, weights, components):
    """The covariance between channels of what is observed, (n_channels, n_channels) float64, mK^2.

    Where pixels have weights, that of which `weighted_components` takes the axes. Where voxels have, each
    pair of channels sees another part of a sky that is far brighter than HI, and means over these parts are
    not consistent. So maps are split into a model, which has no gaps, and its residual, which is faint:
    the products of each with each are means over the voxels that are observed, with the weights of those, and
    of the model with itself over all pixels, with the largest weight of each. Of equal weights this is the
    plain covariance, whatever the model.

    Maps and weights are as in `weighted_components`, though maps need not be less their means; the model is
    the foreground of `components`, a `Separation`.
    """
    maps = centred(maps, components.means)
    if weights.ndim == 1:
        return _covariance(maps, weights)

    def sums(block):
        some, model = weights[:, block].astype(np.float64), components.foreground.lines(block)
        rest = np.where(some > 0, maps[:, block] - model, 0)
        largest, pull, roots = some.max(axis=0), some * rest, np.sqrt(some)
        own, both = model * largest, roots * rest
        firsts = own.sum(axis=1), pull.sum(axis=1)
        seconds = own @ model.T, model @ pull.T, both @ both.T
        return *firsts, *seconds, largest.sum(), some.sum(axis=1), roots @ roots.T

    parts = _sums(sums, maps, "weighted covariance")
    model, rest, own, cross, both, largest, total, pairs = parts
    cross /= total
    mean = model / largest + rest / total
    return own / largest + cross + cross.T + _ratio(both, pairs) - np.outer(mean, mean)


def _sums(work, maps, label):
    """The sums over all blocks of pixels of each of the results of ``work(block)``."""
    return list(map(sum, zip(*in_threads(work, maps.shape[1], label, _BLOCK), strict=True)))


def _ratio(products, pairs):
    """Products over the weights of pairs, 0 for pairs without any."""
    return np.divide(products, pairs, out=np.zeros_like(products), where=pairs > 0)


def _covariance(maps, weights):
    """sum w x x^T / sum w of maps less their weighted means, (n_channels, n_channels) float64."""

    def sums(block):
        lines, some = maps[:, block].astype(np.float64), weights[block].astype(np.float64)
        return lines @ some, (lines * some) @ lines.T, some.sum()

    return _central(*_sums(sums, maps, "weighted covariance"))[1]


def _central(first, second, total):
    """Mean and covariance of sums of w x, w x x^T and w."""
    mean = first / total
    return mean, second / total - np.outer(mean, mean)
