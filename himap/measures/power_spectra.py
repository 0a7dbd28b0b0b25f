"""Angular and frequency power spectra of channel maps, with or without a mask.

The mean over the sky is removed from every channel first, as in the paper.
"""

import numbers
from dataclasses import dataclass

import numpy as np
from scipy import fft

from himap.core.checks import checked_cube, whole_number
from himap.core.errors import InputError
from himap.core.progress import progress
from himap.maps import sphere
from himap.maps.blocked import blocks
from himap.maps.masks import bin_matrix, decoupled, mask_weights

_BLOCK = 4096  # lines of sight at a time
_CHANNELS = 16  # at a time
_MOST = 0.75  # of the sky kept: what is left out is then small enough for a rough analysis
_MINOR = 1e-3  # of the variance of a channel of the truth: a rough analysis, good to percents, will do


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
        """Variance over the sphere of every channel, (n_channels,), mK^2, where there is a C_l at every l."""
        return self.cl @ (2 * self.degrees + 1) / (4 * np.pi)

    def upto(self, lmax):
        """The same to `lmax`, or as it is for None."""
        inside = slice(None) if lmax is None else self.degrees <= lmax
        return AngularPower(degrees=self.degrees[inside], cl=self.cl[:, inside])


@dataclass(frozen=True, kw_only=True)
class FrequencyPower:
    """`k` (n_k,), 1/MHz, from 0; `power` (n_k,), mK^2 MHz, averaged over lines of sight."""

    k: np.ndarray
    power: np.ndarray


def angular_power(maps, *, mask=None, lmax=None, bin_width=None):
    """Angular power spectrum of every channel.

    With a mask the pseudo-C_l are decoupled by the mask's mode-coupling matrix (MASTER, Hivon et al.
    2002), in bins of l. If the binned matrix cannot be inverted reliably, a warning is given and
    the pseudo-C_l are divided by the kept fraction of the sky, the mean of the squared weights, instead.

    Parameters
    ----------
    maps
        (n_channels, n_pix), mK, RING.
    mask
        (n_pix,) bool, True where kept, or weights between 0 and 1; None for the full sky.
    lmax
        Largest multipole, 3 nside - 1 unless given.
    bin_width
        Multipoles per bin; 1 / f_sky rounded up unless given, so 1 on the full sky.

    Returns
    -------
    AngularPower

    Raises
    ------
    InputError
        A mask of the wrong shape or that keeps nothing, or a bad bin width.
    """
    maps, weights = checked_maps(maps, mask)
    nside = sphere.nside_of(maps)
    lmax = 3 * nside - 1 if lmax is None else whole_number("lmax", lmax, 2, 3 * nside - 1)
    f_sky = weights.mean()
    if bin_width is None:
        bin_width = min(int(np.ceil(1 / f_sky)), lmax)
    bin_width = whole_number("bin_width", bin_width, 1, lmax)
    kept = weights > 0
    full = lmax if mask is None else 3 * nside - 1  # a mask mixes in power from beyond lmax
    cl = np.empty((len(maps), full + 1))
    for channel, out in zip(progress(maps, "angular spectra"), cl, strict=True):
        centred = _centred(channel, weights, kept)
        out[:] = sphere.power_spectrum(sphere.analyse(centred.astype(maps.dtype), full))
    bins = bin_matrix(full, bin_width)
    degrees = bins @ np.arange(full + 1)
    cl = cl @ bins.T if mask is None else decoupled(cl, weights, bins)
    inside = degrees <= lmax
    return AngularPower(degrees=degrees[inside], cl=cl[:, inside])


