"""Generalised needlet internal linear combination: what stands out of HI and noise is foreground."""

from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy import linalg

from himap.core.errors import InputError
from himap.core.progress import progress
from himap.maps import sphere
from himap.maps.blocked import projection
from himap.maps.needlets import cosine_needlets
from himap.removal import harmonic
from himap.removal.base import ForegroundRemover, Separation, parameter
from himap.removal.hi_prior import band_covariance, expected_covariance, mock_covariances, read_mock
from himap.removal.local_filters import local_difference
from himap.removal.separation import ordered

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

    The paper takes R around each pixel, from a region with so many modes that channels over modes, the
    bias of an internal linear combination, is small. That is the parameter `bias`; a needlet that has not
    as many modes on the whole sky has one R, as all have with a bias of 0. With a hundred channels only
    the finest have regions, and their filters (`local_difference`) cost much more than the rest. For the
    same reason the first needlet needs many more modes than there are channels: with hundreds of channels
    a `first_peak` of 20 is too small, and takes HI at the lowest l. Beyond the last l the filter is that
    of the whole sky. Not as published is that an axis with *less* power than expected never counts as
    foreground: in the sum as it stands, many that are far too faint would.

    Q should be that of a mock of HI and noise through the instrument, the `prior`, made `stationary`, for one
    mock has few modes. Without it Q has its shape from theory and its level from the data
    (`expected_covariance`), as a method is not to know the simulations.
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

    def digest(self):
        """A hash of the mock."""
        return "" if self.prior is None else sha256(Path(self.prior).read_bytes()).hexdigest()

    def _separate(self, data):
        maps, freqs, modes = data.centred, data.freqs, data.modes
        nside = sphere.nside_of(maps)
        lmax = 3 * nside - 1
        peaks = self._peaks(lmax)
        windows = cosine_needlets(peaks, lmax)
        covariances = [band_covariance(modes.upto(_last(window)), window) for window in windows]
        priors = self._priors(maps, freqs, covariances, peaks, windows)
        filters = [foreground_filter(*pair) for pair in zip(covariances, priors, strict=True)]
        local = self._local(modes, windows, priors, filters, nside)
        found = [
            _through(window**2, modes.along(rows, lmax), nside)
            for window, (_, rows) in zip(progress(windows, self.name), filters, strict=True)
        ]
        _, rows = filters[-1]  # beyond the last l: what is in the maps less what is in their modes
        found[-1] += projection(rows, maps) - _through(np.ones(lmax + 1), modes.along(rows, lmax), nside)
        spectra = [spectra for spectra, _ in filters]
        if local is not None:
            spectra.append(np.eye(len(maps)))
            found.append(local)
        mixing, sources = ordered(np.hstack(spectra), np.concatenate(found))
        return Separation(mixing=mixing, sources=sources)

    def _peaks(self, lmax):
        """l of the peaks of the needlets, ascending; the last ends below 2 lmax."""
        peaks = [self.first_peak]
        while 2 * peaks[-1] < lmax:
            peaks.append(2 * peaks[-1])
        return peaks

    def _priors(self, maps, freqs, covariances, peaks, windows):
        """The covariance expected of HI and noise in each needlet."""
        if self.prior is not None:
            return mock_covariances(read_mock(self.prior, maps.shape), windows)
        pairs = zip(covariances, peaks, strict=True)
        return [expected_covariance(covariance, freqs, peak) for covariance, peak in pairs]

    def _local(self, modes, windows, priors, filters, nside):
        """What filters of regions take more, (n_channels, n_pix) float64; None if no needlet has regions."""
        alms = None
        for window, prior, whole in zip(windows, priors, filters, strict=True):
            n_modes = np.sum((2 * np.arange(len(window)) + 1) * window**2)
            n_channels = len(prior)
            if n_channels >= self.bias * n_modes:
                continue
            data = _through(window[: _last(window) + 1], modes.upto(_last(window)), nside)
            find = partial(foreground_filter, prior=prior)
            more = local_difference(data, find, whole, np.sqrt(n_channels / (self.bias * n_modes)))
            found = sphere.analyse(more, n_iter=sphere.N_ITER_FLAT)
            found *= window[sphere.alm_degree(len(window) - 1)].astype(np.float32)
            alms = found if alms is None else alms + found
        return None if alms is None else sphere.synthesise(alms, nside).astype(np.float64)


def _last(window):
    """The largest l that a window holds."""
    return int(np.flatnonzero(window).max())


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
