"""Harmonic analysis of a cube, done once for all later uses."""

import math
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from himap.core.progress import progress
from himap.maps import sphere
from himap.maps.inpaint import inpaint_alm
from himap.maps.low_rank import projection, scattered
from himap.removal import harmonic
from himap.removal.covariance import channel_covariance

_BRIGHT = 9.0  # times the variance of the faint axes: foreground, not HI and noise alone
_FAINT = 0.25  # quantile of the variances, HI and noise unless three quarters of the axes hold more
_CLOSE = 0.3  # of the level of HI and noise: precision of the maps of bright axes
_DIGITS = 1e-6  # of a map: the precision of float32
_NEGLIGIBLE = 1e-10  # of the level of HI and noise, averaged over all modes: faint at any l
_FINE = 64  # nside from which plain quadrature is exact to 0.2 % of a coefficient; at 16, to 1 %


@dataclass(frozen=True, kw_only=True)
class SplitModes:
    """Real modes (`himap.removal.harmonic`) of all channels, mK, ``spectra @ bright + rest``.

    They support two products, ``rows @ modes`` and ``modes @ columns``, in float64 without forming the sum;
    `numpy.array` makes the sum, (n_channels, n_modes) float64.

    Attributes
    ----------
    spectra
        Spectra of axes brighter than HI and noise, orthonormal, (n_channels, n_bright).
    bright
        The modes of their maps, (n_bright, n_modes) float64.
    rest
        The modes of everything else, (n_channels, n_modes) float32.
    """

    __array_ufunc__ = None  # so that numpy delegates products to this class

    spectra: np.ndarray
    bright: np.ndarray
    rest: np.ndarray

    def __rmatmul__(self, rows):
        return (rows @ self.spectra) @ self.bright + rows @ self.rest.astype(np.float64)

    def __matmul__(self, columns):
        # Imported here: most methods need no numba, which takes a second.
        from himap.removal.compiled import add_products

        product = self.spectra @ (self.bright @ columns)
        rest = np.ascontiguousarray(self.rest)
        add_products(rest, np.ascontiguousarray(columns.T, dtype=np.float64), product)
        return product

    def __array__(self, dtype=None, copy=None):
        if copy is False:
            raise ValueError("modes are a sum that is made when it is asked for: a copy")
        return np.asarray(self.spectra @ self.bright + self.rest, dtype=dtype)


class CubeModes(SplitModes):
    """The `SplitModes` of all l, to 3 nside - 1, (n_channels, 9 nside^2)."""

    @property
    def lmax(self):
        """Largest multipole, 3 nside - 1."""
        return math.isqrt(self.rest.shape[1]) - 1

    def without_peaks(self, maps, smooth):
        """The same for maps `smooth` (n_channels, n_pix) that differ from `maps`, analysed here, in peaks.

        Only peaks are analysed, with the precision of `rest`. At l = 0 nothing changes: means are subtracted.
        """
        rest = self.rest.copy()
        for with_peaks, without, out in zip(progress(maps, "peaks"), smooth, rest, strict=True):
            peaks = (with_peaks - without).astype(np.float32)
            if peaks.any():
                alm = sphere.analyse(peaks, self.lmax, n_iter=_n_iter(sphere.nside_of(peaks)))
                out[1:] -= harmonic.to_modes(alm)[1:]
        return replace(self, rest=rest)

    def upto(self, lmax, channels=slice(None)):
        """The modes of all channels, or some, to `lmax`, (n_channels, (lmax + 1)^2) float64."""
        block = slice((lmax + 1) ** 2)
        modes = self.spectra[channels] @ self.bright[:, block]
        modes += self.rest[channels, block]
        return modes

    def at(self, degree):
        """The `SplitModes` of one l, as views."""
        block = slice(degree**2, (degree + 1) ** 2)
        return SplitModes(spectra=self.spectra, bright=self.bright[:, block], rest=self.rest[:, block])

    def by_degree(self, lmax):
        """Copies of the modes of every l to `lmax`, a list, for products that are computed repeatedly."""
        views = map(self.at, range(lmax + 1))
        return [
            replace(one, bright=one.bright.copy(order="C"), rest=one.rest.copy(order="C")) for one in views
        ]

    def low_cube(self, lmax, channels=slice(None)):
        """The maps of all channels, or of some, up to `lmax`, (n_channels, n_pix) float32."""
        nside, modes = (self.lmax + 1) // 3, self.upto(lmax, channels)
        alms = (harmonic.from_modes(channel) for channel in modes)
        return sphere.synthesise_cube(alms, nside, n_channels=len(modes), label=f"maps to l = {lmax}")

    def along(self, rows, lmax):
        """Modes of ``rows @ maps`` to `lmax`, (n_rows, (lmax + 1)^2) float64."""
        n_modes = (lmax + 1) ** 2
        modes = (rows @ self.spectra) @ self.bright[:, :n_modes]
        modes += rows.astype(np.float32) @ self.rest[:, :n_modes]
        return modes


