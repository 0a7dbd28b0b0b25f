"""Principal components of weighted maps: direct for weights of pixels, iterative for weights of voxels."""

import numpy as np
from scipy import linalg

from himap.core.progress import progress
from himap.maps.low_rank import centred, in_threads, projection
from himap.removal.covariance import principal_axes
from himap.removal.separation import Separation, ordered

_SETTLED = 1e-7  # relative change of the squared residual at which the iteration ends
_ROUGHLY = 1e-2  # the same, while there are fewer components than requested
_ROUNDING = 1e-28  # of the squared maps: the residual of maps without HI and noise
_MOST_TURNS = 1000
_BLOCK = 4096  # lines of sight per block, to keep its float64 copies small


def least_squares(basis, lines, weights):
    """Coefficients that minimise the sum of w (x - B a)^2 for each line of sight, (n_coefficients, n).

    Solved twice, the second time for the residual, because the normal equations of a bright sky lose digits.
    B is (n_channels, n_coefficients), with columns of equal length. x, (n_channels, n) float64, is finite
    even where w is 0, and w is above 0 in at least as many channels as there are coefficients.
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
    """The `Separation` that minimises the weighted squares sum w (x - m - A s)^2; `means` are m.

    For weights of pixels, A are the principal axes of the weighted covariance and S = A^T X. For weights of
    voxels there is no closed form; three steps are repeated until the squares settle:

    1. s of every line of sight, by least squares with its own weights;
    2. the residual of the model m + A s, times the weights over the largest of the line of sight, is added to
       the model: so it fills missing voxels;
    3. m and A follow from the maps filled in this way, as if all their pixels had that largest weight.

    No iteration increases the squares: this is expectation maximisation for principal components with missing
    values (Tipping & Bishop 1999, without noise; Bailey 2012 has weights). Channels are first rescaled to
    similar mean weights, so that one iteration suffices if weights are a product of a factor for the pixel
    and one for the channel.

    The iteration settles with one component, then with two, and so on. Starting with all of them is not safe:
    the missing part of the brightest component is far above the faintest one, and would be mistaken
    for it.

    Parameters
    ----------
    maps
        (n_channels, n_pix), mK, less their weighted means; also finite in missing voxels.
    weights
        (n_pix,), or (n_channels, n_pix) 0 in missing voxels.
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
    # Rotated so that A is orthonormal and the sources are uncorrelated.
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
    """The covariance between channels of the observed maps, (n_channels, n_channels) float64, mK^2.

    For weights of pixels, this is the covariance whose axes `weighted_components` uses. For weights of
    voxels, each pair of channels sees another part of a sky that is far brighter than HI, and means over
    these parts are not consistent. So maps are split into a model, which has no gaps, and its faint residual.
    Products of the model with itself are averaged over all pixels, with the largest weight of each; the other
    products are averaged over observed voxels with their weights. For equal weights this is the plain
    covariance, whatever the model.

    Maps and weights are as in `weighted_components`, but maps may include their means; the model is
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
    """Sum each result of ``work(block)`` over all blocks of pixels."""
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
