"""Background, growth, linear power spectrum, and abundance of HI (paper, Sect. 2.1.1).

Distances are comoving, in Mpc/h; wavenumbers in h/Mpc; temperatures in mK.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from astropy import constants as const
from astropy import units as u
from scipy.integrate import cumulative_simpson, quad
from scipy.interpolate import CubicSpline

from himap.core.checks import checked_fields, parameter
from himap.core.errors import InputError
from himap.core.survey import FREQ_21CM

_EINSTEIN_A10 = 2.86888e-15 / u.s  # Gould 1994, ApJ 423, 522
_HUBBLE_DISTANCE = const.c.to_value(u.km / u.s) / 100  # c / H0 in Mpc/h
Z_MAX = 5.0
"""Largest redshift in the tables of a `Cosmology`."""


def redshift(freqs):
    """Redshift at which the 21 cm line is observed at `freqs` (MHz)."""
    return FREQ_21CM / np.asarray(freqs, dtype=float) - 1


@dataclass(frozen=True, kw_only=True)
class Cosmology:
    """A flat LCDM cosmology; the defaults are the paper's.

    The growth factor is normalised to 1 today. Radiation and neutrino masses are neglected,
    as in the simulations of the paper.
    """

    omega_m: float = parameter(0.3, "density of matter, today")
    omega_b: float = parameter(0.049, "density of baryons, today")
    h: float = parameter(0.67, "H0 / (100 km/s/Mpc)", minimum=0, above=True)
    n_s: float = parameter(0.96, "spectral index of the primordial power")
    sigma_8: float = parameter(0.8, "rms of the density in spheres of 8 Mpc/h", minimum=0, above=True)

    def __post_init__(self):
        checked_fields(self)
        if not 0 < self.omega_b < self.omega_m < 1:
            raise InputError(
                "a flat LCDM cosmology needs 0 < omega_b < omega_m < 1, "
                f"got omega_b = {self.omega_b} and omega_m = {self.omega_m}."
            )

    def expansion(self, z):
        """E(z) = H(z) / H0."""
        return np.sqrt(self.omega_m * (1 + np.asarray(z, dtype=float)) ** 3 + 1 - self.omega_m)

    @cached_property
    def _distance_spline(self):
        z = np.linspace(0, Z_MAX, 5001)
        return CubicSpline(z, _HUBBLE_DISTANCE * cumulative_simpson(1 / self.expansion(z), x=z, initial=0))

    def comoving_distance(self, z):
        """Comoving distance in Mpc/h to redshift `z` (0 to 5; beyond, InputError)."""
        return self._distance_spline(_inside("redshift", z, Z_MAX))

    def redshift_at(self, distance):
        """Redshift at a comoving distance in Mpc/h, the inverse of `comoving_distance`."""
        z = np.linspace(0, Z_MAX, 5001)
        distances = self._distance_spline(z)
        return CubicSpline(distances, z)(_inside("distance", distance, distances[-1]))

    @cached_property
    def _growth_spline(self):
        # D(a) is proportional to E(a) int_0^a da' / (a' E(a'))^3  (Heath 1977).
        def integrand(a):
            return (a / (self.omega_m + (1 - self.omega_m) * a**3)) ** 1.5

        z = np.linspace(0, Z_MAX, 501)
        integral = np.array([quad(integrand, 0, 1 / (1 + zi))[0] for zi in z])
        growth = self.expansion(z) * integral
        return CubicSpline(z, growth / growth[0])

    def growth(self, z):
        """Linear growth factor D(z), 1 today."""
        return self._growth_spline(z)

    def growth_rate(self, z):
        """Growth rate f = dln D / dln a."""
        return -(1 + np.asarray(z)) * self._growth_spline(z, 1) / self._growth_spline(z)

    def linear_power(self, k):
        """Linear matter power spectrum today, (Mpc/h)^3, at `k` in h/Mpc; zero at k = 0.

        From CAMB, scaled to sigma_8. Beyond the tabulated range (1e-4 to 50 h/Mpc) both ends are
        continued as power laws.
        """
        k = np.asarray(k, dtype=float)
        log_k, log_p = _camb_table(self)
        slope_low = (log_p[1] - log_p[0]) / (log_k[1] - log_k[0])
        slope_high = (log_p[-1] - log_p[-2]) / (log_k[-1] - log_k[-2])
        x = np.log(np.where(k > 0, k, 1.0))
        inside = CubicSpline(log_k, log_p)(np.clip(x, log_k[0], log_k[-1]))
        beyond = slope_low * np.minimum(x - log_k[0], 0) + slope_high * np.maximum(x - log_k[-1], 0)
        return np.where(k > 0, np.exp(inside + beyond), 0.0)


def _inside(label, values, top):
    """Return `values` if they are between 0 and `top`, where the splines are defined; else InputError."""
    values = np.asarray(values, dtype=float)
    if values.size and not (values.min() >= 0 and values.max() <= top):
        raise InputError(
            f"{label} must be between 0 and {top:g} (redshift {Z_MAX:g}), got {values.min():g} to "
            f"{values.max():g}."
        )
    return values


@lru_cache(maxsize=8)
def _camb_table(cosmology):
    """log k and log P(k) from CAMB at z = 0, with the amplitude set by sigma_8."""
    import camb  # slow to import, and only this function needs it

    h2 = cosmology.h**2
    params = camb.set_params(
        H0=100 * cosmology.h,
        ombh2=cosmology.omega_b * h2,
        omch2=(cosmology.omega_m - cosmology.omega_b) * h2,
        mnu=0,
        As=2e-9,
        ns=cosmology.n_s,
    )
    params.set_matter_power(redshifts=[0.0], kmax=50 * cosmology.h)
    results = camb.get_results(params)
    k, _, power = results.get_matter_power_spectrum(minkh=1e-4, maxkh=50, npoints=600)
    return np.log(k), np.log(power[0] * (cosmology.sigma_8 / results.get_sigma8_0()) ** 2)


@dataclass(frozen=True, kw_only=True)
class HIModel:
    """Abundance, bias and brightness of HI after reionization (paper, Sect. 2.1.1)."""

    cosmology: Cosmology = Cosmology()

    def bias(self, z):
        """Linear HI bias, b = 0.3 (1 + z) + 0.6 (Martin et al. 2012; Carucci et al. 2020)."""
        return 0.3 * (1 + np.asarray(z)) + 0.6

    def omega(self, z):
        """HI density over today's critical density, 4e-4 (1 + z)^0.6 (Crighton et al. 2015)."""
        return 4e-4 * (1 + np.asarray(z)) ** 0.6

    def mean_temperature(self, z):
        """Mean brightness temperature of the 21 cm line, mK.

        T = 3 h_P c^3 A_10 / (32 pi k_B m_H nu_21^2) (1 + z)^2 / H(z) rho_HI(z)
        with rho_HI the comoving HI density (e.g. Furlanetto et al. 2006, for T_spin >> T_CMB).
        """
        hubble_0 = 100 * self.cosmology.h * u.km / u.s / u.Mpc
        critical = 3 * hubble_0**2 / (8 * np.pi * const.G)
        line = 3 * const.h * const.c**3 * _EINSTEIN_A10 / (32 * np.pi * const.k_B)
        hydrogen = const.m_p + const.m_e
        today = (line / (hydrogen * (FREQ_21CM * u.MHz) ** 2) * critical / hubble_0).to_value(u.mK)
        z = np.asarray(z, dtype=float)
        return today * self.omega(z) * (1 + z) ** 2 / self.cosmology.expansion(z)