def angular_power_pair(truth, error, *, mask=None, truth_alms=None):
    """Angular power spectra of a cleaned cube and of the truth, in little more than the time of one.

    What a method leaves differs from the truth by a few spectra times maps, however many channels there are,
    so that only a few maps more are transformed: alm(recovered) = alm(truth) + spectra @ alm(maps).

    Parameters
    ----------
    truth
        (n_channels, n_pix), mK, RING.
    error
        What the cleaned cube is more, a `MapModes` of `himap.measures.difference.difference` or `condensed`:
        products are in single precision, which terms that cancel would not survive.
    mask
        As in `angular_power`.
    truth_alms
        Coefficients of the whole truth, mask or not, to 3 nside - 1, (n_channels, n_alm), where they are at
        hand: if the mask keeps most of the sky, only what it takes away is transformed, and once.

    Returns
    -------
    tuple
        Two `AngularPower`, of the recovered cube and of the truth, as `angular_power` gives them: the first,
        up to l = 2 nside, to 1 % in a single channel at a single l, and to 0.1 % in the mean over channels.

    Raises
    ------
    InputError
        As `angular_power`; coefficients or an error of another shape than the truth.
    """
    truth, weights = checked_maps(truth, mask)
    _check_error(error, truth.shape)
    if truth_alms is not None:
        checked_maps(truth, None)
        _check_alms(truth_alms, truth.shape)
    lmax = 3 * sphere.nside_of(truth) - 1
    kept = weights > 0
    variance = np.array([np.mean(_centred(pixels, weights, kept) ** 2) for pixels in truth])
    alms = _alms_of_error(error, weights, lmax, variance)
    pseudo = np.empty((2, len(truth), lmax + 1))
    for channels in progress(blocks(len(truth), _CHANNELS), "angular spectra"):
        if truth_alms is None or weights.mean() < _MOST:
            alm = _alms(truth[channels], weights)
        else:
            alm = _alms_of_most(truth[channels], weights, truth_alms[channels])
        pseudo[0, channels] = sphere.power_spectrum(alm + error.spectra[channels].astype(np.float32) @ alms)
        pseudo[1, channels] = sphere.power_spectrum(alm)
    power = _from_pseudo(np.concatenate(pseudo), weights, mask)
    return tuple(AngularPower(degrees=power.degrees, cl=cl) for cl in np.split(power.cl, 2))


def recovered_angular_power(truth_alms, error, *, mask=None):
    """The first of `angular_power_pair` where the coefficients of the truth are at hand, in place of it.

    Parameters
    ----------
    truth_alms
        Coefficients (n_channels, n_alm) of the truth as `masked_alms` has them, or what it was made from. In
        place of the truth any cube will do from which the recovered one differs by a few spectra. Without a
        mask they may end at any l, and the spectra end there.
    error, mask
        As there.

    Raises
    ------
    InputError
        A bad mask; coefficients that are not those of the channels of the error, or with a mask not to
        3 nside - 1.
    """
    n_pix = error.maps.shape[1]
    weights = mask_weights(mask, n_pix)
    if mask is not None or np.ndim(truth_alms) != 2 or len(truth_alms) != len(error.spectra):
        _check_alms(truth_alms, (len(error.spectra), n_pix))
    n_channels, n_alm = truth_alms.shape
    lmax = sphere.lmax_of_size(n_alm)
    variance = np.array([_variance(alm, lmax) for alm in truth_alms])
    alms = _alms_of_error(error, weights, lmax, variance)
    pseudo = np.empty((n_channels, lmax + 1))
    for channels in progress(blocks(n_channels, _CHANNELS), "angular spectra"):
        sums = truth_alms[channels] + error.spectra[channels].astype(np.float32) @ alms
        pseudo[channels] = sphere.power_spectrum(sums)
    return _from_pseudo(pseudo, weights, mask)


def masked_alms(maps, *, mask=None):
    """Coefficients of every channel less its mean, times the mask, to 3 nside - 1, (n_channels, n_alm).

    Maps, mask and errors as in `angular_power`; complex64 for maps in float32.
    """
    return _alms(*checked_maps(maps, mask))


def _alms(maps, weights):
    kept = weights > 0
    centred = np.array([_centred(pixels, weights, kept) for pixels in maps], dtype=maps.dtype)
    return sphere.analyse(centred)


def _alms_of_most(maps, weights, whole_alms):
    """As `_alms`, from coefficients `whole_alms` of the maps without weights, less those of what these take.

    That is little, so plain quadrature does for it; the rest has no error of quadrature at all.
    """
    alms, masked_out = whole_alms.copy(), np.empty_like(maps)
    if weights.min() == 1:
        alms[:, 0] = 0
        return alms
    kept = weights > 0
    for pixels, alm, out in zip(maps, alms, masked_out, strict=True):
        mean = np.average(pixels[kept], weights=weights[kept])
        alm[0] = np.sqrt(4 * np.pi) * (pixels.mean(dtype=np.float64) - mean)
        out[:] = (1 - weights) * (pixels - mean)
    return alms - sphere.analyse(masked_out, n_iter=0)


def _from_pseudo(pseudo, weights, mask):
    """The `AngularPower` of pseudo-C_l to 3 nside - 1, in bins as wide as the mask asks for."""
    lmax = pseudo.shape[1] - 1
    bins = bin_matrix(lmax, min(int(np.ceil(1 / weights.mean())), lmax))
    cl = pseudo @ bins.T if mask is None else decoupled(pseudo, weights, bins)
    return AngularPower(degrees=bins @ np.arange(lmax + 1), cl=cl)


