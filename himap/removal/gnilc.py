"""Generalised needlet internal linear combination: what exceeds HI and noise is foreground."""

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy import linalg

from himap.core.checks import checked_cube
from himap.core.errors import InputError
from himap.core.progress import progress
from himap.core.reading import mapped_array
from himap.core.survey import FREQ_21CM
from himap.maps import sphere
from himap.maps.low_rank import centred, projection
from himap.maps.starlets import cosine_needlets
from himap.removal import harmonic
from himap.removal.base import ForegroundRemover, Separation, parameter
from himap.removal.separation import ordered

_BRIGHT = 9.0  # times the median of the variances: foreground, not HI and noise alone
_ORDER = 3  # of the polynomial in frequency through the logarithm of a variance
_FEWEST = 8  # channels: with fewer, the median includes foreground
_FAINT = 1e-3  # of the largest weight: pixels below it are outside of a region
_SEEN = 0.5  # observed share of a region from which it has its own filter
_OTHER_UNIT = 100.0  # times the variance of the faint axes of the data, or less: no prior of theirs
_ROUNDING = 1e-14  # of the variance of the data: a prior below it is of float32 maps without HI and noise


@dataclass(frozen=True, kw_only=True)
class GNILC(ForegroundRemover):
    """Remove, needlet by needlet, the axes in which the data have more than HI and noise.

    Maps are split into needlets, windows h_j(l) with sum_j h_j^2 = 1 (`cosine_needlets`). In each needlet the
    covariance R of the channels is compared with Q, that expected of HI and noise: without foreground the
    eigenvalues mu of R~ = Q^-1/2 R Q^-1/2 are near 1. The number m of eigenvalues with foreground is the one
    that minimises

        2 m + sum_{i > m} (mu_i - ln mu_i - 1)

    (Akaike 1974). With U the other eigenvectors and S = Q^1/2 U, HI and noise are estimated as
    S (S^T R^-1 S)^-1 S^T R^-1 x, where x are the data in that needlet; the result is filtered with h_j again
    (Remazeilles et al. 2011; for HI Olivari et al. 2016). As U are eigenvectors of R~, this is
    Q^1/2 U U^T Q^-1/2 x, and the foreground is the same with the first m eigenvectors: a mixing matrix times
    sources in each needlet, and some dozens of spectra in total. Modes beyond the last l, which transforms
    cannot represent, are filtered like the last needlet.

    The paper estimates R around each pixel, from a region with so many modes that channels over modes, the
    bias of an internal linear combination, is small. This is the parameter `bias`; a needlet with fewer modes
    on the full sky has one R, as all have with a bias of 0. With a hundred channels only the finest needlets
    have regions, and their filters (`local_difference`) cost much more than the rest. For the same reason the
    first needlet needs many more modes than there are channels: with hundreds of channels a `first_peak` of
    20 is too small, and removes HI at the lowest l. Beyond the last l the filter is that of the full sky.
    Unlike in the publication, an axis with *less* power than expected never counts as foreground: in the
    published sum, many far too faint axes would.

    Q should come from a mock of HI and noise through the instrument, the `prior`, made `stationary`, because
    one mock has few modes. Without it, Q has its shape from theory and its level from the data
    (`expected_covariance`), as a method should not know the simulations; this needs eight channels or more.
    """

    name: ClassVar[str] = "gnilc"
    uses: ClassVar[frozenset] = frozenset({"sphere"})
    first_peak: int = parameter(
        20, "l of the peak of the first needlet; that of each next one is twice as large", minimum=2
    )
    bias: float = parameter(
        0.0, "channels over modes in a region of the sky; 0 for one region, all of it", minimum=0, maximum=1
    )
    prior: str | None = parameter(None, "file (.npy) with a mock of HI and noise, (n_channels, n_pix), mK")

    def __post_init__(self):
        super().__post_init__()
        if not isinstance(self.prior, str | None):
            raise InputError(f"prior must be the path of a .npy file, got {self.prior!r}.")

    def least_channels(self, n_channels):
        return _FEWEST if self.prior is None else 1

    def digest(self):
        """A hash of the file with the mock."""
        return "" if self.prior is None else sha256(Path(self.prior).read_bytes()).hexdigest()

    def _separate(self, data):
        maps, modes = data.centred, data.modes
        nside = sphere.nside_of(maps)
        lmax = 3 * nside - 1
        peaks = [self.first_peak]
        while 2 * peaks[-1] < lmax:
            peaks.append(2 * peaks[-1])
        windows, degrees = cosine_needlets(peaks, lmax), harmonic.degrees(lmax)
        mock = None if self.prior is None else mock_modes(self.prior, maps.shape)
        inside = np.ones(maps.shape[1], dtype=bool) if data.inside is None else data.inside
        seen = inside.mean()  # there is no HI outside, so the full sphere has less
        spectra, sources, local = [], [], 0
        for peak, window in zip(peaks, progress(windows, self.name), strict=True):
            last = int(np.flatnonzero(window).max())
            covariance = band_covariance(modes.upto(last), window)
            if mock is None:
                prior = expected_covariance(covariance, data.freqs, peak)
            else:
                prior = seen * stationary(band_covariance(mock, window))
                if peak == self.first_peak:
                    check_level(covariance, prior)
            columns, rows = foreground_filter(covariance, prior)
            spectra.append(columns)
            sources.append(harmonic.synthesise(window[degrees] ** 2 * modes.along(rows, lmax), nside))
            n_modes = self.bias * np.sum((2 * np.arange(lmax + 1) + 1) * window**2)  # over regions
            if len(prior) < n_modes:
                width = np.sqrt(len(prior) / n_modes)
                needlet = harmonic.synthesise(window[harmonic.degrees(last)] * modes.upto(last), nside)
                more = local_difference(needlet, prior / seen, (columns, rows), width, inside)
                alms = sphere.analyse(more, n_iter=sphere.N_ITER_FLAT)
                local = local + alms * window[sphere.alm_degree(lmax)].astype(np.float32)
        # Beyond the last l: the maps less what their modes represent.
        sources[-1] += projection(rows, maps) - harmonic.synthesise(modes.along(rows, lmax), nside)
        if np.ndim(local):
            spectra.append(np.eye(len(maps)))
            sources.append(sphere.synthesise(local, nside).astype(np.float64))
        mixing, sources = ordered(np.hstack(spectra), np.concatenate(sources))
        return Separation(mixing=mixing, sources=sources)


