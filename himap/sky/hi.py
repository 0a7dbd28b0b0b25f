"""The cosmological signal: HI brightness temperature on the light cone (paper, Sect. 2.1.1).

A lognormal field (Coles & Jones 1991) as in CRIME (Alonso et al. 2014): the Gaussian linear field of
one periodic box, grown and biased at the distance of every cell, exponentiated, moved to redshift
space by the linear velocity of the same box, and averaged over channels and pixels.
"""

import numpy as np
from numba import njit, prange

from himap.core.errors import InputError
from himap.sky.box import GaussianBox
from himap.sky.cosmology import Z_MAX, HIModel, redshift
from himap.sky.light_cone import trace

_MODEL = HIModel()


def hi_maps(survey, rng, *, model=_MODEL, rsd=True, oversample=1.8, folder=None):
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
        Rays per cell of the box, in the transverse direction; steps along a ray are half as long. 1.8 is the
        largest value with which 16 rays per pixel reach 900 MHz in all presets; using 4 instead changes the
        power up to l = 2 nside by about 1 % (tests/test_hi.py limits it to 1.5 %).
    folder
        As in `lognormal_box`.

    Returns
    -------
    maps
        (n_channels, n_pix) float32, mK, RING: T = Tbar(z) (1 + delta_s); negative only where 1 + delta
        is negative.

    Raises
    ------
    InputError
        If the band extends beyond the box.
    """
    cosmology = model.cosmology
    edges = cosmology.comoving_distance(redshift(survey.freq_edges))[::-1]
    if edges[-1] > survey.box_size / 2:
        raise InputError(
            f"the HI box is too small: {survey.freq_min} MHz is {edges[-1]:.0f} Mpc/h away, the box of "
            f"{survey.box_size:.0f} Mpc/h reaches {survey.box_size / 2:.0f}. Set box_size to at least "
            f"{2 * edges[-1]:.0f} or raise freq_min."
        )
    options = {"model": model, "rsd": rsd, "r_smooth": survey.r_smooth, "hi_bias": survey.hi_bias}
    density, displacement = lognormal_box(survey.box_cells, survey.box_size, rng, folder=folder, **options)
    maps = trace(density, displacement, edges, survey.nside, survey.box_size, oversample=oversample)[::-1]
    nodes, weights = np.polynomial.legendre.leggauss(4)  # over the width of a channel
    freqs = survey.freqs[:, None] + 0.5 * np.diff(survey.freq_edges)[:, None] * nodes
    maps *= (0.5 * model.mean_temperature(redshift(freqs)) @ weights)[:, None]
    return maps


def lognormal_box(
    n_cells, box_size, rng, *, model=_MODEL, rsd=True, r_smooth=0.0, hi_bias="exponential", folder=None
):
    """1 + delta_HI on the light cone of an observer at the centre, and the displacement to redshift space.

    1 + delta = exp(b D delta_G - (b D)^2 sigma_G^2 / 2), with bias b and growth D at the redshift of the
    cell, so it is positive, with mean 1 and correlation exp(b^2 D^2 xi) - 1. With ``hi_bias="contrast"`` it
    is 1 + b (exp(D delta_G - D^2 sigma_G^2 / 2) - 1), with correlation b^2 (exp(D^2 xi) - 1), and may be
    negative in voids if b > 1.

    Linear displacements are psi = -grad(inverse Laplacian of delta_G), so psi_k = i k delta_k / k^2; the
    radial component is given at cell centres. In redshift space a cell moves by f D psi_r (Kaiser 1987).

    Parameters
    ----------
    n_cells, box_size, rng, model, rsd
        As in `hi_maps` and `GaussianBox`.
    r_smooth
        Mpc/h: the modes of matter, which determine delta_G and the velocities, are multiplied by
        exp(-k^2 r_smooth^2 / 2), like the option of that name in CRIME.
    hi_bias
        "exponential" or "contrast": the quantity that the bias multiplies.
    folder
        A `Path` for files that hold the box during the calculation; default: memory. Results are equal.

    Returns
    -------
    density
        (n, n, n) float32.
    displacement
        f D psi_r, (n, n, n), as from `GaussianBox.radial_displacement`; None without `rsd`.
    """
    if hi_bias not in ("exponential", "contrast"):
        raise InputError(f"hi_bias must be exponential or contrast, got {hi_bias!r}.")

    def power(k):
        return model.cosmology.linear_power(k) * np.exp(-((k * r_smooth) ** 2))

    # Growth and bias by distance, up to the corner of the box.
    radius = np.linspace(0, np.sqrt(3) * box_size / 2, 4096)
    z = model.cosmology.redshift_at(np.minimum(radius, model.cosmology.comoving_distance(Z_MAX)))
    growth = model.cosmology.growth(z)
    move, bias = growth * model.cosmology.growth_rate(z), model.bias(z)
    amplitude = growth * bias if hi_bias == "exponential" else growth

    def lognormal(i, plane, variance):
        a = at_distances(box.x[i], box.x, radius[1], amplitude)
        density = np.exp(a * (plane - 0.5 * variance * a))
        if hi_bias == "contrast":
            density = 1 + at_distances(box.x[i], box.x, radius[1], bias) * (density - 1)
        return density

    box = GaussianBox(power, n_cells, box_size, rng, folder=folder)
    moved = None
    if rsd:
        moved = box.radial_displacement(lambda i: at_distances(box.x[i], box.x, radius[1], move))
    return box.density(lognormal), moved


@njit(parallel=True, cache=True)
def at_distances(x, along, step, table):
    """Interpolate a table for distances 0, `step`, ... at the cells of the plane at `x`, (n, n) float32."""
    out = np.empty((len(along), len(along)), dtype=np.float32)
    for j in prange(len(along)):
        for k in range(len(along)):
            position = np.sqrt(x**2 + along[j] ** 2 + along[k] ** 2) / step
            low = min(int(position), len(table) - 2)
            out[j, k] = table[low] + (position - low) * (table[low + 1] - table[low])
    return out