def cube_modes(maps, kept=None, covariance=None):
    """The `CubeModes` of HEALPix maps, (n_channels, n_pix), to l = 3 nside - 1.

    With a mask `kept` (n_pix,) bool, maps are (n_channels, n_kept), of its pixels only: bright emission is
    continued outside (`himap.maps.inpaint`), the rest is zero there. The covariance is the
    `channel_covariance` of the maps, if it is known.

    Foregrounds are a few spectra times maps; these are analysed to an error below HI and noise. For all else
    plain quadrature in float32 is enough up to l = 2 nside: refinements would change the cleaned maps by
    1e-5. Products run on one thread: the number of threads changes their last bits, and so SDecGMCA.
    """
    nside = sphere.nside_of(maps if kept is None else kept)
    lmax, n_iter = 3 * nside - 1, _n_iter(nside)
    with threadpool_limits(1, user_api="blas"):
        values, axes = np.linalg.eigh(channel_covariance(maps) if covariance is None else covariance)
        faint = _faint(values)
        spectra, values = axes[:, values > _BRIGHT * faint], values[values > _BRIGHT * faint]
        lines = projection(spectra.T, maps)
        bright = _bright_modes(lines, values, faint, kept)
        rest = np.empty((len(maps), (lmax + 1) ** 2), dtype=np.float32)
        for channel, spectrum, out in zip(progress(maps, "analysis"), spectra, rest, strict=True):
            pixels = (channel - spectrum @ lines).astype(np.float32)
            pixels = pixels if kept is None else scattered(pixels, kept)
            out[:] = harmonic.to_modes(sphere.analyse(pixels, lmax, n_iter=n_iter))
    return CubeModes(spectra=spectra, bright=bright, rest=rest)


def modes_of_sum(foreground, alms, covariance):
    """The `CubeModes` of a foreground plus HI and noise with known coefficients.

    The foreground is analysed as in `cube_modes`, with the same errors.

    Parameters
    ----------
    foreground
        A `LowRankCube` of the full sphere; its channel means are subtracted.
    alms
        Coefficients of HI and noise less channel means, (n_channels, n_alm), to 3 nside - 1.
    covariance
        The `channel_covariance` of maps with as much HI and noise.
    """
    faint = _faint(np.linalg.eigvalsh(covariance))
    terms = foreground.truncate(_NEGLIGIBLE * faint)
    values = np.mean(terms.maps**2, axis=1)
    bright = _bright_modes(terms.maps, values, faint)
    rest = np.empty((len(alms), bright.shape[1]), dtype=np.float32)
    for alm, out in zip(alms, rest, strict=True):
        out[:] = harmonic.to_modes(alm)
    return CubeModes(spectra=terms.spectra, bright=bright, rest=rest)


def _faint(values):
    """The level of HI and noise among variances, eigenvalues in ascending order."""
    return max(np.quantile(values, _FAINT), _DIGITS**2 * values[-1])


def _bright_modes(lines, values, faint, kept=None):
    """Real modes of maps with variances `values`, float64, with an error below HI and noise."""
    n_pix = lines.shape[1] if kept is None else len(kept)
    nside, out = sphere.nside_of(np.empty(n_pix, dtype=bool)), np.empty((len(lines), 3 * n_pix // 4))
    tolerances = np.maximum(_CLOSE * np.sqrt(faint / values), _DIGITS)  # relative to a map
    is_bright = values > _BRIGHT * faint
    rows = zip(progress(lines, "bright maps"), tolerances, is_bright, out, strict=True)
    for line, tolerance, bright, modes in rows:
        if not bright:
            alm = sphere.analyse(line, n_iter=_n_iter(nside))
        elif kept is None:
            alm = sphere.analyse_closely(line, 3 * nside - 1, tolerance)
        else:
            alm = inpaint_alm(scattered(line, kept), kept, tolerance)
        modes[:] = harmonic.to_modes(alm)
    return out


def _n_iter(nside):
    """Number of refinements of the quadrature for maps as faint as HI and noise."""
    return 0 if nside >= _FINE else sphere.N_ITER_FLAT


def inpainted_maps(lines, kept, modes):
    """Maps (n_channels, n_pix) of the full sphere: lines of sight where kept, bright emission elsewhere.

    `lines` are (n_channels, n_kept), mK, and `modes` their `cube_modes` with `kept` (n_pix,) bool.
    """
    maps = scattered(lines, kept)
    bright = harmonic.synthesise(modes.bright, sphere.nside_of(kept))[:, ~kept]
    for spectrum, out in zip(modes.spectra, maps, strict=True):
        out[~kept] = spectrum @ bright
    return maps
