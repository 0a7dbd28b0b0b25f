"""Harmonic analysis of a cube, once for all that is asked of it."""

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
_FAINT = 0.25  # quantile of the variances, HI and noise unless three quarters of the channels hold more
_CLOSE = 0.3  # of the level of HI and noise: how well the maps of what is bright are reproduced
_DIGITS = 1e-6  # of a map: beyond, float32 has none
_FINE = 64  # nside from which plain quadrature is good to 0.2 % of a coefficient; at 16 it is to 1 %


@dataclass(frozen=True, kw_only=True)
class SplitModes:
    """Real modes (`himap.removal.harmonic`) of all channels, mK, ``spectra @ bright + rest``.

    They know two products, ``rows @ modes`` and ``modes @ columns``, in float64 without the sum in memory;
    `numpy.array` makes the sum, (n_channels, n_modes) float64.

    Attributes
    ----------
    spectra
        Those of what is brighter than HI and noise, orthonormal, (n_channels, n_bright).
    bright
        The modes of their maps, (n_bright, n_modes) float64.
    rest
        Those of all else, (n_channels, n_modes) float32.
    """

    __array_ufunc__ = None  # so that numpy leaves products to this class

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

    def upto(self, lmax, channels=slice(None)):
        """The modes of all channels, or some, to `lmax`, (n_channels, (lmax + 1)^2) float64."""
        block = slice((lmax + 1) ** 2)
        modes = self.spectra[channels] @ self.bright[:, block]
        modes += self.rest[channels, block]
        return modes

    def at(self, degree):
        """The `SplitModes` of one l, views."""
        block = slice(degree**2, (degree + 1) ** 2)
        return SplitModes(spectra=self.spectra, bright=self.bright[:, block], rest=self.rest[:, block])

    def by_degree(self, lmax):
        """Copies of those of every l to `lmax`, a list, for products that are made again and again."""
        views = map(self.at, range(lmax + 1))
        return [
            replace(one, bright=one.bright.copy(order="C"), rest=one.rest.copy(order="C")) for one in views
        ]

    def low_cube(self, lmax, channels=slice(None)):
        """The maps of all channels, or some, up to `lmax`, (n_channels, n_pix) float32."""
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

    With a mask `kept` (n_pix,) bool, of the maps of the pixels that it keeps, (n_channels, n_kept): what is
    bright is continued outside (`himap.maps.inpaint`), the rest is zero there. The covariance is the
    `channel_covariance` of the maps, where it is at hand.

    Foregrounds are a few spectra times maps; these are analysed until less than HI and noise remains. For
    all else plain quadrature in float32 does, up to l = 2 nside: refinements would change the cleaned maps by
    1e-5. Products run on one thread: the number of threads changes their last bits, and SDecGMCA with them.
    """
    nside = sphere.nside_of(maps if kept is None else kept)
    lmax, n_iter = 3 * nside - 1, 0 if nside >= _FINE else sphere.N_ITER_FLAT
    with threadpool_limits(1, user_api="blas"):
        values, axes = np.linalg.eigh(channel_covariance(maps) if covariance is None else covariance)
        faint = max(np.quantile(values, _FAINT), _DIGITS**2 * values[-1])
        spectra, values = axes[:, values > _BRIGHT * faint], values[values > _BRIGHT * faint]
        tolerances = np.maximum(_CLOSE * np.sqrt(faint / values), _DIGITS)  # of noise alone
        lines = projection(spectra.T, maps)
        bright = np.empty((len(lines), (lmax + 1) ** 2))
        for line, tolerance, out in zip(progress(lines, "bright maps"), tolerances, bright, strict=True):
            if kept is None:
                alm = sphere.analyse_closely(line, lmax, tolerance)
            else:
                alm = inpaint_alm(scattered(line, kept), kept, tolerance)
            out[:] = harmonic.to_modes(alm)
        rest = np.empty((len(maps), (lmax + 1) ** 2), dtype=np.float32)
        for channel, spectrum, out in zip(progress(maps, "analysis"), spectra, rest, strict=True):
            pixels = (channel - spectrum @ lines).astype(np.float32)
            pixels = pixels if kept is None else scattered(pixels, kept)
            out[:] = harmonic.to_modes(sphere.analyse(pixels, lmax, n_iter=n_iter))
    return CubeModes(spectra=spectra, bright=bright, rest=rest)


def inpainted_maps(lines, kept, modes):
    """Maps (n_channels, n_pix) of the full sphere: lines of sight where kept, what is bright elsewhere.

    Of `lines` (n_channels, n_kept), mK, and their `modes`, the `cube_modes` with `kept` (n_pix,) bool.
    """
    maps = scattered(lines, kept)
    bright = harmonic.synthesise(modes.bright, sphere.nside_of(kept))[:, ~kept]
    for spectrum, out in zip(modes.spectra, maps, strict=True):
        out[~kept] = spectrum @ bright
    return maps
