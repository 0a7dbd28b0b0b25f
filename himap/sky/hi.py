"""The cosmological signal: HI brightness temperature on the light cone (paper, Sect. 2.1.1).

A lognormal field (Coles & Jones 1991) as in CRIME (Alonso et al. 2014): the Gaussian linear field of
one periodic box, grown and biased at the distance of every cell, exponentiated, moved to redshift
space by the linear velocity of the same box, and averaged over channels and pixels.
"""

import numpy as np
from numba import njit, prange

from himap.core.errors import InputError
from himap.sky import box, light_cone
from himap.sky.cosmology import Z_MAX, HIModel, redshift

_MODEL = HIModel()


def hi_maps(survey, rng, *, model=_MODEL, rsd=True, oversample=1.8):
    """HI brightness temperature of every channel, mK.

    Parameters
    ----------
    survey
        A `Survey`; its box must contain the band.
    rng
        numpy Generator.
    model
        `HIModel`: cosmology, bias, abundance.
    rsd
        Whether to move matter to redshift space.
    oversample
        Rays per cell of the box, across; steps along a ray are half as long. At 1.8, the most with which
        16 rays a pixel reach 900 MHz in all presets, 4 changes the power up to l = 2 nside by about 1 %
        (tests/test_hi.py holds it to 1.5 %).

    Returns
    -------
    maps
        (n_channels, n_pix) float32, mK, RING: T = Tbar(z) (1 + delta_s), never negative.

    Raises
    ------
    InputError
        The band reaches beyond the box.
    """
    cosmology = model.cosmology
    edges = cosmology.comoving_distance(redshift(survey.freq_edges))[::-1]
    if edges[-1] > survey.box_size / 2:
        raise InputError(
            f"the HI box is too small: {survey.freq_min} MHz is {edges[-1]:.0f} Mpc/h away, the box of "
            f"{survey.box_size:.0f} Mpc/h reaches {survey.box_size / 2:.0f}. Set box_size to at least "
            f"{2 * edges[-1]:.0f} or raise freq_min."
        )
    density, displacement = lognormal_box(survey.box_cells, survey.box_size, rng, model=model, rsd=rsd)
    cell = survey.box_size / survey.box_cells
    rays = light_cone.plan_rays(survey.nside, cell, edges[0], edges[-1], oversample=oversample)
    maps = light_cone.trace(density, displacement, edges, survey.nside, survey.box_size, rays)[::-1]
    maps *= _channel_temperature(survey.freq_edges, model)[:, None]
    return maps


def lognormal_box(n_cells, box_size, rng, *, model=_MODEL, rsd=True):
    """1 + delta_HI on the light cone of an observer at the centre, and the way to redshift space.

    1 + delta = exp(b D delta_G - (b D)^2 sigma_G^2 / 2), with bias b and growth D at the redshift of the
    cell, so it is positive, has mean 1, and correlation exp(b^2 D^2 xi) - 1.

    Returns
    -------
    density
        (n, n, n) float32.
    displacement
        f D psi_r, (n, n, n) float32, Mpc/h; None without `rsd`.
    """
    modes = box.gaussian_modes(model.cosmology.linear_power, n_cells, box_size, rng)
    displacement = box.radial_displacement(modes, box_size) if rsd else None
    density = box.real_field(modes)
    del modes
    # Growth and bias against distance, out to the corner of the box.
    radius = np.linspace(0, np.sqrt(3) * box_size / 2, 4096)
    z = model.cosmology.redshift_at(np.minimum(radius, model.cosmology.comoving_distance(Z_MAX)))
    growth = model.cosmology.growth(z)
    x = box.cell_centres(n_cells, box_size)
    variance = float(np.mean([np.mean(plane**2, dtype=np.float64) for plane in density]))  # mean is 0
    _exponentiate(density, x, radius[1], model.bias(z) * growth, variance)
    if rsd:
        _multiply_radial(displacement, x, radius[1], growth * model.cosmology.growth_rate(z))
    return density, displacement


@njit(parallel=True, cache=True)
def _exponentiate(density, x, step, amplitude, variance):
    """density = exp(a density - a^2 variance / 2) in place, a the amplitude at the cell's distance."""
    for i in prange(len(x)):
        for j in range(len(x)):
            for k in range(len(x)):
                a = _at_radius(amplitude, np.sqrt(x[i] ** 2 + x[j] ** 2 + x[k] ** 2) / step)
                density[i, j, k] = np.exp(a * density[i, j, k] - 0.5 * a * a * variance)


@njit(parallel=True, cache=True)
def _multiply_radial(values, x, step, factor):
    """Multiply `values` in place by a factor that depends on the cell's distance."""
    for i in prange(len(x)):
        for j in range(len(x)):
            for k in range(len(x)):
                values[i, j, k] *= _at_radius(factor, np.sqrt(x[i] ** 2 + x[j] ** 2 + x[k] ** 2) / step)


@njit(inline="always")
def _at_radius(table, position):
    low = min(int(position), len(table) - 2)
    return table[low] + (position - low) * (table[low + 1] - table[low])


def _channel_temperature(freq_edges, model):
    """Mean HI temperature of each channel, mK, by Gauss-Legendre over its width."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    centre = 0.5 * (freq_edges[1:] + freq_edges[:-1])
    half = 0.5 * np.diff(freq_edges)
    freqs = centre[:, None] + half[:, None] * nodes
    return 0.5 * model.mean_temperature(redshift(freqs)) @ weights
