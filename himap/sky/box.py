"""A Gaussian field in a periodic box of cells, and the corresponding displacement of matter.

Transforms run plane by plane and then column by column, in place, so a box may be in memory or in a file.
Arrays are float32 (complex64 for modes), and a box is one large array.
"""

import math
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit, prange
from scipy import fft

from himap.core.errors import InputError
from himap.core.progress import progress
from himap.core.survey import NESTED_CELLS
from himap.maps.low_rank import blocks

STEP = 2.0**-9
"""Mpc/h. In a box with more than `NESTED_CELLS` cells per side, displacements are integer multiples of it, up
to 64 Mpc/h, whether the box is in memory or in files."""

_DENSITY, _POTENTIAL, _ALONG_X = range(3)
_LABELS = "HI density", "HI velocities, y and z", "HI velocities, x"
_TABLE_SIZE = 65536  # values of |k| for amplitudes; linear interpolation: 1e-4 at the fundamental mode
_BLOCK, _BLOCK_IN_FILES = 2**28, 2**31  # bytes of the columns transformed at once: a disk writes
# longer pieces of lines several times faster


class GaussianBox:
    """A Gaussian field with a given power spectrum; the observer is at the centre, a corner of eight cells.

    White noise is drawn in real space, plane by plane from child streams of `rng`, and again for each field;
    the result does not depend on the number of threads. A box with more than `NESTED_CELLS` cells per side
    has the modes of the box of `NESTED_CELLS` cells with the same `rng`; modes beyond are drawn row by row.

    Parameters
    ----------
    power
        Function of k (h/Mpc) that returns P(k) in (Mpc/h)^3.
    n_cells, box_size
        Number of cells and length (Mpc/h) of a side.
    rng
        numpy Generator.
    folder
        A `Path` for files with large arrays (`file_bytes`); default: memory, up to 8 bytes per cell. An array
        completed in such a folder by a run with the same arguments is reused.
    """

    def __init__(self, power, n_cells, box_size, rng, *, folder=None):
        self.n_cells, self.box_size, self.folder = n_cells, box_size, folder
        self._coarse, self._variance = None, None
        if n_cells > NESTED_CELLS:
            shape = NESTED_CELLS, NESTED_CELLS, NESTED_CELLS // 2 + 1
            self._coarse = _draw_planes(np.empty(shape, dtype=np.complex64), rng.spawn(NESTED_CELLS))
            for rows in blocks(NESTED_CELLS, _BLOCK // self._coarse[:, :1].nbytes):
                self._coarse[:, rows] = fft.fft(self._coarse[:, rows], axis=0, workers=-1)
        self._rng, self._seeds = rng, rng.bit_generator.seed_seq.spawn(n_cells + 1)
        k_max = np.sqrt(3) * np.pi * n_cells / box_size
        table = np.sqrt(power(np.linspace(0, k_max, _TABLE_SIZE)) / (box_size / n_cells) ** 3)
        self._table, self._k_unit, self._k_max = table.astype(np.float32), 2 * np.pi / box_size, k_max
        self.x = cell_centres(n_cells, box_size).astype(np.float32)
        self._field, self._is_complete = self._array("density", np.complex64, n_cells // 2 + 1)

    def _array(self, name, dtype, length):
        """An array (n, n, length), in a file if there is a folder, and whether it is already complete."""
        shape = (self.n_cells, self.n_cells, length)
        if self.folder is None:
            return np.empty(shape, dtype=dtype), False
        file, is_complete = self.folder / name, (self.folder / f"{name}.complete").exists()
        if not is_complete:
            with open(file, "wb") as content:
                if hasattr(os, "posix_fallocate"):  # so that the file is contiguous on disk
                    os.posix_fallocate(content.fileno(), 0, math.prod(shape) * np.dtype(dtype).itemsize)
        return np.asarray(np.memmap(file, dtype=dtype, mode="r+", shape=shape)), is_complete

    def _complete(self, name):
        """Mark an array in a file as complete, after it is on disk."""
        if self.folder is not None:
            with open(self.folder / name, "rb+") as content:
                os.fsync(content.fileno())
            (self.folder / f"{name}.complete").touch()

    def density(self, change=lambda i, plane, variance: plane):
        """The field, (n, n, n) float32; the box cannot be used afterwards.

        Parameters
        ----------
        change
            Function of the index of a plane, its field (n, n) and the variance of the box (mean 0), which
            returns the plane to keep.
        """
        n, planes = self.n_cells, () if self._is_complete else self._planes(_DENSITY)
        flat = self._field.reshape(-1).view(np.float32)[: n**3].reshape(n, n, n)
        for i, modes in planes:  # a plane overwrites its own modes, or those of an earlier one
            flat[i] = change(i, fft.irfft2(modes, s=(n, n), workers=-1), self._variance)
        self._complete("density")
        return flat

    def radial_displacement(self, factor):
        """Displacement of matter along the line of sight at cell centres, positive away from the observer.

        psi = -grad(inverse Laplacian of the field), so psi_k = i k delta_k / k^2.

        Parameters
        ----------
        factor
            Function of the index of a plane that returns the factor of its displacements, (n, n).

        Returns
        -------
        displacement
            (n, n, n), in Mpc/h as float32, or, beyond `NESTED_CELLS`, in units of `STEP` as int16.

        Raises
        ------
        InputError
            If one is too large for int16.
        """
        n, x = self.n_cells, self.x
        out, is_complete = self._array("displacement", np.float32 if self._coarse is None else np.int16, n)
        if is_complete:
            return out
        unit = np.float32(unit_of(out))
        k = fft.fftfreq(n, 1 / n).astype(np.float32)
        k[n // 2] = 0  # a derivative has no Nyquist frequency
        gradients = np.complex64(1j) * k[:, None], np.complex64(1j) * k[: n // 2 + 1]
        for part in (_POTENTIAL, _ALONG_X):
            for i, modes in self._planes(part):
                distances = np.sqrt(x[i] ** 2 + x[:, None] ** 2 + x**2)
                if part == _POTENTIAL:
                    y, z = (fft.irfft2(modes * gradient, s=(n, n), workers=-1) for gradient in gradients)
                    along = (y * x[:, None] + z * x) / distances
                else:
                    along = out[i] * unit + fft.irfft2(modes, s=(n, n), workers=-1) * x[i] / distances
                    along = along * factor(i)
                if out.dtype == np.int16:
                    along = np.rint(along / unit)
                    if np.abs(along).max() > np.iinfo(np.int16).max:
                        raise InputError(
                            f"matter is displaced by {np.abs(along).max() * unit:.0f} Mpc/h, and so large a "
                            "box keeps up to 64: take fewer cells, or a larger r_smooth."
                        )
                out[i] = along
        self._complete("displacement")
        return out

    def _planes(self, part):
        """Pairs of the index of a plane of fixed x and its modes of a part of the field, (n, n // 2 + 1)."""
        n, in_files = self.n_cells, self.folder is not None
        if in_files:  # a new file, in which nothing is read before it is written
            self._field, _ = self._array("density", np.complex64, n // 2 + 1)
        field, powers = self._field, []
        streams = [np.random.Generator(type(self._rng.bit_generator)(seed)) for seed in self._seeds]
        if self._coarse is None:
            _draw_planes(field, streams)
        else:  # where k_z is 0 or Nyquist, the modes are those of a real plane
            planes = streams[n].standard_normal((2, n, n), dtype=np.float32)
            planes = fft.fft2(planes, workers=-1) * np.float32(np.sqrt(n))
        n_rows = (_BLOCK_IN_FILES if in_files else _BLOCK) // field[:, :1].nbytes
        for rows in blocks(n, max(n_rows, 1)):
            if self._coarse is None:
                modes = fft.fft(field[:, rows], axis=0, workers=-1)
            else:
                modes = _draw_rows(streams[:n][rows], planes[:, :, rows])
                _insert(modes, self._coarse, rows.start)
            powers.append(_shape(modes, rows.start, self._table, self._k_unit, self._k_max, part))
            field[:, rows] = fft.ifft(modes, axis=0, overwrite_x=True, workers=-1)
        self._variance = math.fsum(powers) / float(n) ** 6
        return progress(enumerate(field), f"{_LABELS[part]}{' (box in files)' * in_files}", total=n)


def unit_of(displacement):
    """Unit of the values of a displacement, Mpc/h."""
    return STEP if displacement.dtype == np.int16 else 1.0


def file_bytes(n_cells):
    """Size of a box in files, bytes."""
    return (6 if n_cells > NESTED_CELLS else 8) * n_cells**3


def cell_centres(n_cells, box_size):
    """Coordinates of the cell centres along one axis, Mpc/h, the observer at 0."""
    return ((np.arange(n_cells) + 0.5) / n_cells - 0.5) * box_size


def _draw_planes(out, streams):
    """Fill `out`, (n, n, n // 2 + 1), with white noise of variance 1, transformed along two axes."""

    def draw(task):
        plane, stream = task
        plane[:] = fft.rfft2(stream.standard_normal((len(out), len(out)), dtype=np.float32))

    with ThreadPoolExecutor() as pool:
        list(pool.map(draw, zip(out, streams[: len(out)], strict=True)))
    return out


def _draw_rows(streams, planes):
    """White noise of variance 1 in some rows, transformed along all axes; `planes` are its ends in k_z."""
    n = planes.shape[1]
    out = np.empty((n, len(streams), n // 2 + 1), dtype=np.complex64)

    def draw(row):
        out[:, row] = streams[row].standard_normal((n, n + 2), dtype=np.float32).view(np.complex64)

    with ThreadPoolExecutor() as pool:
        list(pool.map(draw, range(len(streams))))
    out *= np.float32(np.sqrt(n**3 / 2))
    out[:, :, 0], out[:, :, -1] = planes
    return out


@njit(parallel=True, cache=True)
def _shape(modes, first, table, k_unit, k_max, part):
    """Multiply white noise in place by the amplitude at |k|, interpolated in `table`; rows begin at `first`.

    The potential is divided by k^2 and by `k_unit`, so its gradient has integer wavenumbers; the part along x
    is that gradient. Returns the sum of |modes|^2, counting twice those that a real field has twice.
    """
    n, last = modes.shape[0], modes.shape[2] - 1
    powers = np.zeros(n)
    step = k_max / k_unit / (len(table) - 1)
    for i in prange(n):
        ki = i if i < n / 2 else i - n
        for row in range(modes.shape[1]):
            j = first + row
            kj = j if j < n / 2 else j - n
            for k in range(modes.shape[2]):
                square = ki * ki + kj * kj + k * k
                x = np.sqrt(square) / step
                low = min(int(x), len(table) - 2)
                value = modes[i, row, k] * (table[low] + (x - low) * (table[low + 1] - table[low]))
                if part == _POTENTIAL:
                    value = value / (square * k_unit) if square else 0 * value
                elif part == _ALONG_X:
                    is_kept = square > 0 and 2 * abs(ki) != n
                    value = value * np.complex64(1j) * ki / (square * k_unit) if is_kept else 0 * value
                modes[i, row, k] = value
                stored, twice = modes[i, row, k], 1 if k in (0, last) else 2
                powers[i] += twice * (np.float64(stored.real) ** 2 + np.float64(stored.imag) ** 2)
    return powers.sum()


@njit(parallel=True, cache=True)
def _insert(modes, coarse, first):
    """Copy the modes of a coarser box of the same size in Mpc/h into those of a finer one, rows from `first`.

    The first cell centre, where transforms begin, differs: phases get pi k (1 / n_fine - 1 / n_coarse).
    """
    n, n_coarse = modes.shape[0], coarse.shape[0]
    top = n_coarse // 2
    scale, turn = (n / n_coarse) ** 1.5, np.pi * (1 / n - 1 / n_coarse)
    for i in prange(n):
        ki = i if i < n / 2 else i - n
        for row in range(modes.shape[1]):
            j = first + row
            kj = j if j < n / 2 else j - n
            if abs(ki) < top and abs(kj) < top:
                for k in range(top):
                    phase = turn * (ki + kj + k)
                    value = coarse[np.int64(ki) % n_coarse, np.int64(kj) % n_coarse, k]
                    modes[i, row, k] = value * scale * complex(np.cos(phase), np.sin(phase))
