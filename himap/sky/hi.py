"""The cosmological signal: HI brightness temperature on the light cone (paper, Sect. 2.1.1).

A lognormal field (Coles & Jones 1991) as in CRIME (Alonso et al. 2014): the Gaussian linear field of
one periodic box, grown and biased at the distance of every cell, exponentiated, moved to redshift
space by the linear velocity of the same box, and averaged over channels and pixels.

The observer is at the centre of the box, on the corner shared by eight cells. Arrays are float32 (complex64
for modes) and one box large; at most three exist at a time.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit, prange
from scipy import fft

from himap.core.errors import InputError
from himap.core.progress import progress
from himap.sky.cosmology import Z_MAX, HIModel, redshift
from himap.sky.light_cone import plan_rays, trace

_MODEL = HIModel()
_TABLE_SIZE = 65536  # of |k| for amplitudes; linear interpolation is good to 1e-4 at the fundamental mode


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
    density, displacement = lognormal_box(
        survey.box_cells, survey.box_size, rng, model=model, rsd=rsd, r_smooth=survey.r_smooth
    )
    cell = survey.box_size / survey.box_cells
    rays = plan_rays(survey.nside, cell, edges[0], edges[-1], oversample=oversample)
    maps = trace(density, displacement, edges, survey.nside, survey.box_size, rays)[::-1]
    nodes, weights = np.polynomial.legendre.leggauss(4)  # over the width of a channel
    freqs = survey.freqs[:, None] + 0.5 * np.diff(survey.freq_edges)[:, None] * nodes
    maps *= (0.5 * model.mean_temperature(redshift(freqs)) @ weights)[:, None]
    return maps


def lognormal_box(n_cells, box_size, rng, *, model=_MODEL, rsd=True, r_smooth=0.0):
    """1 + delta_HI on the light cone of an observer at the centre, and the way to redshift space.

    1 + delta = exp(b D delta_G - (b D)^2 sigma_G^2 / 2), with bias b and growth D at the redshift of the
    cell, so it is positive, has mean 1, and correlation exp(b^2 D^2 xi) - 1.

    Parameters
    ----------
    n_cells, box_size, rng, model, rsd
        As of `hi_maps` and `gaussian_modes`.
    r_smooth
        Mpc/h: the modes of the matter, from which delta_G and the velocities follow, are multiplied by
        exp(-k^2 r_smooth^2 / 2), as with the option of that name of CRIME.

    Returns
    -------
    density
        (n, n, n) float32.
    displacement
        f D psi_r, (n, n, n) float32, Mpc/h; None without `rsd`.
    """

    def power(k):
        return model.cosmology.linear_power(k) * np.exp(-((k * r_smooth) ** 2))

    modes = gaussian_modes(power, n_cells, box_size, rng)
    displacement = radial_displacement(modes, box_size) if rsd else None
    density = real_field(modes)
    del modes
    # Growth and bias against distance, out to the corner of the box.
    radius = np.linspace(0, np.sqrt(3) * box_size / 2, 4096)
    z = model.cosmology.redshift_at(np.minimum(radius, model.cosmology.comoving_distance(Z_MAX)))
    growth = model.cosmology.growth(z)
    x = cell_centres(n_cells, box_size)
    variance = float(np.mean([np.mean(plane**2, dtype=np.float64) for plane in density]))  # mean is 0
    _exponentiate(density, x, radius[1], model.bias(z) * growth, variance)
    if rsd:
        _multiply_radial(displacement, x, radius[1], growth * model.cosmology.growth_rate(z))
    return density, displacement


def cell_centres(n_cells, box_size):
    """Coordinates of the cell centres along one axis, Mpc/h, the observer at 0."""
    return ((np.arange(n_cells) + 0.5) / n_cells - 0.5) * box_size


def gaussian_modes(power, n_cells, box_size, rng):
    """Fourier modes of a Gaussian field of the given power spectrum.

    White noise is drawn in real space, plane by plane from child streams of `rng`, so the result does
    not depend on the number of threads.

    Parameters
    ----------
    power
        Function of k (h/Mpc) that returns P(k) in (Mpc/h)^3.
    n_cells, box_size
        Cells and length (Mpc/h) of a side.
    rng
        numpy Generator.

    Returns
    -------
    modes
        (n_cells, n_cells, n_cells // 2 + 1) complex64, normalised so that `real_field` is the field.
    """
    noise = np.empty((n_cells,) * 3, dtype=np.float32)

    def draw(task):
        plane, stream = task
        stream.standard_normal(out=plane, dtype=np.float32)

    with ThreadPoolExecutor() as pool:
        list(pool.map(draw, zip(noise, rng.spawn(n_cells), strict=True)))
    modes = fft.rfftn(noise, workers=-1)
    del noise
    k_max = np.sqrt(3) * np.pi * n_cells / box_size
    table = np.sqrt(power(np.linspace(0, k_max, _TABLE_SIZE)) / (box_size / n_cells) ** 3)
    _scale_modes(modes, table.astype(np.float32), 2 * np.pi / box_size, k_max)
    return modes


@njit(parallel=True, cache=True)
def _scale_modes(modes, table, k_unit, k_max):
    """Multiply `modes` in place by the amplitude at |k|, interpolated in `table`."""
    n = modes.shape[0]
    step = k_max / (len(table) - 1)
    for i in prange(n):
        kx = k_unit * (i if i < n / 2 else i - n)
        for j in range(n):
            ky = k_unit * (j if j < n / 2 else j - n)
            for k in range(modes.shape[2]):
                x = np.sqrt(kx * kx + ky * ky + (k_unit * k) ** 2) / step
                low = min(int(x), len(table) - 2)
                modes[i, j, k] *= table[low] + (x - low) * (table[low + 1] - table[low])


def real_field(modes):
    """The real field of `modes`, (n, n, n) float32. Destroys `modes`."""
    n_cells = modes.shape[0]
    out = np.empty((n_cells,) * 3, dtype=np.float32)
    for i, plane in _planes(modes):
        out[i] = plane
    return out


def _planes(modes):
    """Inverse transform of `modes`, in place, yielding one real plane (x fixed) at a time."""
    n_cells = modes.shape[0]
    half = fft.ifftn(modes, axes=(0, 1), overwrite_x=True, workers=-1)
    for i in range(n_cells):
        yield i, fft.irfft(half[i], n=n_cells, axis=-1, workers=-1)


def radial_displacement(modes, box_size):
    """Linear displacement of matter along the line of sight, Mpc/h, for growth 1.

    psi = -grad(inverse Laplacian of delta), so psi_k = i k delta_k / k^2; the radial component is
    at the cell centres. In redshift space a cell at growth D and rate f moves by f D psi_r
    (Kaiser 1987).

    Parameters
    ----------
    modes
        From `gaussian_modes`; not changed.
    box_size
        Mpc/h.

    Returns
    -------
    displacement
        (n, n, n) float32, positive away from the observer.
    """
    n_cells = modes.shape[0]
    x = cell_centres(n_cells, box_size).astype(np.float32)
    square = x[:, None] ** 2 + x[None, :] ** 2
    out = np.zeros((n_cells,) * 3, dtype=np.float32)
    for axis in progress(range(3), "HI velocities"):
        gradient = np.empty_like(modes)
        _inverse_gradient(modes, gradient, axis, 2 * np.pi / box_size)
        for i, plane in _planes(gradient):
            along = (x[i], x[:, None], x[None, :])[axis]
            out[i] += plane * along / np.sqrt(x[i] ** 2 + square)
        del gradient
    return out


@njit(parallel=True, cache=True)
def _inverse_gradient(modes, out, axis, k_unit):
    """out = i k_axis modes / k^2; zero at k = 0 and where k_axis is the Nyquist frequency."""
    n = modes.shape[0]
    for i in prange(n):
        ki = i if i < n / 2 else i - n
        for j in range(n):
            kj = j if j < n / 2 else j - n
            for k in range(modes.shape[2]):
                component = ki if axis == 0 else kj if axis == 1 else k
                square = ki * ki + kj * kj + k * k
                if square == 0 or 2 * abs(component) == n:
                    out[i, j, k] = 0
                else:
                    factor = np.float32(component / (square * k_unit))
                    out[i, j, k] = factor * np.complex64(1j) * modes[i, j, k]


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
