"""Angular and frequency power spectra of channel maps, with or without a mask.

The mean over the sky is removed from every channel first, as in the paper.
"""

import numbers
import warnings
from dataclasses import dataclass

import numpy as np
from scipy import fft

from himap.core.checks import checked_cube, parameter, real_array, whole_number
from himap.core.errors import InputError
from himap.core.progress import progress
from himap.maps import sphere
from himap.maps.low_rank import blocks
from himap.maps.masks import bin_matrix, mask_weights

BLOCK = 4096
"""Lines of sight per block, to keep their float64 copy small."""

_MAX_CONDITION = 1e6  # beyond it decoupling amplifies rounding of float32 maps to the size of the signal


@dataclass(frozen=True, kw_only=True)
class AngularPower:
    """`degrees` (n_l,), the mean l of each bin; `cl` (n_channels, n_l), mK^2."""

    degrees: np.ndarray
    cl: np.ndarray

    @property
    def mean(self):
        """C_l averaged over channels, (n_l,)."""
        return self.cl.mean(axis=0)

    @property
    def variance(self):
        """Variance over the sphere of every channel, (n_channels,), mK^2; requires C_l at every l."""
        return self.cl @ (2 * self.degrees + 1) / (4 * np.pi)

    def upto(self, lmax):
        """The same up to `lmax`; unchanged if None."""
        inside = slice(None) if lmax is None else self.degrees <= lmax
        return AngularPower(degrees=self.degrees[inside], cl=self.cl[:, inside])


TAPERS = {"none": None, "hann": lambda x: 1 + np.cos(2 * np.pi * x)}
"""{taper of a line of sight before its Fourier transform: function of position in the band, -1/2 to 1/2}."""


@dataclass(frozen=True, kw_only=True)
class FrequencyPower:
    """`k` (n_k,), 1/MHz, from 0; `power` (n_k,), mK^2 MHz, averaged over lines of sight with this `taper`."""

    k: np.ndarray
    power: np.ndarray
    taper: str = parameter("none", "of lines of sight, one of `TAPERS`", off="none")


def tapered_modes(lines, taper):
    """Fourier transform along frequency of lines of sight times a taper, (n_channels, ...) to (n_k, ...).

    The taper, one of `TAPERS`, is normalised to a mean square of 1, so white noise keeps its power.
    """
    if TAPERS[taper] is not None:
        n_channels = len(lines)
        window = TAPERS[taper]((np.arange(n_channels) + 0.5) / n_channels - 0.5)
        window /= np.sqrt(np.mean(window**2))
        lines = lines * window.astype(lines.dtype).reshape(-1, *[1] * (lines.ndim - 1))
    return fft.rfft(lines, axis=0, workers=-1)


@dataclass(frozen=True, kw_only=True)
class PowerSpectra:
    """Both spectra of one cube."""

    angular: AngularPower
    frequency: FrequencyPower


def angular_power(maps, *, mask=None, bin_width=None):
    """`AngularPower` of every channel, up to l = 3 nside - 1.

    With a mask the pseudo-C_l are decoupled by the mask's mode-coupling matrix (MASTER, Hivon et al. 2002),
    in bins of l. If the binned matrix cannot be inverted reliably, a warning is issued and the pseudo-C_l are
    divided by the mean of the squared weights, the kept fraction of the sky, instead. The mean over the mask
    is subtracted from every channel and not restored: the bin of l = 0 and 1, or l = 0 for bins of one l, is
    then meaningless. A bin of a steep spectrum differs slightly from the mean of the spectrum: for (l + 3)^-2
    the first two bins are 10 % low with 30 % of the sky and 25 % with 10 %, further ones 2 to 4 %; ratios to
    a truth with the same mask are right.

    Parameters
    ----------
    maps
        (n_channels, n_pix), mK, RING.
    mask
        (n_pix,) bool, True where kept, or weights between 0 and 1; None for the full sky.
    bin_width
        Multipoles per bin; default: 1 / f_sky rounded up, so 1 on the full sky.

    Raises
    ------
    InputError
        If the mask has the wrong shape or keeps nothing, or the bin width is invalid.
    """
    maps, weights = checked_maps(maps, mask)
    lmax = 3 * sphere.nside_of(maps) - 1
    width = None if bin_width is None else whole_number("bin_width", bin_width, 1, lmax)
    pseudo = [
        sphere.power_spectrum(sphere.analyse(weighted(channel, weights).astype(maps.dtype), lmax))
        for channel in progress(maps, "angular spectra")
    ]
    return decouple(np.array(pseudo), None if mask is None else weights, width)


