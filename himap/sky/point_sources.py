"""Extragalactic radio sources (paper, Sect. 2.1.4).

Faint sources are a field with a mean, clustering and Poisson fluctuations; sources between
`FLUX_FAINT` and `FLUX_REMOVED` are injected one by one; brighter ones count as removed. Counts are
those of Battye et al. (2013) at 1.4 GHz, used as in Olivari et al. (2016). No flux is counted twice:
the field's mean and clustering are those of the faint sources only.
"""

import numpy as np
from astropy import constants as const
from astropy import units as u
from scipy.integrate import cumulative_trapezoid, quad

from himap.maps import sphere
from himap.sky.emission import PowerLaw

FREQ_COUNTS = 1400.0
"""Frequency of the source counts, MHz."""
FLUX_FAINT = 0.01
"""Sources above this flux, Jy, are injected one by one."""
FLUX_REMOVED = 1.0
"""Sources above this flux, Jy, count as identified and removed."""

_FLUX_MIN = 1e-6  # Jy; fainter sources add nothing (Battye et al. 2013)
_COUNTS = (2.593, 9.333e-2, -4.839e-4, 2.488e-1, 8.995e-2, 8.506e-3)
_INDEX_MEAN, _INDEX_STD = -2.7, 0.2  # Bigot-Sazy et al. 2015


def source_counts(flux):
    """Differential counts dN/dS at 1.4 GHz, per Jy and sr, at `flux` in Jy.

    dN/dS = S^-2.5 10^(sum_i a_i log10(S)^i) (Battye et al. 2013).
    """
    flux = np.asarray(flux, dtype=float)
    return flux**-2.5 * 10 ** np.polynomial.polynomial.polyval(np.log10(flux), _COUNTS)


def _moment(power, flux_min, flux_max):
    """Integral of S^power dN/dS, Jy^power per sr."""

    def integrand(log_flux):
        flux = np.exp(log_flux)
        return flux ** (power + 1) * source_counts(flux)

    return quad(integrand, np.log(flux_min), np.log(flux_max), epsrel=1e-10, limit=200)[0]


def flux_to_temperature():
    """lambda^2 / (2 k_B): mK per (Jy / sr) at 1.4 GHz."""
    wavelength = const.c / (FREQ_COUNTS * u.MHz)
    return (wavelength**2 / (2 * const.k_B) * u.Jy).to_value(u.mK)


def mean_temperature(flux_max):
    """Mean brightness temperature at 1.4 GHz of sources below `flux_max` Jy, mK."""
    return flux_to_temperature() * _moment(1, _FLUX_MIN, flux_max)


def number_density(flux_min, flux_max):
    """Number of sources per sr with fluxes between two limits in Jy."""
    return _moment(0, flux_min, flux_max)


def poisson_spectrum(flux_max):
    """Poisson C_l at 1.4 GHz of the sources below `flux_max` Jy, mK^2, the same at every l."""
    return flux_to_temperature() ** 2 * _moment(2, _FLUX_MIN, flux_max)


def clustering_spectrum(lmax, temperature):
    """Clustering C_l = 1.8e-4 l^-1.2 T^2, mK^2, for sources of mean `temperature` in mK; 0 at l = 0."""
    degree = np.arange(1, lmax + 1)
    return np.concatenate([[0.0], 1.8e-4 * degree**-1.2 * temperature**2])


def point_sources(nside, rng):
    """The extragalactic sources as a `PowerLaw` with a spectral index that varies between pixels.

    Parameters
    ----------
    nside
        Resolution of the maps.
    rng
        numpy Generator; faint field, injected sources and index each have a child stream.

    Returns
    -------
    PowerLaw
        Amplitude at 1.4 GHz in mK, positive; index drawn from N(-2.7, 0.2).
    """
    faint, bright, index = rng.spawn(3)
    n_pix = 12 * nside**2
    return PowerLaw(
        name="point sources",
        amplitude=_faint_field(nside, faint) + _injected(n_pix, bright),
        freq_ref=FREQ_COUNTS,
        index=index.normal(_INDEX_MEAN, _INDEX_STD, n_pix),
    )


def _faint_field(nside, rng):
    """Mean plus Gaussian clustering and Poisson fluctuations, mK; clipped at zero.

    The rms grows with nside, from 3 mK at 32 to 10 at 256 and 16 at 512, around a mean of 84 mK: at nside 512
    single pixels are clipped at zero, on finer maps more.
    """
    lmax = 3 * nside - 1
    mean = mean_temperature(FLUX_FAINT)
    cl = clustering_spectrum(lmax, mean)
    cl[1:] += poisson_spectrum(FLUX_FAINT)
    return np.maximum(mean + sphere.synthesise(sphere.gaussian_alm(cl, rng), nside), 0.0)


def _injected(n_pix, rng):
    """Sources of `FLUX_FAINT` to `FLUX_REMOVED` at random positions, mK; those in one pixel add up."""
    n_sources = rng.poisson(4 * np.pi * number_density(FLUX_FAINT, FLUX_REMOVED))
    pixels = rng.integers(n_pix, size=n_sources)  # all pixels have equal area
    # Fluxes in Jy are drawn from the counts by inverting their cumulative distribution.
    log_flux = np.linspace(np.log(FLUX_FAINT), np.log(FLUX_REMOVED), 20_001)
    density = np.exp(log_flux) * source_counts(np.exp(log_flux))
    cumulative = cumulative_trapezoid(density, initial=0)
    fluxes = np.exp(np.interp(rng.random(n_sources) * cumulative[-1], cumulative, log_flux))
    total = np.bincount(pixels, weights=fluxes, minlength=n_pix)
    return total * flux_to_temperature() / (4 * np.pi / n_pix)
