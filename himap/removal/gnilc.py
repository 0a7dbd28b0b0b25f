"""Generalised needlet internal linear combination: what stands out of HI and noise is foreground."""

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy import linalg
from threadpoolctl import threadpool_limits

from himap.errors import InputError
from himap.maps import sphere
from himap.maps.blocked import projection
from himap.maps.needlets import cosine_needlets
from himap.progress import progress
from himap.removal import harmonic
from himap.removal.base import ForegroundRemover, Separation, parameter
from himap.removal.conventions import ordered
from himap.removal.hi_prior import band_covariance, expected_covariance, mock_covariances, read_mock

__all__ = ["GNILC", "foreground_filter", "n_foreground"]

_ROUNDING = 1e-14  # of the variance of the data: a prior below that is of float32 maps without HI and noise


@dataclass(frozen=True, kw_only=True)
class GNILC(ForegroundRemover):
    """Needlet by needlet, the axes in which the data have more than HI and noise are removed.

    Maps are cut into needlets, windows h_j(l) with sum_j h_j^2 = 1 (`cosine_needlets`). In each of them the
    covariance R of the channels is held against Q, that expected of HI and noise: where there is no
    foreground the eigenvalues mu of R~ = Q^-1/2 R Q^-1/2 are near 1. The number m of those that have some is
    the one with the least

        2 m + sum_{i > m} (mu_i - ln mu_i - 1)

    (Akaike 1974). With U the other eigenvectors and S = Q^1/2 U, HI and noise are
    S (S^T R^-1 S)^-1 S^T R^-1 x, x being the data in that needlet, which goes back through h_j (Remazeilles
    et al. 2011; for HI Olivari et al. 2016). As U are eigenvectors of R~, this is Q^1/2 U U^T Q^-1/2 x, and
    the foreground is the same of the first m eigenvectors: a mixing matrix times sources in each needlet, and
    in all of them some dozens of spectra. What transforms cannot hold, beyond the last l, is filtered as the
    last needlet.

    Two things are not as published. R is of the whole sky in every needlet, not of a region around each
    pixel. Regions must hold many more modes than there are channels, or chance takes signal away (the bias of
    an internal linear combination); with a hundred channels that is most of the sky in all needlets but the
    finest. And an axis with *less* power than expected never counts as foreground; in the sum as it stands,
    many that are far too faint would.

    Q should be that of a mock of HI and noise through the instrument, the `prior`, made `stationary`, for one
    mock has few modes. Without it Q has its shape from theory and its level from the data
    (`expected_covariance`), as a method is not to know the simulations.
    """

    name: ClassVar[str] = "gnilc"
    needs_whole_sky: ClassVar[bool] = True
    needs_modes: ClassVar[bool] = True
    first_peak: int = parameter(
        20, "l of the peak of the first needlet; that of each next one is twice as large", minimum=2
    )
    prior: str | None = parameter(None, "file (.npy) with a mock of HI and noise, (n_channels, n_pix), mK")

    def __post_init__(self):
        super().__post_init__()
        if not isinstance(self.prior, str | None):
            raise InputError(f"prior must be the path of a .npy file, got {self.prior!r}.")

    def digest(self):
        """A hash of the mock."""
        return "" if self.prior is None else sha256(Path(self.prior).read_bytes()).hexdigest()

    def _separate(self, maps, *, freqs, beams, rng, modes):
        nside = sphere.nside_of(maps)
        lmax = 3 * nside - 1
        peaks = self._peaks(lmax)
        windows = cosine_needlets(peaks, lmax)
        # The number of threads changes the last bits of products, and with them what is counted.
        with threadpool_limits(1, user_api="blas"):
            filters = self._filters(maps, freqs, modes, peaks, windows)
        found = [
            _through(window**2, modes.along(rows, lmax), nside)
            for window, (_, rows) in zip(progress(windows, self.name), filters, strict=True)
        ]
        _, rows = filters[-1]  # beyond the last l: what is in the maps less what is in their modes
        found[-1] += projection(rows, maps) - _through(np.ones(lmax + 1), modes.along(rows, lmax), nside)
        mixing, sources = ordered(np.hstack([spectra for spectra, _ in filters]), np.concatenate(found))
        return Separation(mixing=mixing, sources=sources)

    def _peaks(self, lmax):
        """l of the peaks of the needlets, ascending; the last ends below 2 lmax."""
        peaks = [self.first_peak]
        while 2 * peaks[-1] < lmax:
            peaks.append(2 * peaks[-1])
        return peaks

    def _filters(self, maps, freqs, modes, peaks, windows):
        """For each needlet the spectra of its foreground and the rows that find their amplitudes."""
        if self.prior is not None:
            priors = mock_covariances(read_mock(self.prior, maps.shape), windows)
        filters = []
        for n, (peak, window) in enumerate(zip(peaks, windows, strict=True)):
            covariance = band_covariance(modes.upto(int(np.flatnonzero(window).max())), window)
            prior = expected_covariance(covariance, freqs, peak) if self.prior is None else priors[n]
            filters.append(foreground_filter(covariance, prior))
        return filters


def _through(weights, modes, nside):
    """Maps of modes times weights of l, (n, (lmax + 1)^2) to (n, n_pix)."""
    maps = np.empty((len(modes), 12 * nside**2))
    for mode, out in zip(modes * weights[harmonic.degrees(len(weights) - 1)], maps, strict=True):
        out[:] = sphere.synthesise(harmonic.from_modes(mode), nside)
    return maps


def foreground_filter(covariance, prior):
    """What projects on the foreground, as spectra times rows, (n_channels, m) and (m, n_channels).

    Parameters
    ----------
    covariance, prior
        R of the data and Q of HI and noise, (n_channels, n_channels), mK^2.
    """
    n_channels = len(prior)
    least = _ROUNDING * np.trace(covariance) / n_channels
    root = linalg.cholesky(prior + least * np.eye(n_channels), lower=True)
    half = linalg.solve_triangular(root, covariance, lower=True)
    values, axes = np.linalg.eigh(linalg.solve_triangular(root, half.T, lower=True))
    axes = axes[:, ::-1][:, : n_foreground(values[::-1])]
    return root @ axes, linalg.solve_triangular(root, axes, lower=True, trans="T").T


def n_foreground(values):
    """How many of the eigenvalues of R~, descending, have foreground in them."""
    values = np.maximum(values, 1)
    unexplained = values - np.log(values) - 1
    left = np.append(np.cumsum(unexplained[::-1])[::-1], 0)
    return int(np.argmin(2 * np.arange(len(left)) + left))