def decouple(pseudo, weights=None, bin_width=None):
    """`AngularPower` of pseudo-C_l (n_channels, lmax + 1), mK^2, in bins of l as in `angular_power`.

    `weights` (n_pix,) are those of the mask, whose mode coupling is inverted, or, if this is impossible, only
    divided by their mean square, with a warning; None for the full sky.
    """
    lmax = pseudo.shape[1] - 1
    if bin_width is None:
        bin_width = 1 if weights is None else min(int(np.ceil(1 / weights.mean())), lmax)
    bins = bin_matrix(lmax, bin_width)
    cl = pseudo @ bins.T
    if weights is not None:
        coupling = sphere.coupling_matrix(sphere.power_spectrum(sphere.analyse(weights)), lmax)
        binned = bins @ coupling @ (bins > 0).T
        condition, f_sky = np.linalg.cond(binned), np.mean(weights**2)
        if condition > _MAX_CONDITION:
            warnings.warn(
                f"the mask keeps {f_sky:.1%} of the sky and its coupling matrix has condition number "
                f"{condition:.1e}: C_l are divided by that fraction instead of decoupled; use wider bins.",
                stacklevel=2,
            )
            cl /= f_sky
        else:
            cl = np.linalg.solve(binned, cl.T).T
    return AngularPower(degrees=bins @ np.arange(lmax + 1), cl=cl)


def weighted(pixels, weights):
    """One map (n_pix,) less its weighted mean, times its weights; 0 where the weights are 0."""
    if (weights == 1).all():
        return pixels - pixels.mean(dtype=np.float64)
    kept = weights > 0
    return weights * np.where(kept, pixels - np.average(pixels[kept], weights=weights[kept]), 0)


def quotient(power, ratio, fill=0.0):
    """power / ratio, float64; `fill` where the ratio is 0."""
    return np.divide(power, ratio, out=np.full(np.broadcast(power, ratio).shape, fill), where=ratio != 0)


def checked_maps(maps, mask):
    """Maps (n_channels, n_pix) and the weights (n_pix,) of a mask; maps are not checked where these are 0.

    Raises
    ------
    InputError
        If maps are not finite where kept, or the mask is invalid.
    """
    maps = real_array("maps", maps)
    shape = maps.shape
    weights = mask_weights(mask, shape[-1] if shape else 0)
    return checked_cube("maps", maps, kept=None if mask is None else weights > 0), weights


def frequency_power(maps, channel_width, *, mask=None, taper="none"):
    """`FrequencyPower`, averaged over lines of sight.

    ``P(k) = <|dnu FFT_nu(T - mean)|^2> / (n_channels dnu)`` at k = 2 pi n / (n_channels dnu), n = 0 to
    n_channels // 2, less the mean over the sky of each channel.

    Parameters
    ----------
    maps
        (n_channels, n_pix), mK.
    channel_width
        MHz.
    mask
        As in `angular_power`; weights enter the mean linearly over lines of sight.
    taper
        A name in `TAPERS`; its mean square is 1.

    Raises
    ------
    InputError
        For an invalid mask or taper, or a channel width that is not a positive number.
    """
    maps, weights = checked_maps(maps, mask)
    if not (isinstance(channel_width, numbers.Real) and 0 < channel_width < np.inf):
        raise InputError(f"channel_width must be a positive number of MHz, got {channel_width!r}.")
    if not isinstance(taper, str) or taper not in TAPERS:
        raise InputError(f"taper must be one of {', '.join(TAPERS)}, got {taper!r}.")
    n_channels, n_pix = maps.shape
    kept = weights > 0
    inside, norm = slice(None) if kept.all() else kept, weights.sum()
    mean = np.array([channel[inside] @ weights[inside] / norm for channel in maps]).astype(maps.dtype)
    total, weights = np.zeros(n_channels // 2 + 1), weights.astype(maps.dtype)
    for block in progress(blocks(n_pix, BLOCK), "frequency spectra"):
        lines = np.where(kept[block], maps[:, block] - mean[:, None], 0)
        modes = tapered_modes(lines, taper)
        total += (modes.real**2 + modes.imag**2) @ weights[block]
    power = total * channel_width / (n_channels * norm)
    return FrequencyPower(k=2 * np.pi * fft.rfftfreq(n_channels, channel_width), power=power, taper=taper)
