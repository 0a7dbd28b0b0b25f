"""The posterior of the foreground of a cube, given mocks of HI and noise, and draws from it."""

from dataclasses import dataclass, replace
from itertools import repeat

import numpy as np
from scipy.stats import wishart

from himap.core.errors import InputError
from himap.core.progress import progress
from himap.maps import sphere
from himap.removal import harmonic
from himap.removal.smooth_spectra import (
    FilteredSeparation,
    degrees_of,
    faint_covariance,
    multipole_bands,
    signal_variance,
    smooth_seen,
)
from himap.removal.spectral_filter import (
    FINE,
    RANK,
    SpectralFilter,
    combined,
    filtered,
    on_sky,
)

N_SMOOTH = 6
"""Number of smooth functions of frequency: they represent any power law to the last digit of float32."""

_PATCH = 3  # FWHM, deg, over which the brightness of the foreground is averaged
_REACH = 2  # neighbouring bands on either side also used for the faint spectra of a band


def products_of(fields, lmax):
    """Mean products of two channels in each band of multipoles, (n_bands, n_channels, n_channels), mK^2.

    `fields` are of HI and noise alone: coefficients (n_channels, n_alm), mK, seen through the beam, less
    channel means.
    """
    bands, products, n_fields = [degrees_of(band) for band in multipole_bands(lmax)], 0, 0
    for field in fields:
        n_fields += 1
        parts = (harmonic.to_modes(field, degrees[0], degrees[-1]) for degrees in bands)
        products = products + np.array([modes @ modes.T for modes in parts])
    n_modes = [sum(2 * degree + 1 for degree in degrees) for degrees in bands]
    return products / n_fields / np.array(n_modes)[:, None, None]


