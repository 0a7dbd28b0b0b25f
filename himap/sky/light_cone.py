"""From a box of cells to channel maps: rays through the box, in redshift space, averaged.

Every pixel sends rays through the box. Matter between r and r + dr along a ray is moved to the range from
s(r) to s(r + dr), s = r + displacement, and shared among the channels that this overlaps. Matter that
leaves one channel enters another: the average over a channel is exact and mass is conserved.
"""

import numpy as np
from numba import njit, prange

from himap.core.progress import progress
from himap.maps import sphere
from himap.sky.box import unit_of

_STEPS_PER_GAP = 2  # nothing else smooths along a ray, so steps are finer than the gaps between rays
_BLOCKS = 50  # of pixels, between which progress is shown
_MARGIN = 30.0  # Mpc/h beyond the band on either side; linear displacements are 3 Mpc/h rms


def plan_rays(nside, cell, distance_min, distance_max, *, oversample=1.8):
    """Plan rays no further apart than `cell` / `oversample`, with steps half as long, across a band.

    `cell`, `distance_min`, `distance_max` in Mpc/h; a margin for matter displaced into the band is added.

    Returns
    -------
    bounds
        Edges of shells, Mpc/h. Pixels grow with distance, so far shells get more rays: in shell j, counted
        from 0, each pixel sends 4^j.
    step
        Step along a ray, Mpc/h.
    """
    start, stop = max(distance_min - _MARGIN, 0.0), distance_max + _MARGIN
    pixel = np.sqrt(4 * np.pi / (12 * nside**2))
    bounds = [start]
    while bounds[-1] < stop:
        reach = cell / oversample / (pixel / 2 ** (len(bounds) - 1))
        bounds.append(float(min(max(reach, start), stop)))
    return bounds, cell / oversample / _STEPS_PER_GAP


def trace(density, displacement, distance_edges, nside, box_size, *, oversample=1.8):
    """Mean density per channel and pixel, in redshift space.

    Parameters
    ----------
    density
        (n, n, n) float32, 1 + delta at the cell centres.
    displacement
        (n, n, n), from real to redshift space, away from the observer, as from
        `GaussianBox.radial_displacement`; None for none. Interpolation treats the box as periodic, which is
        wrong within half a cell of its faces: an error of up to 1 % of C_l in the channel that touches a
        face.
    distance_edges
        Channel edges as comoving distances, ascending, (n_channels + 1,), Mpc/h.
    nside, box_size, oversample
        Resolution of the maps, side of the box in Mpc/h, and as in `plan_rays`.

    Returns
    -------
    maps
        (n_channels, n_pix) float32, RING: the mean of 1 + delta over channel and pixel.
    """
    edges = np.asarray(distance_edges, dtype=float)
    maps = np.zeros((len(edges) - 1, 12 * nside**2), dtype=np.float32)
    if displacement is None:
        displacement, unit = density, 0.0
    else:
        unit = unit_of(displacement)
    ring = sphere.nest_to_ring(nside)
    blocks = np.array_split(np.arange(len(ring)), _BLOCKS)
    bounds, step = plan_rays(nside, box_size / len(density), edges[0], edges[-1], oversample=oversample)
    per_cell = len(density) / box_size
    for level, (start, stop) in enumerate(zip(bounds[:-1], bounds[1:], strict=True)):
        n_steps = int(np.ceil((stop - start) / step))
        if n_steps == 0:
            continue
        radii = np.linspace(start, stop, n_steps + 1)
        vectors = sphere.pixel_vectors(nside * 2**level, nest=True).astype(np.float32)
        vectors = vectors.reshape(len(ring), -1, 3)
        for part in progress(blocks, f"HI light cone, {start:.0f} to {stop:.0f} Mpc/h"):
            _trace_shell(density, displacement, unit, vectors[part], ring[part], radii, edges, per_cell, maps)
    maps /= np.diff(edges)[:, None]
    return maps


