"""Linear filters with few spectra at every multipole, such as projections on spectra seen through beams."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from himap.maps import sphere
from himap.maps.low_rank import HarmonicModes, LowRankCube
from himap.removal import harmonic

RANK = 1e-10
"""Spectra below this share of the largest do not affect the last digit of float32."""

FINE = 1e-12
"""Share of the brightest spectrum at any l: far below a mode of HI."""


@dataclass(frozen=True, kw_only=True)
class SpectralFilter:
    """At every l the foreground is W_l G_l X_l of the data X_l.

    Attributes
    ----------
    spectra
        W_l, (n_l, n_channels, n_sources), zero columns where an l has fewer spectra.
    estimators
        G_l, (n_l, n_sources, n_channels).
    faint
        Covariance of HI and noise per mode used to make them, mK^2, (n_bands, n_channels, n_channels).
    first
        First l of each band, (n_bands,).
    """

    spectra: np.ndarray
    estimators: np.ndarray
    faint: np.ndarray
    first: np.ndarray

    @classmethod
    def wiener(cls, spectra, faint, edges):
        """Make the Wiener filter for sources of unit variance, G_l = (W_l^T C^-1 W_l + 1)^-1 W_l^T C^-1.

        For each band: `spectra` W_l, (n_l, n_channels, n_sources), `faint` C, `edges` the first and last l.
        """
        estimators = map(wiener_estimators, spectra, faint)
        return cls(
            spectra=np.concatenate(spectra),
            estimators=np.concatenate(list(estimators)),
            faint=np.array(faint),
            first=np.array(edges)[:, 0],
        )

    def faint_at(self, degree):
        """The covariance of HI and noise at one l, (n_channels, n_channels)."""
        return self.faint[np.searchsorted(self.first, degree, side="right") - 1]

    @property
    def uncertain(self):
        """For a Wiener filter, the covariance of the sources given the data, (W_l^T C^-1 W_l + 1)^-1."""
        bands = zip(np.split(self.spectra, self.first[1:]), self.faint, strict=True)
        return np.concatenate([np.linalg.inv(_weighted(*band)[1]) for band in bands])


def wiener_estimators(spectra, faint):
    """G_l of `SpectralFilter.wiener` in one band, (n_l, n_sources, n_channels)."""
    weighted, precision = _weighted(spectra, faint)
    return np.linalg.solve(precision, np.swapaxes(weighted, 1, 2))


def _weighted(spectra, faint):
    """C^-1 W_l, and W_l^T C^-1 W_l + 1, for one band."""
    weighted = np.linalg.inv(faint) @ spectra
    return weighted, np.swapaxes(spectra, 1, 2) @ weighted + np.eye(spectra.shape[2])


def filtered(spectra, estimators, project, modes, low=None):
    """W_l G_l X_l of maps at every l, a `LowRankCube`; beyond the last l, the filter of the last l is used.

    W_l is (n_l, n_channels, n), G_l is (n_l, n, n_channels). ``project(rows)`` is ``rows @ maps`` as in
    `Data.project`, for maps (n_channels, n_pix), mK, RING, less their channel means, and `modes` are their
    `CubeModes`. `low`, real modes (n, n_low), replaces the first G_l X_l if given.
    """
    sources, beyond = estimated(estimators, project, modes)
    if low is not None:
        sources[:, : low.shape[1]] = low
    foreground = on_sky(combined(sources, spectra, FINE), sphere.nside_of(beyond))
    return foreground + LowRankCube(spectra=spectra[-1], maps=beyond)


def estimated(estimators, project, modes):
    """G_l X_l of `filtered`, real modes (n, n_l^2), and maps (n, n_pix) of what the last G_l gives beyond."""
    last, size = estimators[-1], estimators.shape[1]
    sources = np.empty((2 * size, len(estimators) ** 2))
    for degree, out in enumerate(harmonic.blocks(sources)):
        out[:] = np.concatenate([estimators[degree], last]) @ modes.at(degree)
    sources, as_last = np.split(sources, 2)
    beyond = project(last)
    beyond -= harmonic.synthesise(as_last, sphere.nside_of(beyond))
    return sources, beyond


def through_beams(project, space, beams, modes):
    """The part of maps that the spectra `space` describe, seen through `beams`, a `LowRankCube`.

    At every l the foreground is W_l W_l^+ X_l with W_l = diag(beams_l) space: least squares without
    regularisation. Only the span of the columns of `space` (n_channels, n_sources) matters, and no factor of
    `beams`, b_l (n_channels, lmax + 1), common to all channels; `project` and `modes` are as in `filtered`.
    """
    n_degrees = min(modes.lmax + 1, beams.shape[1])
    space, _ = np.linalg.qr(space)
    bases = np.linalg.qr(beams.T[:n_degrees, :, None] * space)[0]
    return filtered(bases, np.swapaxes(bases, 1, 2), project, modes)


def combined(sources, spectra, least=RANK):
    """W_l S_l with as few spectra as it needs, a `HarmonicModes`, mK.

    S are real modes, (n, (lmax + 1)^2), W_l is (n_l, n_channels, n). Spectra below the share `least` of the
    brightest at any l are dropped.
    """
    pairs = list(zip(spectra, harmonic.blocks(sources), strict=True))
    seen = [matrix @ np.linalg.qr(block.T, mode="r").T for matrix, block in pairs]
    axes = linalg.orth(np.hstack(seen), rcond=least)
    out = np.empty((axes.shape[1], sources.shape[1]))
    for (matrix, block), into in zip(pairs, harmonic.blocks(out), strict=True):
        np.matmul(axes.T @ matrix, block, out=into)
    return HarmonicModes(spectra=axes, alms=harmonic.from_modes(out))


def seen_through(sources, mixing, beams):
    """Sources mixed and seen through beams, diag(beams_l) A S_l, in the form of `combined`.

    A is (n_channels, n_sources), b_l (n_channels, lmax + 1).
    """
    return combined(sources, beams.T[:, :, None] * mixing)


def on_sky(modes, nside, lmax=None):
    """The `LowRankCube` of a `HarmonicModes`, up to `lmax` or the largest l."""
    alms = modes.alms if lmax is None else sphere.alms_upto(modes.alms, lmax)
    return LowRankCube(spectra=modes.spectra, maps=sphere.synthesise(alms, nside))