def foreground_filter(covariance, prior):
    """Projection on the foreground as spectra times rows, (n_channels, m) and (m, n_channels).

    `covariance` is R of the data, `prior` Q of HI and noise, (n_channels, n_channels), mK^2.
    """
    root, values, axes = whitened(covariance, prior)
    axes = axes[:, ::-1][:, : n_foreground(values[::-1])]
    return root @ axes, linalg.solve_triangular(root, axes, lower=True, trans="T").T


def whitened(covariance, prior):
    """Q^1/2, and the eigenvalues, ascending, and eigenvectors of R~ for R and Q as in `foreground_filter`."""
    n_channels = len(prior)
    least = _ROUNDING * np.trace(covariance) / n_channels
    root = linalg.cholesky(prior + least * np.eye(n_channels), lower=True)
    half = linalg.solve_triangular(root, covariance, lower=True)
    return root, *np.linalg.eigh(linalg.solve_triangular(root, half.T, lower=True))


def check_level(covariance, prior):
    """Refuse Q of a mock, `prior`, far from the level of the faint axes of the data, as one in K has it."""
    _, values, _ = whitened(covariance, prior)
    level, most = values[len(values) // 4], _OTHER_UNIT if len(values) >= _FEWEST else np.inf
    if not 1 / _OTHER_UNIT < level < most:
        raise InputError(
            f"prior must be a mock of the HI and noise of the maps, in mK, and their faint modes have "
            f"{level:.2g} times its power: see its unit, and that the maps have HI and noise."
        )


def n_foreground(values):
    """Number of eigenvalues of R~, in descending order, that include foreground."""
    values = np.maximum(values, 1)
    unexplained = values - np.log(values) - 1
    beyond = np.append(np.cumsum(unexplained[::-1])[::-1], 0)
    return int(np.argmin(2 * np.arange(len(beyond)) + beyond))


def local_difference(maps, prior, everywhere, width, inside):
    """What regional filters remove in addition to the full-sky filter, (n_channels, n_pix) float32.

    A region has the weight exp(-d^2 / (2 width^2)) at an angle d from its centre. Centres are HEALPix pixels
    at most `width` apart; between them the results of their filters are averaged with the squares of those
    weights. Covariances are sums over cells of half that size, each with its weight. Where most of a region
    is unobserved, the full-sky filter remains.

    `maps` are (n_channels, n_pix) float64, `prior` is Q of HI and noise, `everywhere` the `foreground_filter`
    of all pixels, `width` in rad, `inside` the observed pixels, (n_pix,) bool.
    """
    nside = sphere.nside_of(maps)
    coarse = 2 ** max(0, int(np.ceil(np.log2(np.sqrt(np.pi / 3) / width))))
    fine = min(2 * coarse, nside)
    order = sphere.nest_to_ring(nside).reshape(12 * fine**2, -1)
    parts = [cell[inside[cell]] for cell in order]  # observed pixels of each cell
    products = np.array([maps[:, part] @ maps[:, part].T for part in parts])
    n_seen, n_all = np.array([len(part) for part in parts]), order.shape[1]
    cells = sphere.pixel_vectors(fine, nest=True)
    places, centres = sphere.pixel_vectors(nside), sphere.pixel_vectors(min(coarse, nside))

    def weight(vectors, centre):
        angle = np.arccos(np.clip(vectors @ centre, -1, 1))
        return np.exp(-0.5 * (angle / width) ** 2)

    total = sum(weight(places, centre) ** 2 for centre in centres)
    more = np.zeros(maps.shape, dtype=np.float32)
    for centre in progress(centres, "regions"):
        shares = weight(cells, centre)
        if shares @ n_seen < _SEEN * shares.sum() * n_all:
            continue
        covariance = np.tensordot(shares, products, 1) / (shares @ n_seen)
        spectra, rows = foreground_filter(covariance, prior)
        share = weight(places, centre) ** 2 / total
        near = share > _FAINT * share.max()
        # Only differences are averaged: if weights do not sum to 1, this affects HI but not the foreground.
        both = np.hstack([spectra, -everywhere[0]]), np.vstack([rows, everywhere[1]])
        more[:, near] += share[near] * (both[0] @ (both[1] @ maps[:, near]))
    return more


def mock_modes(path, shape):
    """Real modes of HI and noise as observed by the instrument, (n_channels, 9 nside^2) float32.

    Read from a .npy file of maps, (n_channels, n_pix), mK; `shape` is that of the maps to be cleaned.

    Raises
    ------
    InputError
        If there is no such file, or it is not an array of finite numbers of that shape.
    """
    maps = checked_cube("the mock of prior", mapped_array(path), min_channels=2)
    if maps.shape != shape:
        raise InputError(
            f"the mock of prior must have the shape of the maps, {shape}, got {maps.shape}; make it for "
            "this survey, seen through its beam."
        )
    modes = np.empty((len(maps), 9 * sphere.nside_of(maps) ** 2), dtype=np.float32)
    for channel, out in zip(progress(centred(maps), "prior"), modes, strict=True):
        out[:] = harmonic.to_modes(sphere.analyse(channel, n_iter=sphere.N_ITER_FLAT))
    return modes


def band_covariance(modes, window):
    """Covariance between channels of maps through a window h_l, (n_channels, n_channels) float64, mK^2.

    `modes` are real modes, (n_channels, (lmax + 1)^2); h_l may extend beyond that lmax.
    """
    total = np.zeros((len(modes), len(modes)))
    for weight, block in zip(window, harmonic.blocks(modes), strict=False):
        if weight:
            data = weight * block.astype(np.float64)
            total += data @ data.T
    return total / (4 * np.pi)


def stationary(covariance):
    """The nearest covariance s_a s_b rho(a - b): what a few modes determine of a smooth covariance.

    ln s^2 is a cubic in frequency. rho is the mean along each diagonal, reduced far from the main one by the
    share of channels that are so far apart: it is then the autocorrelation of a series, which has no negative
    power. Channels are assumed to be evenly spaced.
    """
    deviation = np.sqrt(_smoothed(np.diag(covariance)))
    correlation = covariance / np.outer(deviation, deviation)
    along = np.array([np.trace(correlation, lag) for lag in range(len(correlation))])
    return np.outer(deviation, deviation) * linalg.toeplitz(along / along[0])


def expected_covariance(covariance, freqs, degree):
    """Covariance of HI without a mock: its shape from theory, its level from the data, mK^2.

    For matter with P(k) ~ k^-2 the correlation between two distances r < r' at multipole l is
    exp(-l (r' - r) / r): in redshift, used as distance here, (z / z')^l. The variance by channel is a smooth
    curve through that of `covariance` in directions without strong foreground.

    `covariance` is that of the data, (n_channels, n_channels), at `freqs`, MHz, and l, `degree`.

    Raises
    ------
    InputError
        If a frequency is at or above that of the line, where HI in the Hubble flow cannot be.
    """
    if freqs[-1] >= FREQ_21CM:
        raise InputError(
            f"without a mock HI is expected below {FREQ_21CM:.1f} MHz, got channels up to {freqs[-1]:g} MHz; "
            "give prior, a file with a mock."
        )
    place = degree * np.log(FREQ_21CM / freqs - 1)
    shape = np.exp(-np.abs(place[:, None] - place))
    values, axes = np.linalg.eigh(covariance)
    kept = values <= _BRIGHT * np.median(values)
    faint = axes[:, kept]
    # Not from `covariance`, which has the rounding errors of the brightest axis.
    level = faint**2 @ np.maximum(values[kept], 0)
    share = np.sum((faint @ (faint.T @ shape @ faint)) * faint, axis=1)
    deviation = np.sqrt(_smoothed(level / share))
    return np.outer(deviation, deviation) * shape


def _smoothed(variance):
    """The exponential of a cubic fitted to the logarithms of `variance`."""
    place = np.linspace(-1, 1, len(variance))
    order = min(_ORDER, len(variance) - 1)
    floor = np.finfo(float).tiny
    return np.exp(np.polyval(np.polyfit(place, np.log(np.maximum(variance, floor)), order), place))
