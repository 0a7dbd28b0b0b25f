"""Templates at finer resolution: harmonic upgrade and statistical small scales (paper, Sects. 2.1.2-2.1.3).

All steps use the logarithm of the temperature, so the result is positive by construction. A map nearly
preserves its pixels: averaged to its original resolution it is unchanged, except for faint pixels, which
are raised (`refine`).
"""

from dataclasses import replace

import numpy as np

from himap.maps import sphere

SLOPE = -2.703
"""Slope of the angular spectrum of 408 MHz small scales (Remazeilles et al. 2015)."""
EXPONENT = 0.782
"""Small-scale rms grows as the intensity to this power (Remazeilles et al. 2015)."""

_FAINT = 0.1  # of the mean of the surroundings: the faintest pixels that an upgrade resolves
_RINGING = 2.0  # in log I: largest difference of an upgraded pixel from its original pixel
_AROUND = 4  # the surroundings are pixels of nside / 4
_N_CORRECTIONS = 12  # enough to preserve pixels of free-free to 2 % (median) and of 408 MHz to 0.2 %


def refine_template(template, nside, rng, *, small_scales=True):
    """A `PowerLaw` at another nside, with its amplitude from `refine`.

    An index map is averaged over pixels to lower nside, and interpolated in harmonic space to higher nside,
    within its limits.
    """
    index = template.index
    if np.ndim(index) and nside <= sphere.nside_of(index):
        index = sphere.change_resolution(index, nside)
    elif np.ndim(index):
        index = np.clip(sphere.synthesise(sphere.analyse(index), nside), index.min(), index.max())
    amplitude = refine(template.amplitude, nside, rng, small_scales=small_scales)
    return replace(template, amplitude=amplitude, index=index)


def refine(amplitude, nside, rng, *, small_scales=True):
    """An intensity map at another nside.

    To lower nside: pixel means. To higher nside: the logarithm is upgraded in harmonic space up to l = 2
    nside of the template, `small_scales` adds structure beyond (see `add_structure`), and a few smooth
    corrections restore the means over the template's pixels. Pixels below a tenth of the mean of their
    surroundings, which are noise of the template, are raised to that value before an upgrade.

    Parameters
    ----------
    amplitude
        Positive intensities in any unit, RING, shape (n_pix,).
    nside
        Resolution of the result.
    rng
        numpy Generator, used only for small scales.
    small_scales
        Whether an upgrade adds structure that the template cannot resolve.

    Returns
    -------
    refined
        Shape (12 nside^2,), float64.
    """
    amplitude = np.asarray(amplitude, dtype=np.float64)
    template_nside = sphere.nside_of(amplitude)
    if nside <= template_nside:
        return sphere.change_resolution(amplitude, nside)
    target = raise_faint(amplitude)
    log_fine = sphere.synthesise(sphere.analyse(np.log(target), 2 * template_nside), nside)
    copies = sphere.change_resolution(np.log(target), nside)
    log_fine = np.clip(log_fine, copies - _RINGING, copies + _RINGING)
    if small_scales:
        log_fine += add_structure(target, nside, rng)
    beam = sphere.gaussian_beam(np.sqrt(4 * np.pi / len(target)), 3 * nside - 1)  # one coarse pixel wide
    for _ in range(_N_CORRECTIONS):
        deviation = np.log(target / sphere.change_resolution(np.exp(log_fine), template_nside))
        steps = sphere.change_resolution(np.clip(deviation, -1, 1), nside)
        alm = sphere.analyse(steps, n_iter=0)
        log_fine = log_fine + sphere.synthesise(sphere.multiply_beam(alm, beam), nside)
    return np.exp(log_fine)


def raise_faint(amplitude):
    """The map with pixels below a tenth of the mean of their surroundings raised to that value."""
    return np.maximum(amplitude, _FAINT * _surroundings(amplitude))


def _surroundings(amplitude):
    """Mean over the pixel of nside / 4 that each pixel belongs to, (n_pix,)."""
    nside = sphere.nside_of(amplitude)
    return sphere.change_resolution(sphere.change_resolution(amplitude, max(nside // _AROUND, 1)), nside)


def add_structure(amplitude, nside, rng):
    """Log of a factor of mean 1 with structure that `amplitude` cannot resolve, (12 nside^2,).

    exp(w g - w^2 var(g) / 2), with g a Gaussian field of C_l = A l^SLOPE that begins where the template ends,
    at l = 2 nside_template, and w = (I / I_0)^(EXPONENT - 1) of unit rms, from I averaged over a few
    pixels: the rms grows as I^EXPONENT (Miville-Deschenes et al. 2007; Remazeilles et al. 2015).

    A is fitted to the spectrum of log I between l = nside_template / 2 and nside_template. The spectrum
    of I itself is dominated by a few bright sources in the plane: continued over the sky it would add about
    30 % at high latitudes, where Remazeilles et al. (0.0599 I^0.782, I in K) add 3.5 %.
    """
    template_nside = sphere.nside_of(amplitude)
    degree = np.arange(3 * nside)
    power = np.maximum(degree, 1.0) ** SLOPE
    fit = slice(max(template_nside // 2, 2), template_nside + 1)
    log_cl = sphere.power_spectrum(sphere.analyse(np.log(amplitude), 2 * template_nside))
    weight = (2 * degree[fit] + 1) * (log_cl[fit] > 0)
    if not weight.any():  # a map without structure has none to continue
        return np.zeros(12 * nside**2)
    level = np.exp(np.average(np.log(log_cl[fit] / power[fit]), weights=weight))
    onset = (degree / (2 * template_nside)) ** 8
    cl = level * power * onset / (1 + onset)
    surroundings = _surroundings(amplitude)
    width = surroundings ** (EXPONENT - 1)
    width = sphere.change_resolution(width / np.sqrt(np.mean(width**2)), nside)
    field = sphere.synthesise(sphere.gaussian_alm(cl, rng), nside)
    variance = np.sum((2 * degree + 1) * cl) / (4 * np.pi)
    return width * field - 0.5 * width**2 * variance
