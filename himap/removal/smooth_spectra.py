"""Smooth spectra, at every multipole as many as exceed HI and noise; a method of this library."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.linalg import toeplitz

from himap.core.checks import evenly_spaced
from himap.core.errors import InputError
from himap.core.progress import progress
from himap.maps import sphere
from himap.removal import harmonic
from himap.removal.base import ForegroundRemover, Separation, parameter
from himap.removal.separation import ordered
from himap.removal.spectral_filter import SpectralFilter, filtered, wiener_estimators

_INDEX = -2.7  # of the power law that the smooth functions multiply; its value hardly matters
_LEAST_WIDTH, _GROWTH = 5, 1.25  # of bands of multipoles
_MOST_TURNS = 50  # of a band; 3 to 6 suffice if smooth spectra hold a few percent of HI
_SETTLED = 1e-3  # relative change of the covariance of HI and noise
_ROUNDING = 1e-7  # of a float32 map
_LEVEL_ORDER = 3  # of the polynomial in frequency for the logarithm of the variance
_POWER_ORDER = 3  # of the polynomial in k / (k + _SCALE) for the logarithm of the power
_SCALE = 0.3  # 1/MHz: where the power bends, as channels a few MHz apart hold nearly the same HI
_CLOSEST = 4  # times closer than the mean spacing: smallest spacing that counts
_MOST_STEPS = 50  # of a fit; 5 to 10 suffice
_SMALL = 1e-9  # change of a logarithm
_STEEPEST = 1e4  # largest over median eigenvalue of the covariance of HI and noise: about 100 at the lowest l


@dataclass(frozen=True, kw_only=True)
class FilteredSeparation(Separation):
    """A `Separation` whose foreground is a linear filter of the maps: `filter`, a `SpectralFilter`."""

    filter: SpectralFilter


@dataclass(frozen=True, kw_only=True)
class SmoothSpectra(ForegroundRemover):
    """At every multipole, the few smooth spectra seen through the beams that exceed HI and noise.

    Not a method of the paper. In a band of multipoles the data are X_l = diag(H_l) B S_l + N_l. B are
    `n_smooth` smooth functions, a power law times polynomials in log frequency, in which foregrounds can be
    expanded (Chluba, Hill & Abitbol 2017). H is the beam of a channel over the best beam of all. No spectrum
    is fitted channel by channel, so none can follow HI more closely than these functions. N_l, HI and noise,
    has the covariance C of `faint_covariance`, smooth as that of HI. Two steps alternate:

    - S follows from X by least squares weighted with C^-1, which allows for the correlation of HI between
      channels. Its covariance in excess of C is shrunk to the part that is significant for random matrices of
      that size (`shrunk_variance`), and to its `n_sources` largest axes. Insignificant axes are not removed,
      so excess sources do no harm;
    - C follows from the residual, X less the mean of the foreground given X, and the covariance of that mean
      (expectation maximisation, Dempster et al. 1977; with free spectra, Delabrouille et al. 2003).

    The mean of the foreground given X, a Wiener filter, is subtracted. The HI that this removes follows from
    C, without the truth and without mocks (`himap.measures.transfer.expected_mock_power`). `mixing` and
    `sources` are the principal axes of the foreground before the beam, all l together. The result has not
    converged if the estimated HI is as steep as a foreground, which then remains: with few channels in a
    narrow band, or a small `n_sources`. There is no threshold to choose, no noise level to know and no
    randomness.
    """

    name: ClassVar[str] = "smooth_spectra"
    uses: ClassVar[frozenset] = frozenset({"beams", "sphere"})
    n_sources: int = parameter(4, "largest number of spectra at any multipole", minimum=1)
    n_smooth: int = parameter(8, "number of smooth functions that the spectra are made of", minimum=2)

    def check(self, n_channels):
        super().check(n_channels)
        if self.n_sources > self.n_smooth:
            raise InputError(
                f"n_sources must be at most n_smooth, {self.n_smooth}, got {self.n_sources}; give a larger "
                "n_smooth with it."
            )
        if self.n_smooth >= n_channels:
            raise InputError(
                f"n_smooth must be below the number of channels, {n_channels}, got {self.n_smooth}."
            )

    def _separate(self, data):
        maps, freqs, modes = data.centred, data.freqs, data.modes
        rounding = _ROUNDING**2 * np.mean(np.square(maps, dtype=np.float64)) * 4 * np.pi / maps.shape[1]
        seen = smooth_seen(data, self.n_smooth)
        share = 1 if data.inside is None else data.inside.mean()
        edges, bands = multipole_bands(len(seen) - 1), []
        for band in progress(edges, self.name):
            degrees = degrees_of(band)
            blocks = [np.array(modes.at(degree)) for degree in degrees]
            try:
                bands.append(_settled(blocks, seen[degrees], freqs, rounding, self.n_sources, share))
            except np.linalg.LinAlgError:
                raise InputError(
                    f"HI and {self.n_smooth} smooth functions cannot be separated over "
                    f"{freqs[-1] - freqs[0]:.4g} MHz in {len(freqs)} channels, at l from {band[0]}; take "
                    f"fewer, such as n_smooth={max(2, self.n_sources, self.n_smooth // 2)}, a wider band, or "
                    "another method."
                ) from None
        axes, faint, amplitudes, converged, n_turns = zip(*bands, strict=True)
        spectra = [seen[first : last + 1] @ one for (first, last), one in zip(edges, axes, strict=True)]
        linear = SpectralFilter.wiener(spectra, faint, edges)
        amplitudes = np.pad(np.hstack(amplitudes), ((0, 0), (1, 0)))
        axes = np.linalg.eigh(amplitudes @ amplitudes.T)[1][:, ::-1][:, : self.n_sources]
        mixing, sources = ordered(smooth_basis(freqs, self.n_smooth) @ axes, axes.T @ amplitudes)
        return FilteredSeparation(
            low_rank=filtered(linear.spectra, linear.estimators, data.project, modes),
            mixing=mixing,
            sources=harmonic.synthesise(sources, sphere.nside_of(maps)),
            converged=all(converged),
            n_iterations=max(n_turns),
            filter=linear,
        )


def _settled(data, seen, freqs, rounding, n_sources, share):
    """Fit one band of multipoles, iterating until the covariance C of HI and noise settles.

    The data are X_l, a list of (n_channels, 2 l + 1); `seen` is diag(H_l) B, (n_l, n_channels, n_smooth);
    `rounding` is the variance of the rounding of maps, mK^2; `share` the observed share of the sky, and of
    modes that are independent. Returns the axes of `_foreground_axes`, C as in `SpectralFilter`, amplitudes
    of the foreground in B, (n_smooth, n_modes), whether C settled, and the number of turns. C has not settled
    if it is as steep as a foreground: with few channels in a narrow band, or more spectra than n_sources.
    """
    _, n_channels, n_smooth = seen.shape
    n_modes = sum(block.shape[1] for block in data)

    def faint_of(products, n_removed):
        return faint_covariance(products + rounding * np.eye(n_channels), freqs, n_removed)

    rest = [x - q @ (q.T @ x) for q, x in zip(np.linalg.qr(seen)[0], data, strict=True)]
    products = sum(block @ block.T for block in rest) / n_modes
    faint = faint_of(products * n_channels / (n_channels - n_smooth), n_smooth)
    converged, n_turns, n_removed = False, 0, n_smooth
    while not converged and n_turns < _MOST_TURNS:
        n_turns += 1
        axes = _foreground_axes(data, seen, faint, n_sources, share)
        products = 0  # of HI and noise, given the data
        spectra = seen @ axes
        estimators = wiener_estimators(spectra, faint)
        for one, estimator, block in zip(spectra, estimators, data, strict=True):
            rest = block - one @ (estimator @ block)
            products = products + rest @ rest.T + block.shape[1] * (one @ (estimator @ faint))
        # Never more than in the last turn: a faint one could otherwise alternate forever.
        n_removed = min(n_removed, int(np.sum(axes.any(axis=0))))
        before, faint = faint, faint_of((products + products.T) / (2 * n_modes), n_removed)
        converged = bool(np.linalg.norm(faint - before) <= _SETTLED * np.linalg.norm(before))
    values = np.linalg.eigvalsh(before)
    converged &= bool(values[-1] < _STEEPEST * np.median(values))
    amplitudes = [axes @ (one @ block) for one, block in zip(estimators, data, strict=True)]
    return axes, before, np.hstack(amplitudes), converged, n_turns


def _foreground_axes(data, seen, faint, n_sources, share):
    """Axes of the foreground in the smooth functions, for sources of unit variance, (n_smooth, n_sources)."""
    n_modes = sum(block.shape[1] for block in data)
    weighted = np.linalg.inv(faint) @ seen
    known = np.swapaxes(seen, 1, 2) @ weighted
    noise, signal = 0, 0
    for one, precision, block in zip(weighted, known, data, strict=True):
        amplitudes = np.linalg.solve(precision, one.T @ block)
        signal = signal + amplitudes @ amplitudes.T
        noise = noise + block.shape[1] * np.linalg.inv(precision)
    root = np.linalg.cholesky(noise / n_modes)
    values, axes = np.linalg.eigh(np.linalg.solve(root, np.linalg.solve(root, signal / n_modes).T))
    values, axes = values[::-1][:n_sources], axes[:, ::-1][:, :n_sources]
    return root @ (axes * np.sqrt(shrunk_variance(values, len(axes) / (share * n_modes))))


def smooth_basis(freqs, n_smooth):
    """Orthonormal basis: power law times polynomials in log frequency, (n_channels, n_smooth)."""
    x = np.log(freqs)
    x = 2 * (x - x[0]) / (x[-1] - x[0]) - 1
    power_law = (freqs / freqs[0]) ** _INDEX
    return np.linalg.qr(power_law[:, None] * np.polynomial.legendre.legvander(x, n_smooth - 1))[0]


def smooth_seen(data, n_smooth):
    """Smooth functions times beams over the best beam, (n_l, n_channels, n_smooth), to the last common l."""
    windows = (data.beams / data.beams.max(axis=0)).T[: 3 * sphere.nside_of(data.maps), :, None]
    return windows * smooth_basis(data.freqs, n_smooth)


def multipole_bands(lmax):
    """First and last l of bands that widen with l and cover all l up to `lmax`."""
    edges = [0]
    while edges[-1] <= lmax:
        edges.append(max(edges[-1] + _LEAST_WIDTH, int(_GROWTH * edges[-1])))
    if len(edges) > 2 and lmax + 1 - edges[-2] < _LEAST_WIDTH:
        del edges[-2]
    edges[-1] = lmax + 1
    return [(low, high - 1) for low, high in zip(edges[:-1], edges[1:], strict=True)]


def degrees_of(band):
    """The l of a band that have modes: means are subtracted, so l = 0 has none."""
    first, last = band
    return range(max(first, 1), last + 1)


def shrunk_variance(values, ratio):
    """Variance of a signal behind sample eigenvalues, (n,), of signal plus noise of unit variance.

    Shrinks eigenvalues optimally in the Frobenius norm (Donoho, Gavish & Johnstone 2018): to 0 up to the
    edge (1 + sqrt(ratio))^2 of the eigenvalues of pure noise (Marchenko & Pastur 1967), and continuously
    above. `ratio` is dimensions over samples.
    """
    signal = signal_variance(values, ratio)
    bright = np.maximum(signal, np.sqrt(ratio))
    return signal * np.maximum(1 - ratio / bright**2, 0) / (1 + ratio / bright)


def signal_variance(values, ratio):
    """The same without shrinkage: the variance along known axes (Baik & Silverstein 2006)."""
    edge = (1 + np.sqrt(ratio)) ** 2
    half = (np.maximum(values, edge) + 1 - ratio) / 2
    return np.where(values > edge, half + np.sqrt(np.maximum(half**2 - np.maximum(values, edge), 0)) - 1, 0)


def faint_covariance(products, freqs, n_removed):
    """A covariance D R D with D smooth in frequency and R of a stationary field with smooth power.

    HI along a line of sight, at one l, is close to stationary, and its power has no features: the logarithm
    of the variance of a channel is a cubic in frequency, that of the power a cubic in k / (k + 0.3/MHz),
    which rises from 0 to nearly 1 and is flat at both ends. So the power at small k, where HI is removed with
    the foregrounds, is extrapolated from where foregrounds are negligible, and a smooth spectrum that is no
    brighter than HI is not removed as foreground.

    `products` are the mean products of the modes of two channels, (n_channels, n_channels), with centres
    `freqs`, MHz. `n_removed` smooth spectra were subtracted: the power below half a wave more than these in
    the band is ignored. The result is positive definite.
    """
    # Waves up to the Nyquist of the closest channels: with fewer, close channels would coincide.
    band, even = freqs[-1] - freqs[0], evenly_spaced(freqs)
    closest = max(np.diff(freqs).min(), np.diff(freqs).mean() / _CLOSEST)
    n_waves = len(freqs) if even else 1 + int(np.ceil(band / closest))
    waves, places = np.arange(n_waves), (freqs - freqs[0]) / band * (n_waves - 1)
    levels = np.sqrt(_smooth(np.diag(products), places, _LEVEL_ORDER))
    # A periodogram with a sine taper, so that bright power at small k does not leak.
    taper = np.sin(np.pi * (places + 0.5) / n_waves)
    transform = np.exp(-1j * np.pi / n_waves * np.outer(waves, places)) * taper
    correlation = products / np.outer(levels, levels)
    power = np.sum((transform @ correlation) * transform.conj(), axis=1).real / np.sum(taper**2)
    k = np.pi * waves / band
    first = max(0, min(n_removed + 1, n_waves - _POWER_ORDER - 1))
    weights = _smooth(power, k / (k + _SCALE), _POWER_ORDER, first)
    weights[[0, -1]] /= 2  # the trapezoidal rule in k
    lags = places if even else np.abs(places[:, None] - places).ravel()
    rows = np.cos(np.pi / (n_waves - 1) * np.outer(lags, waves)) @ weights / weights.sum()
    return np.outer(levels, levels) * (toeplitz(rows) if even else rows.reshape(products.shape))


def log_fit(design, values):
    """Fit b in values = exp(design @ b) times scatter of one relative size: regression of a gamma variable.

    Unlike in a fit to the logarithms, scatter does not bias the mean (McCullagh & Nelder 1989, Sect. 8).
    """
    inverse = np.linalg.pinv(design)
    coefficients, change, n_steps = inverse @ np.log(values), np.inf, 0
    while change >= _SMALL and n_steps < _MOST_STEPS:
        step = inverse @ (values * np.exp(-design @ coefficients) - 1)
        change, n_steps = np.abs(design @ step).max(), n_steps + 1
        coefficients += step / max(1, change)  # never more than a factor of e
    return coefficients


def _smooth(values, places, order, first=0):
    """Fit `values` at ascending `places` with the exponential of a polynomial, from index `first` on."""
    x = 2 * (places - places[0]) / (places[-1] - places[0]) - 1
    design = np.polynomial.legendre.legvander(x, min(order, len(values) - first - 1))
    return np.exp(design @ log_fit(design[first:], np.maximum(values[first:], np.finfo(float).tiny)))