@njit(parallel=True, fastmath=True, cache=True)
def _trace_shell(density, displacement, unit, vectors, ring, radii, edges, per_cell, maps):
    """Add the shell between radii[0] and radii[-1] to `maps`, as integrals over each channel.

    Displacements are in units of `unit`, 0 if there are none. `vectors` (n_pixels, n_rays, 3) are ray
    directions, `ring` the RING index of each pixel. Each pixel is summed by one thread, so sums do not depend
    on the number of threads.
    """
    n_rays = vectors.shape[1]
    nodes = (radii * per_cell).astype(np.float32)
    middles = (0.5 * (radii[:-1] + radii[1:]) * per_cell).astype(np.float32)
    for pixel in prange(len(ring)):
        row = np.zeros(len(edges) - 1)
        moved, inside = np.zeros_like(nodes), np.empty_like(middles)
        cells, weights = np.empty((6, len(nodes)), np.int32), np.empty((3, len(nodes)), np.float32)
        for ray in range(n_rays):
            if unit:
                _interpolate(displacement, vectors[pixel, ray], nodes, cells, weights, moved)
                moved *= np.float32(unit)
            _interpolate(density, vectors[pixel, ray], middles, cells, weights, inside)
            _deposit(row, edges, radii, moved, inside)
        for channel in range(len(row)):
            maps[channel, ring[pixel]] += row[channel] / n_rays


@njit(fastmath=True)
def _deposit(row, edges, radii, moved, density):
    """Share the mass of every step along a ray among the channels in which it ends.

    `moved` are the displaced ends of the steps, `radii`; `density` is that of each step, which is spread
    evenly over the displaced step. Most steps lie entirely in the channel of the previous step.
    """
    channel, inside = 0, 0.0
    near = radii[0] + moved[0]
    for i in range(len(density)):
        far = radii[i + 1] + moved[i + 1]
        mass = (radii[i + 1] - radii[i]) * density[i]
        low, high = (near, far) if near < far else (far, near)
        near = far
        if low >= edges[channel] and high <= edges[channel + 1]:
            inside += mass
        elif low < edges[-1] and high > edges[0]:
            row[channel] += inside
            inside = 0.0
            while channel > 0 and edges[channel] > low:
                channel -= 1
            while edges[channel + 1] <= low:
                channel += 1
            per_width = mass / max(high - low, 1e-6)
            row[channel] += per_width * (min(high, edges[channel + 1]) - max(low, edges[channel]))
            while high > edges[channel + 1] and channel + 2 < len(edges):
                channel += 1
                row[channel] += per_width * (min(high, edges[channel + 1]) - edges[channel])
    row[channel] += inside


@njit(fastmath=True)
def _interpolate(field, direction, radii, cells, weights, out):
    """`field` at `radii` cells from the centre towards `direction`: trilinear, periodic.

    `cells` (6, n) and `weights` (3, n) are work arrays. Positions are computed for the full ray first, in a
    loop that the compiler can vectorise, unlike one that includes the lookups of cells; that is 2.5 times
    faster.
    """
    n = np.uint64(field.shape[0])
    flat = field.ravel()
    for axis in range(3):
        _neighbours(direction[axis], radii, len(field), cells[2 * axis], cells[2 * axis + 1], weights[axis])
    for i in range(len(radii)):
        # Unsigned, so that lookups need no check for negative indices.
        row, next_row = np.uint64(cells[0, i]) * n, np.uint64(cells[1, i]) * n
        j, next_j = np.uint64(cells[2, i]), np.uint64(cells[3, i])
        k, next_k = np.uint64(cells[4, i]), np.uint64(cells[5, i])
        near = _between(flat, (row + j) * n, (row + next_j) * n, k, next_k, weights[1, i], weights[2, i])
        far = _between(
            flat, (next_row + j) * n, (next_row + next_j) * n, k, next_k, weights[1, i], weights[2, i]
        )
        out[i] = near + weights[0, i] * (far - near)


@njit(fastmath=True, inline="always")
def _between(flat, line, next_line, k, next_k, across, along):
    """Interpolate bilinearly in four cells: `k`, `next_k` of the line that starts at `line` and the next."""
    first = flat[line + k] + along * (flat[line + next_k] - flat[line + k])
    second = flat[next_line + k] + along * (flat[next_line + next_k] - flat[next_line + k])
    return first + across * (second - first)


@njit(fastmath=True)
def _neighbours(component, radii, n, low, high, weight):
    """The cells on either side of every position, wrapped periodically, and the weight of the second one."""
    half, n = np.float32(0.5 * n - 0.5), np.int32(n)
    for i in range(len(radii)):
        position = radii[i] * component + half
        floor = np.floor(position)
        weight[i] = position - floor
        cell = np.int32(floor)
        cell = cell + n if cell < 0 else cell
        cell = cell - n if cell >= n else cell
        low[i] = cell
        high[i] = cell + np.int32(1) if cell + np.int32(1) < n else np.int32(0)
