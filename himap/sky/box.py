"""A Gaussian density field in a periodic box, and its linear displacement towards the observer.

The observer sits at the centre of the box, on the corner shared by eight cells. Arrays are float32
(complex64 for modes) and one box large; at most three exist at a time.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit, prange
from scipy import fft

from himap.core.progress import progress

_TABLE_SIZE = (
    65536  # |k| table of the amplitudes; linear interpolation is good to 1e-4 at the fundamental mode
)


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
    taken at the cell centres. In redshift space a cell at growth D and rate f moves by f D psi_r
    (Kaiser 1987).

    Parameters
    ----------
    modes
        From `gaussian_modes`; left as they are.
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