@dataclass(frozen=True, kw_only=True)
class SmoothForeground:
    """The covariance of the foreground of some data, assuming that HI and noise are like mocks.

    As in `SmoothSpectra`, the foreground is smooth functions of frequency seen through the beams, with its
    own covariance in each band of multipoles. Here the covariance of HI and noise is known up to a factor, so
    the power of the foreground is the excess of the data; it is not shrunk, as that would bias it.

    Attributes
    ----------
    faint
        Covariance of HI and noise per mode in each band, mK^2, (n_bands, n_channels, n_channels).
    roots
        R, (n_bands, n_smooth, n_smooth), where R R^T is the covariance of HI and noise in the
        least-squares amplitudes of the smooth functions.
    axes
        Axes of the foreground, (n_smooth, n_axes) for each band, a list, with zero columns if a band has
        fewer: R axes axes^T R^T is the covariance of the foreground.
    n_modes
        Number of modes of each band.
    products, n_mocks
        `products_of` the mocks, and the number of mocks.
    n_exact
        Number of bands that end before 2 nside. Beyond, HEALPix has errors of bright emission that may
        exceed HI and are smooth in frequency: there the foreground has the spectra of the last such band.
    """

    faint: np.ndarray
    roots: np.ndarray
    axes: list
    n_modes: tuple
    n_exact: int
    products: np.ndarray
    n_mocks: int

    def of_member(self, data, mock):
        """The same for a member of a bootstrap, `Data` whose HI and noise are one of the mocks.

        Its products are those of the other mocks, as those of the data are from other skies; if there is only
        one mock, of that one. `mock` are its coefficients, (n_channels, n_alm), mK.
        """
        products, n = self.products, self.n_mocks
        if n > 1:
            lmax = min(3 * sphere.nside_of(data.maps), data.beams.shape[1]) - 1
            products = (n * products - products_of([sphere.alms_upto(mock, lmax)], lmax)) / (n - 1)
        return foreground_given(data, products, max(n - 1, 1))

    def draw(self, data, rng):
        """Draw a foreground from its posterior given the data, a `FilteredSeparation`.

        First a covariance is drawn, from its estimates for skies with this one. Then the foreground given
        data and covariances: the mean, a Wiener filter, has less power than the foreground, so W_l s_l is
        added, where s_l has the covariance of unit-variance sources given the data, (W_l^T C^-1 W_l + 1)^-1
        (Wandelt, Larson & Lakshminarayanan 2004). It is multiplied by the relative brightness of the mean: in
        our Galaxy faint components are where the bright ones are, and methods with thresholds see the
        difference.
        """
        totals = []
        for axes, n in zip(self.axes, self.n_modes, strict=True):
            one = np.eye(len(axes))
            # Lower triangular with a positive diagonal, root root^T = axes axes^T + 1, whatever their ratio.
            root = np.linalg.qr(np.vstack([axes.T, one]), mode="r").T
            root *= np.sign(np.diag(root))
            white = np.atleast_2d(wishart(n, one / n).rvs(random_state=rng))
            totals.append(root @ white @ root.T)
        drawn = replace(self, axes=_axes(self.roots, totals, self.n_modes, self.n_exact))
        linear = drawn._filter(data)
        mean = filtered(linear.spectra, linear.estimators, data.project, data.modes)
        seen, nside = smooth_seen(data, N_SMOOTH), sphere.nside_of(mean.maps)
        maps = harmonic.synthesise(drawn._uncertain(linear, rng), nside) * _brightness(mean)
        modes = harmonic.to_modes(sphere.analyse(maps, len(seen) - 1))
        modes[:, 0] = 0  # means are subtracted
        low_rank = mean + on_sky(combined(modes, seen, FINE), nside)
        return FilteredSeparation(
            mixing=low_rank.spectra, sources=low_rank.maps, low_rank=low_rank, filter=linear, means=data.means
        )

    def _uncertain(self, linear, rng):
        """Draw what the data leave uncertain: modes of the smooth functions, (n_smooth, (lmax + 1)^2).

        Drawn in these functions, as the axes of the covariance have arbitrary signs.
        """
        modes, uncertain = np.zeros((N_SMOOTH, len(linear.spectra) ** 2)), linear.uncertain
        blocks = harmonic.blocks(modes)
        bands = zip(multipole_bands(len(blocks) - 1), self.roots, self.axes, strict=True)
        for band, root, axes in bands:
            for degree in degrees_of(band):
                covariance = root @ axes @ uncertain[degree] @ axes.T @ root.T
                blocks[degree][:] = _root(covariance) @ rng.standard_normal(blocks[degree].shape)
        return modes

    def _filter(self, data):
        """The Wiener filter that gives the mean of the foreground given the data, a `SpectralFilter`."""
        seen = smooth_seen(data, N_SMOOTH)
        edges = multipole_bands(len(seen) - 1)
        bands = zip(edges, self.roots, self.axes, strict=True)
        spectra = [seen[first : last + 1] @ root @ axes for (first, last), root, axes in bands]
        return SpectralFilter.wiener(spectra, self.faint, edges)

    def residual_spectra(self, data, separation, beams=None):
        """Spectra F of the foreground residual of a method, given the data, (n_channels, n), for each l.

        F F^T is its covariance, mK^2, averaged over the 2 l + 1 modes: that of the mean of the foreground,
        plus its uncertainty. It is the complete residual for projections on spectra, such as PCA and
        `BeamSubspace`, and for `SmoothSpectra`; the residual of other methods may be larger.

        Parameters
        ----------
        data
            The `Data` whose foreground this is.
        separation
            Result of the method, whose spectra are held fixed. Its residual is what a least-squares fit
            of these does not describe, or what its filter does not pass.
        beams
            b_l through which the method sees its spectra, (n_channels, lmax + 1), if it uses beams.
            Spectra end at the last l of these or of the beams of the data.
        """
        linear = self._filter(data)
        known = zip(linear.spectra, linear.estimators, linear.uncertain, strict=True)
        # The residual is 1 - W_l G_l times the data; W_l and G_l are `removed` and `fits`.
        if isinstance(separation, FilteredSeparation):
            removed, fits = separation.filter.spectra, separation.filter.estimators
        elif beams is None:
            fixed = separation.foreground.spectra
            removed, fits = repeat(fixed), repeat(np.linalg.pinv(fixed, rcond=RANK))
        else:
            seen = (beams / beams.max(axis=0)).T[: len(linear.spectra)]  # so that no l is 0
            removed = seen[:, :, None] * separation.mixing
            fits = np.linalg.pinv(removed, rcond=RANK)
        pairs = zip(known, removed, fits, strict=False)
        for degree, ((spectra, estimator, uncertain), removed, fit) in enumerate(pairs):
            mean = estimator @ data.modes.at(degree)
            root = _root(mean @ mean.T / (2 * degree + 1) + uncertain)
            # Means are subtracted.
            yield (spectra - removed @ (fit @ spectra)) @ root * bool(degree)


def foreground_given(data, products, n_mocks=1):
    """The `SmoothForeground` of data, if HI and noise have the covariance of mocks.

    Parameters
    ----------
    data
        `Data` of the full sphere with beams, and with peaks if the mocks have them.
    products, n_mocks
        `products_of` the mocks, and the number of mocks.

    Raises
    ------
    InputError
        If there are too few channels, or too narrow a band, for the smooth functions.
    """
    freqs = data.freqs
    wanted = f"error bars need the foreground as {N_SMOOTH} smooth functions of frequency"
    if len(freqs) <= N_SMOOTH:
        raise InputError(f"{wanted}, so more channels than these, got {len(freqs)}: take more channels.")
    seen, modes = smooth_seen(data, N_SMOOTH), data.modes
    edges = multipole_bands(len(seen) - 1)
    pairs = zip(progress(edges, "foreground"), products, strict=True)
    try:
        bands = [_amplitudes(modes, band, seen, freqs, product) for band, product in pairs]
    except np.linalg.LinAlgError:
        raise InputError(
            f"{wanted}, and over {freqs[-1] - freqs[0]:.4g} MHz in {len(freqs)} channels these cannot be "
            "separated from HI: take a wider band."
        ) from None
    faint, roots, totals, n_modes = zip(*bands, strict=True)
    n_exact = max(1, sum(last <= 2 * sphere.nside_of(data.maps) for _, last in edges))
    axes = _axes(roots, totals, n_modes, n_exact)
    return SmoothForeground(
        faint=np.array(faint),
        roots=np.array(roots),
        axes=axes,
        n_modes=n_modes,
        n_exact=n_exact,
        products=products,
        n_mocks=n_mocks,
    )


