"""Thermal noise: Gaussian, white, uniform over the sky (paper, Sect. 2.2.2)."""

import numpy as np
from astropy import units as u

from himap.instrument.beams.base import diffraction_fwhm


def system_temperature(freqs, t_instr):
    """T_sys = T_instr + 66 (300 MHz / nu)^2.55, K (Eq. 12); `freqs` in MHz."""
    return t_instr + 66 * (300 / np.asarray(freqs, dtype=float)) ** 2.55


def noise_sigma(survey):
    """Noise per pixel and channel, mK, (n_channels,) (paper, Eq. 11).

    sigma = T_sys sqrt(4 pi f_sky / (dnu t_obs N_dishes Omega_beam)), Omega_beam = 1.133 FWHM^2 with FWHM =
    lambda / D. As in the paper this is the noise of a *pixel*, independent of nside, so the noise power
    sigma^2 Omega_pixel is larger for coarser maps. The paper calls sigma a standard deviation in one place
    and the variance of a pixel in another: with ``noise_reading="variance"`` of the survey, its value in mK
    is read as a variance in mK^2, and the noise is the root of that.
    """
    beam_area = 1.133 * diffraction_fwhm(survey.freqs, survey.dish_diameter) ** 2
    samples = (survey.channel_width * u.MHz * survey.t_obs * u.h).to_value(u.one)
    area_per_sample = 4 * np.pi * survey.f_sky / (samples * survey.n_dishes * beam_area)
    sigma = 1e3 * system_temperature(survey.freqs, survey.t_instr) * np.sqrt(area_per_sample)
    return np.sqrt(sigma) if survey.noise_reading == "variance" else sigma


def noise_maps(survey, rng):
    """White noise of every channel, mK, (n_channels, n_pix) float32."""
    maps = rng.standard_normal((survey.n_channels, survey.n_pix), dtype=np.float32)
    maps *= noise_sigma(survey)[:, None].astype(np.float32)
    return maps