def _alms_of_error(error, weights, lmax, variance):
    """Coefficients of the maps of a `MapModes`, times weights, (n_modes, n_alm) complex64.

    `variance` (n_channels,) is the mean square over the sphere of the truth, less its mean, times weights: of
    terms that are minor beside it in every channel a rough analysis will do.
    """
    kept = weights > 0
    alms = np.empty((len(error.maps), sphere.alm_size(lmax)), dtype=np.complex64)
    for spectrum, pixels, alm in zip(error.spectra.T, error.maps, alms, strict=True):
        centred = _centred(pixels, weights, kept)
        minor = (spectrum**2 * np.mean(centred**2) < _MINOR * variance).all()
        alm[:] = sphere.analyse(centred.astype(np.float32), lmax, n_iter=0 if minor else sphere.N_ITER)
    return alms


def _variance(alm, lmax):
    """Mean square over the sphere of a field given by coefficients (n_alm,)."""
    zonal = alm[: lmax + 1].real.astype(np.float64)  # those of m = 0 have no twin of negative m
    return (2 * np.vdot(alm, alm).real - zonal @ zonal) / (4 * np.pi)


def _centred(pixels, weights, kept):
    """One map times its weights, less its weighted mean; 0 where not kept."""
    mean = np.average(pixels[kept], weights=weights[kept])
    return weights * np.where(kept, pixels - mean, 0)


def checked_maps(maps, mask):
    """Maps (n_channels, n_pix) and the weights (n_pix,) of a mask; what that leaves out may be anything.

    Raises
    ------
    InputError
        Maps that are not finite where kept, or a bad mask.
    """
    shape = np.shape(maps)
    weights = mask_weights(mask, shape[-1] if shape else 0)
    return checked_cube("maps", maps, kept=None if mask is None else weights > 0), weights


def _check_error(error, shape):
    """Refuse an error that is not of this shape, (n_channels, n_pix)."""
    got = len(error.spectra), error.maps.shape[1]
    if got != shape:
        raise InputError(f"the error must have the channels and pixels of the truth, {shape}, got {got}.")


def _check_alms(truth_alms, shape):
    """Refuse coefficients that cannot be those of a cube (n_channels, n_pix), to 3 nside - 1."""
    lmax = 3 * sphere.nside_of(np.empty(shape[1], dtype=bool)) - 1
    expected = (shape[0], sphere.alm_size(lmax))
    if np.shape(truth_alms) != expected:
        raise InputError(
            f"truth_alms must have shape (n_channels, n_alm) = {expected}, got {np.shape(truth_alms)}; "
            f"analyse every channel of the truth to l = 3 nside - 1 = {lmax}."
        )


def frequency_power(maps, channel_width, *, mask=None):
    """Frequency power spectrum, averaged over lines of sight.

    ``P(k) = <|dnu FFT_nu(T - mean)|^2> / (n_channels dnu)`` at k = 2 pi n / (n_channels dnu), n from 0 to
    n_channels // 2, with the mean over the sky of each channel.

    Parameters
    ----------
    maps
        (n_channels, n_pix), mK.
    channel_width
        MHz.
    mask
        As in `angular_power`; weights count once in the mean over lines of sight.

    Returns
    -------
    FrequencyPower
    """
    maps, weights = checked_maps(maps, mask)
    if not (isinstance(channel_width, numbers.Real) and 0 < channel_width < np.inf):
        raise InputError(f"channel_width must be a positive number of MHz, got {channel_width!r}.")
    n_channels, n_pix = maps.shape
    kept = weights > 0
    inside, norm = slice(None) if kept.all() else kept, weights.sum()
    mean = np.array([channel[inside] @ weights[inside] / norm for channel in maps]).astype(maps.dtype)
    total, weights = np.zeros(n_channels // 2 + 1), weights.astype(maps.dtype)
    for block in progress(blocks(n_pix, _BLOCK), "frequency spectra"):
        lines = np.where(kept[block], maps[:, block] - mean[:, None], 0)
        modes = fft.rfft(lines, axis=0, workers=-1)
        total += (modes.real**2 + modes.imag**2) @ weights[block]
    power = total * channel_width / (n_channels * norm)
    return FrequencyPower(k=2 * np.pi * fft.rfftfreq(n_channels, channel_width), power=power)
