"""What is known of the foreground of a cube where HI and noise are like some mocks, and draws of it."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import wishart

from himap.core.errors import InputError
from himap.core.progress import progress
from himap.maps import sphere
from himap.maps.low_rank import LowRankCube
from himap.removal import harmonic
from himap.removal.smooth_spectra import (
    FilteredSeparation,
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
    estimated,
    filtered,
    on_sky,
)

N_SMOOTH = 6
"""Smooth functions of frequency: they hold any power law to the last digit of float32."""

_REACH = 2  # bands on either side that the faint spectra of a band are estimated from too


def products_of(fields, lmax):
    """Mean products of two channels in each band of multipoles, (n_bands, n_channels, n_channels), mK^2.

    Of `fields` of HI and noise alone, their coefficients (n_channels, n_alm), mK, through the beam, less
    channel means.
    """
    edges, products, n_fields = multipole_bands(lmax), 0, 0
    for field in fields:
        n_fields += 1
        bands = (harmonic.to_modes(field, max(first, 1), last) for first, last in edges)
        products = products + np.array([modes @ modes.T for modes in bands])
    n_modes = [(last + 1) ** 2 - max(first, 1) ** 2 for first, last in edges]
    return products / n_fields / np.array(n_modes)[:, None, None]


@dataclass(frozen=True, kw_only=True)
class SmoothForeground:
    """The covariance of the foreground of some data, if HI and noise are like mocks.

    As in `SmoothSpectra` the foreground is smooth functions of frequency seen through the beams, with a
    covariance of its own in each band of multipoles. Here that of HI and noise is known but for a factor, so
    that the power of the foreground is what the data have more; it is not shrunk, for that would be a bias.

    Attributes
    ----------
    faint
        Covariance of HI and noise per mode in each band, mK^2, (n_bands, n_channels, n_channels).
    roots
        R, (n_bands, n_smooth, n_smooth), with R R^T the covariance of what is HI and noise in the amplitudes
        of the smooth functions, by least squares.
    axes
        Those of the foreground, (n_smooth, n_axes) of each band, a list, with columns of zeros where a band
        has fewer: R axes axes^T R^T is its covariance.
    n_modes
        Of each band.
    products, n_mocks
        `products_of` the mocks, and of how many.
    n_exact
        How many of the bands end before 2 nside. Beyond, HEALPix holds what is bright with errors that can
        be more than HI, and smooth in frequency: there the foreground has the spectra of the last of these.
    """

    faint: np.ndarray
    roots: np.ndarray
    axes: list
    n_modes: tuple
    n_exact: int
    products: np.ndarray
    n_mocks: int

    def of_member(self, data, mock):
        """The same of a member of a bootstrap, `Data` whose HI and noise are one of the mocks.

        Its products are those of the others, as those of the data are of other skies; of one mock it is that.
        `mock` are its coefficients, (n_channels, n_alm), mK.
        """
        products, n = self.products, self.n_mocks
        if n > 1:
            lmax = min(3 * sphere.nside_of(data.maps), data.beams.shape[1]) - 1
            products = (n * products - products_of([sphere.alms_upto(mock, lmax)], lmax)) / (n - 1)
        return foreground_given(data, products, max(n - 1, 1))

    def draw(self, data, rng):
        """A foreground drawn from what is known of that of the data, a `FilteredSeparation`.

        First its covariance, from what would be estimated of skies with this one. Then the foreground given
        data and covariances: to the mean, a Wiener filter, which has less power than the foreground, is added
        W_l s_l, with the covariance of sources of unit variance given the data, (W_l^T C^-1 W_l + 1)^-1
        (Wandelt, Larson & Lakshminarayanan 2004).
        """
        totals = []
        for axes, n in zip(self.axes, self.n_modes, strict=True):
            one = np.eye(len(axes))
            # Lower triangular with a positive diagonal, root root^T = axes axes^T + 1, whatever their ratio.
            root = np.linalg.qr(np.vstack([axes.T, one]), mode="r").T
            root *= np.sign(np.diag(root))
            drawn = np.atleast_2d(wishart(n, one / n).rvs(random_state=rng))
            totals.append(root @ drawn @ root.T)
        axes = _axes(self.roots, totals, self.n_modes, self.n_exact)
        linear = replace(self, axes=axes)._filter(data)
        spaces, mixing = np.linalg.qr(linear.spectra)
        sources, beyond = estimated(mixing @ linear.estimators, data.project, data.modes)
        pairs = list(zip(spaces, mixing, linear.uncertain, harmonic.blocks(sources), strict=True))
        for space, mixed, uncertain, out in pairs[1:]:  # means are subtracted
            # Of draws in channels: the axes of the space, and so draws along them, have a sign by chance.
            drawn = space.T @ rng.standard_normal((len(space), out.shape[1]))
            out += _root(mixed @ uncertain @ mixed.T) @ drawn
        low_rank = on_sky(combined(sources, spaces, FINE), sphere.nside_of(beyond))
        return _of_filter(linear, low_rank + LowRankCube(spectra=spaces[-1], maps=beyond), data)

    def _filter(self, data):
        """The Wiener filter that makes the mean of the foreground given the data, a `SpectralFilter`."""
        seen = smooth_seen(data, N_SMOOTH)
        edges = multipole_bands(len(seen) - 1)
        bands = zip(edges, self.roots, self.axes, strict=True)
        spectra = [seen[first : last + 1] @ root @ axes for (first, last), root, axes in bands]
        return SpectralFilter.wiener(spectra, self.faint, edges)

    def residual_spectra(self, data, separation, beams=None):
        """Spectra F of what a method leaves of the foreground given the data, (n_channels, n), of each l.

        F F^T is its covariance, mK^2, a mean over the 2 l + 1 modes: that of the mean of the foreground, and
        of what is not known of it. It is all that is left by projections on spectra, such as PCA and
        `BeamSubspace`, and by `SmoothSpectra`; other methods may leave more.

        Parameters
        ----------
        data
            The `Data` that this is the foreground of.
        separation
            What the method found, whose spectra are held fixed. It leaves what least squares do not fit with
            these, or its filter does not hold.
        beams
            b_l that the method has its spectra seen through, (n_channels, lmax + 1), if it does. It ends
            where these or those of the data do.
        """
        linear = self._filter(data)
        known = zip(linear.spectra, linear.estimators, linear.uncertain, strict=True)
        pairs = zip(known, _removed(separation, beams, len(linear.spectra)), strict=False)
        for degree, ((spectra, estimator, uncertain), (removed, fit)) in enumerate(pairs):
            mean = estimator @ data.modes.at(degree)
            root = _root(mean @ mean.T / (2 * degree + 1) + uncertain)
            # Means are subtracted.
            yield (spectra - removed @ (fit @ spectra)) @ root * bool(degree)

    def mean(self, data):
        """The mean of the foreground given the data, and the filter that makes it, a `FilteredSeparation`."""
        linear = self._filter(data)
        return _of_filter(linear, filtered(linear.spectra, linear.estimators, data.project, data.modes), data)


def foreground_given(data, products, n_mocks=1):
    """The `SmoothForeground` of data, where HI and noise have the covariance of mocks.

    Parameters
    ----------
    data
        `Data` of the full sphere with beams, and with the peaks that the mocks have too.
    products, n_mocks
        `products_of` the mocks, and of how many.

    Raises
    ------
    InputError
        Too few channels, or too narrow a band, for the smooth functions.
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
    """One band: C, R as in `SmoothForeground`, the covariance R^-1 D R^-T of all amplitudes, and n_modes.

    The product of the mocks is scaled to the power that the data have in spectra that are not smooth: it says
    how the power of HI depends on k, but not how much there is. Amplitudes follow by least squares weighted
    with C^-1, what is HI and noise in them from that product. Without foreground the covariance is near 1.
    """
    degrees = range(max(band[0], 1), band[1] + 1)
    blocks = [(np.array(modes.at(degree)), seen[degree]) for degree in degrees]
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
    """Axes of the foreground in amplitudes of which HI and noise have the covariance 1, of each band, a list.

    Of R of the bands, and the covariances of all, (n_smooth, n_smooth) each. Axes that are bright in a band
    are its own. Beyond these its foreground is the mean of the bands around it, of what each of them has
    beyond as many axes, bright or not, weighted with their modes but none with more than its own, so that
    what is fainter at higher l hardly counts. After the first `n_exact` the covariance of amplitudes is that
    of the last of these times a factor, by least squares, but at most 1, as no foreground gets brighter with
    l.
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


def _removed(separation, beams, n_degrees):
    """W_l and G_l of a `Separation` for each l in turn: it leaves 1 - W_l G_l."""
    if isinstance(separation, FilteredSeparation):
        return zip(separation.filter.spectra, separation.filter.estimators, strict=True)
    if beams is None:
        spectra = separation.foreground.spectra
        return [(spectra, np.linalg.pinv(spectra, rcond=RANK))] * n_degrees
    seen = (beams / beams.max(axis=0)).T[:n_degrees, :, None] * separation.mixing  # so that no l is 0
    return zip(seen, np.linalg.pinv(seen, rcond=RANK), strict=True)


def _root(covariance):
    """The symmetric root of a covariance, (n, n)."""
    values, turn = np.linalg.eigh(covariance)
    return (turn * np.sqrt(np.maximum(values, 0))) @ turn.T


def _of_filter(linear, low_rank, data):
    """The `FilteredSeparation` of a foreground, a `LowRankCube`, that a `SpectralFilter` makes."""
    return FilteredSeparation(
        mixing=low_rank.spectra, sources=low_rank.maps, low_rank=low_rank, filter=linear, means=data.means
    )
