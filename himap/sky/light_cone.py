"""From a box of cells to channel maps: rays through the box, in redshift space, averaged.

Every pixel sends rays through the box. Along a ray, matter between r and r + dr lands between
s(r) and s(r + dr), s = r + displacement, and is shared among the channels it overlaps there. What
leaves one channel arrives in another: the average over a channel is exact and mass is conserved.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit, prange

from himap import sphere
from himap.progress import progress

__all__ = ["Rays", "plan_rays", "trace"]

_STEPS_PER_GAP = 2  # along a ray nothing else smooths, so steps are finer than the gaps between rays
_BLOCKS = 50  # of pixels, between which progress is shown
_MARGIN = 30.0  # Mpc/h beyond the band on either side; linear displacements are 3 Mpc/h rms


@dataclass(frozen=True)
class Rays:
    """Which rays sample which distances.

    The pixel grows with distance, so far shells get more rays: between `bounds[j]` and
    `bounds[j + 1]` (Mpc/h) each pixel sends 4^j rays, in steps of `step` Mpc/h.
    """

    bounds: tuple[float, ...]
    step: float


def plan_rays(nside, cell, distance_min, distance_max, *, oversample=2.0):
    """Rays no further apart than `cell` / `oversample`, with steps half as long, across a band.

    `cell`, `distance_min` and `distance_max` in Mpc/h; a margin for matter displaced into the band is added.
    """
    start, stop = max(distance_min - _MARGIN, 0.0), distance_max + _MARGIN
    pixel = np.sqrt(4 * np.pi / (12 * nside**2))
    bounds = [start]
    while bounds[-1] < stop:
        reach = cell / oversample / (pixel / 2 ** (len(bounds) - 1))
        bounds.append(float(min(max(reach, start), stop)))
    return Rays(bounds=tuple(bounds), step=cell / oversample / _STEPS_PER_GAP)


def trace(density, displacement, distance_edges, nside, box_size, rays):
    """Mean density per channel and pixel, in redshift space.

    Parameters
    ----------
    density
        (n, n, n) float32, 1 + delta at the cell centres.
    displacement
        (n, n, n) float32, from real to redshift space, away from the observer, Mpc/h; None for none.
    distance_edges
        Channel edges as comoving distances, ascending, (n_channels + 1,), Mpc/h.
    nside, box_size, rays
        Resolution of the maps, side of the box in Mpc/h, and a `Rays`.

    Returns
    -------
    maps
        (n_channels, n_pix) float32, RING: the mean of 1 + delta over channel and pixel.
    """
    maps = np.zeros((len(distance_edges) - 1, 12 * nside**2), dtype=np.float32)
    still = displacement is None
    ring = sphere.nest_to_ring(nside)
    for level, (start, stop) in enumerate(zip(rays.bounds[:-1], rays.bounds[1:], strict=True)):
        n_steps = int(np.ceil((stop - start) / rays.step))
        if n_steps == 0:
            continue
        vectors = (
            sphere.pixel_vectors(nside * 2**level, nest=True).astype(np.float32).reshape(len(ring), -1, 3)
        )
        blocks = np.array_split(np.arange(len(ring)), _BLOCKS)
        for pixels in progress(blocks, f"HI light cone, {start:.0f} to {stop:.0f} Mpc/h"):
            _trace_shell(
                density,
                density if still else displacement,
                0.0 if still else 1.0,
                vectors[pixels],
                ring[pixels],
                np.linspace(start, stop, n_steps + 1),
                np.asarray(distance_edges, dtype=float),
                density.shape[0] / box_size,
                maps,
            )
    maps /= np.diff(distance_edges)[:, None]
    return maps


@njit(parallel=True, fastmath=True, cache=True)
def _trace_shell(density, displacement, move, vectors, ring, radii, edges, per_cell, maps):
    """Add the shell between radii[0] and radii[-1] to `maps`, as integrals over each channel.

    `vectors` (n_pixels, n_rays, 3) are ray directions, `ring` the RING index of each pixel. One thread
    owns a pixel: the sums are the same for any number of threads.
    """
    n_rays = vectors.shape[1]
    for pixel in prange(len(ring)):
        row = np.zeros(len(edges) - 1)
        for ray in range(n_rays):
            x, y, z = vectors[pixel, ray]
            channel = 0
            near = radii[0] + move * _interpolate(displacement, x, y, z, radii[0] * per_cell)
            for i in range(1, len(radii)):
                far = radii[i] + move * _interpolate(displacement, x, y, z, radii[i] * per_cell)
                step = radii[i] - radii[i - 1]
                middle = 0.5 * (radii[i - 1] + radii[i]) * per_cell
                mass = step * _interpolate(density, x, y, z, middle)
                channel = _deposit(row, edges, min(near, far), max(near, far), mass, channel)
                near = far
        for channel in range(len(row)):
            maps[channel, ring[pixel]] += row[channel] / n_rays


@njit(fastmath=True, inline="always")
def _deposit(row, edges, low, high, mass, hint):
    """Share `mass`, spread evenly over low..high, among the channels between `edges`.

    The search for the first channel starts from `hint`; returns it, as the next hint.
    """
    if high <= edges[0] or low >= edges[-1]:
        return hint
    while hint > 0 and edges[hint] > low:
        hint -= 1
    while edges[hint + 1] <= low:
        hint += 1
    per_width = mass / max(high - low, 1e-6)
    channel = hint
    while channel < len(row) and edges[channel] < high:
        row[channel] += per_width * (min(high, edges[channel + 1]) - max(low, edges[channel]))
        channel += 1
    return hint


@njit(fastmath=True, inline="always")
def _interpolate(field, x, y, z, radius):
    """`field` at `radius` cells from the centre towards (x, y, z): trilinear, periodic."""
    n = field.shape[0]
    i0, i1, u = _neighbours(radius * x + 0.5 * n - 0.5, n)
    j0, j1, v = _neighbours(radius * y + 0.5 * n - 0.5, n)
    k0, k1, w = _neighbours(radius * z + 0.5 * n - 0.5, n)
    near = (1 - v) * ((1 - w) * field[i0, j0, k0] + w * field[i0, j0, k1])
    near += v * ((1 - w) * field[i0, j1, k0] + w * field[i0, j1, k1])
    far = (1 - v) * ((1 - w) * field[i1, j0, k0] + w * field[i1, j0, k1])
    far += v * ((1 - w) * field[i1, j1, k0] + w * field[i1, j1, k1])
    return (1 - u) * near + u * far


@njit(fastmath=True, inline="always")
def _neighbours(position, n):
    """The cells on either side of `position`, wrapped once around, and the weight of the second."""
    floor = int(np.floor(position))
    weight = position - floor
    low = floor + n if floor < 0 else floor - n if floor >= n else floor
    return low, (low + 1 if low + 1 < n else 0), weight
