"""Power by wavenumber across and along the line of sight, for a box treated as flat.

P(k) = V / N |sum_x T(x) exp(-i k x)|^2, with N observed cells of volume V; T is 0 on other lines of
sight. White noise of variance s^2 has P = s^2 V.
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft

from himap.core.checks import checked_cube, evenly_spaced, real_array
from himap.core.errors import InputError
from himap.measures.spectra import quotient

_PER_DECADE = 8  # bins


@dataclass(frozen=True, kw_only=True)
class CylindricalPower:
    """Power in bins of k_perp > 0 and k_par > 0.

    Attributes
    ----------
    k_perp, k_par
        Mean over the modes of each bin, h/Mpc, (n_perp,) and (n_par,).
    perp_edges, par_edges
        Edges of the bins, one more than bins.
    power
        (n_par, n_perp), mK^2 (Mpc/h)^3.
    n_modes
        Number of modes in a bin, (n_par, n_perp). Of two k that differ in sign only the one with k_par >
        0 is counted, but both at the Nyquist k_par.
    """

    k_perp: np.ndarray
    k_par: np.ndarray
    perp_edges: np.ndarray
    par_edges: np.ndarray
    power: np.ndarray
    n_modes: np.ndarray


def cylindrical_power(maps, cell, *, mask=None, most=np.inf):
    """The `CylindricalPower` of maps, less the mean of every channel.

    Modes with k_perp = 0, which are these means, and with k_par = 0 are excluded, and so are modes beyond the
    bin of the smaller Nyquist wavenumber across. With a mask W, subtracting the means also removes a share
    ``|W(k_perp) / W(0)|^2`` of the power of white noise in other modes; this is restored.

    Parameters
    ----------
    maps
        (n_channels, n_y, n_x), mK; masked pixels may have any value.
    cell
        Sides of a cell along the three axes, Mpc/h: along the line of sight, and across.
    mask
        (n_y, n_x) bool, True where seen; None for all.
    most
        Upper limit of the edges of k_perp bins, h/Mpc, except for the first bin.

    Returns
    -------
    CylindricalPower

    Raises
    ------
    InputError
        For maps of another shape, too few cells for a mode along or across, or an invalid cell or mask.
    """
    maps, seen = _check_input(maps, cell, mask)
    n_channels, n_y, n_x = maps.shape
    centred = np.zeros_like(maps)
    for channel, out in zip(maps, centred, strict=True):
        out[seen] = channel[seen] - channel[seen].mean(dtype=np.float64)
    modes = fft.rfftn(centred, axes=(1, 2, 0), workers=-1)
    norm = np.prod(cell) / (maps.size * seen.mean())

    k_par = 2 * np.pi * fft.rfftfreq(n_channels, cell[0])
    k_y, k_x = (2 * np.pi * fft.fftfreq(n, side) for n, side in zip((n_y, n_x), cell[1:], strict=True))
    k_perp = np.hypot(k_y[:, None], k_x)
    par_edges = _edges(k_par[1], k_par[-1])
    perp_edges = _edges(min(abs(k_y[1]), abs(k_x[1])), min(-k_y.min(), -k_x.min()))
    perp_edges = perp_edges[: max(2, np.searchsorted(perp_edges, most, side="right"))]
    along = np.digitize(k_par, par_edges) == np.arange(1, len(par_edges))[:, None]  # (n_par, n_k)
    columns, n_perp = np.digitize(k_perp, perp_edges).ravel(), len(perp_edges) - 1

    def across(values):
        """Sums over the modes of one k_par in every bin of k_perp."""
        return np.bincount(columns, values.ravel(), minlength=n_perp + 2)[1 : n_perp + 1]

    total = along @ np.array([across(plane.real**2 + plane.imag**2) for plane in modes])
    in_row, in_column = along.sum(axis=1), across(np.ones(k_perp.shape))
    with_means = across(1 - np.abs(fft.fft2(seen) / seen.sum()) ** 2)  # number of modes without the means
    n_modes = np.outer(in_row, in_column.astype(int))
    return CylindricalPower(
        k_perp=quotient(across(k_perp), in_column, np.nan),
        k_par=quotient(along @ k_par, in_row, np.nan),
        perp_edges=perp_edges,
        par_edges=par_edges,
        power=norm * quotient(total, np.outer(in_row, with_means), np.nan),
        n_modes=n_modes,
    )


def _check_input(maps, cell, mask):
    """Maps as floats, and the mask (n_y, n_x) bool."""
    maps = real_array("maps", maps)
    if maps.ndim != 3 or min(maps.shape) < 2:
        raise InputError(
            f"maps must have shape (n_channels, n_y, n_x), two or more of each, for modes along and across; "
            f"got {maps.shape}."
        )
    sides = np.asarray(cell, dtype=float)
    if sides.shape != (3,) or not (np.isfinite(sides) & (sides > 0)).all():
        raise InputError(f"a cell must have three sides above zero, in Mpc/h, got {cell!r}.")
    seen = np.ones(maps.shape[1:], dtype=bool) if mask is None else np.asarray(mask)
    if seen.shape != maps.shape[1:] or seen.dtype != bool or not seen.any():
        raise InputError(
            f"the mask must be True where seen and False elsewhere, of shape {maps.shape[1:]}, and True "
            f"somewhere; got {seen.dtype} {seen.shape}."
        )
    lines = checked_cube("maps", maps.reshape(len(maps), -1), kept=seen.ravel())
    return lines.reshape(maps.shape), seen


def _edges(step, top):
    """Edges of bins, halfway between multiples of `step`, even in the logarithm where these are many."""
    edges = [0.5]
    while edges[-1] * step < top:
        edges.append(max(edges[-1] + 1, np.floor(edges[-1] * 10 ** (1 / _PER_DECADE)) + 0.5))
    return np.array(edges) * step


def cell_of(freqs, angles):
    """Sides of a voxel in Mpc/h, along the line of sight and across, (3,), and their redshift.

    Across, they are the comoving distance to the middle of the band times the angles; along, the mean
    distance between two channels.

    Parameters
    ----------
    freqs
        Channel centres, MHz, ascending and evenly spaced.
    angles
        Height and width of a pixel, rad.

    Raises
    ------
    InputError
        If channels are not evenly spaced, or show no 21 cm line, or one beyond redshift 5.
    """
    from himap.sky.cosmology import FREQ_21CM, Cosmology, redshift  # slow, and rarely needed for a cleaning

    if len(freqs) < 2:
        raise InputError("a cell along the line of sight needs two channels at least, got one.")
    if not evenly_spaced(freqs):
        steps = np.diff(freqs)
        raise InputError(
            f"channels must be evenly spaced, and these are {steps.min():g} to {steps.max():g} MHz apart."
        )
    if freqs[-1] >= FREQ_21CM:
        raise InputError(f"channels must be below {FREQ_21CM:.1f} MHz to show 21 cm, got {freqs[-1]:g} MHz.")
    cosmology = Cosmology()
    z = float(redshift(0.5 * (freqs[0] + freqs[-1])))
    far, near = cosmology.comoving_distance(redshift(freqs[[0, -1]]))
    along = (far - near) / (len(freqs) - 1)
    return np.array([along, *(cosmology.comoving_distance(z) * np.asarray(angles))]), z