def _amplitudes(modes, band, seen, freqs, product):
    """For one band: C, R as in `SmoothForeground`, the covariance R^-1 D R^-T of all amplitudes, n_modes.

    The product of the mocks is scaled to the power of the data in spectra that are not smooth: it gives the
    dependence of HI power on k, but not its level. Amplitudes follow by least squares weighted with C^-1,
    the HI and noise in them from that product. Without foreground the covariance is near 1.
    """
    blocks = [(np.array(modes.at(degree)), seen[degree]) for degree in degrees_of(band)]
    power, expected, noise, total, n_modes = 0, 0, 0, 0, 0
    for data, spectra in blocks:
        smooth = np.linalg.qr(spectra)[0]
        power += np.sum((data - smooth @ (smooth.T @ data)) ** 2)
        expected += data.shape[1] * (np.trace(product) - np.sum(smooth * (product @ smooth)))
    product = product * (power / expected)
    faint = faint_covariance(product, freqs, 0)
    for data, spectra in blocks:
        weighted = np.linalg.solve(faint, spectra)
        estimator = np.linalg.solve(spectra.T @ weighted, weighted.T)
        amplitudes = estimator @ data
        noise = noise + data.shape[1] * (estimator @ product @ estimator.T)
        total, n_modes = total + amplitudes @ amplitudes.T, n_modes + data.shape[1]
    root = np.linalg.cholesky(noise / n_modes)
    return faint, root, np.linalg.solve(root, np.linalg.solve(root, total / n_modes).T), n_modes


def _axes(roots, totals, n_modes, n_exact):
    """Axes of the foreground in amplitudes in which HI and noise have unit covariance; a list, one per band.

    `roots` are R of the bands, `totals` the covariances of all amplitudes, (n_smooth, n_smooth) each. Bright
    axes of a band are its own. The remaining foreground is an average over neighbouring bands: each
    contributes its covariance beyond as many axes, bright or not, weighted with its modes but by no more than
    the band's own, so fainter bands at higher l hardly count. After the first `n_exact` bands, the covariance
    of amplitudes is that of the last of these times a least-squares factor, at most 1, as no foreground
    brightens with l.
    """
    eigen, several = [np.linalg.eigh(total) for total in totals[:n_exact]], []
    for place, (values, axes) in enumerate(eigen):
        variances = signal_variance(values, len(values) / n_modes[place])
        n_rest = np.sum(variances == 0)
        around = slice(max(0, place - _REACH), min(place + _REACH + 1, n_exact))
        modes = np.array(n_modes[around], dtype=float)
        weights = np.minimum(modes, n_modes[place])
        weights /= weights.sum()
        near = zip(weights, eigen[around], strict=True)
        excess = sum(w * (a[:, :n_rest] * (v[:n_rest] - 1)) @ a[:, :n_rest].T for w, (v, a) in near)
        rest = axes[:, :n_rest]
        faint, turn = np.linalg.eigh(rest.T @ excess @ rest)
        faint = signal_variance(1 + faint, n_rest * np.sum(weights**2 / modes))
        bright = axes[:, n_rest:] * np.sqrt(variances[n_rest:])
        several.append(np.hstack([bright, rest @ turn * np.sqrt(faint)]))
    last = roots[n_exact - 1] @ several[-1]
    for root, total in zip(roots[n_exact:], totals[n_exact:], strict=True):
        beyond = root @ (total - np.eye(len(total))) @ root.T
        share = np.sum(last * (beyond @ last)) / np.sum((last.T @ last) ** 2) if last.any() else 0
        several.append(np.linalg.solve(root, last) * np.sqrt(np.clip(share, 0, 1)))
    n_axes = max(one.shape[1] for one in several)
    return [np.pad(one, ((0, 0), (0, n_axes - one.shape[1]))) for one in several]


def _brightness(foreground):
    """The rms over channels of a `LowRankCube` less its mean, (n_pix,), over that of the sky; 1 if it is 0.

    Smoothed, as it would be 0 along lines on which the foreground equals its mean.
    """
    squares = np.sum((np.linalg.qr(foreground.spectra, mode="r") @ foreground.maps) ** 2, axis=0)
    if not squares.any():
        return np.ones_like(squares)
    nside = sphere.nside_of(squares)
    alm = sphere.analyse(squares)
    beam = sphere.gaussian_beam(np.deg2rad(_PATCH), sphere.lmax_of_size(alm.shape[-1]))
    squares = np.maximum(sphere.synthesise(sphere.multiply_beam(alm, beam), nside), 0)
    return np.sqrt(squares / squares.mean())


def _root(covariance):
    """The symmetric root of a covariance, (n, n)."""
    values, turn = np.linalg.eigh(covariance)
    return (turn * np.sqrt(np.maximum(values, 0))) @ turn.T
