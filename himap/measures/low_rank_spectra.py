"""Spectra of a cleaned cube computed from its error, recovered - truth, as a few spectra times maps.

An observation is the truth plus a few spectra times maps, and a method subtracts a few spectra times maps. So
its error is such a sum too, and means over lines of sight and C_l of the recovered cube do not require that
cube: they follow from those of the truth, of the truth with the maps of the error, and of these maps with
each other.
"""

from dataclasses import dataclass, replace

import numpy as np

from himap.core.errors import InputError
from himap.core.progress import progress
from himap.maps import sphere
from himap.maps.low_rank import LowRankCube, blocks
from himap.maps.masks import mask_weights
from himap.measures.spectra import BLOCK, checked_maps, decouple, tapered_modes, weighted

FAINT = 3e-8
"""Share of the variance of the truth, summed over channels: terms of an error below it are invisible."""

_CHANNELS = 16  # processed at a time
_MOST = 0.7  # kept share of the sky: a rough analysis of the rest changes C_l by 0.3 % at nside < l < 2 nside
_MINOR = 1e-3  # of the variance of a channel of the truth: an analysis accurate to percents suffices


def difference(recovered, truth, *, mask=None):
    """recovered - truth of two cubes (n_channels, n_pix), mK, a `LowRankCube` without its faintest terms.

    Where the `mask` (n_pix,), bool or weights, is zero, values are ignored and the maps are zero.

    Raises
    ------
    InputError
        For cubes of different shapes or not finite where kept, or an invalid mask.
    """
    (recovered, weights), (truth, _) = checked_maps(recovered, mask), checked_maps(truth, mask)
    if recovered.shape != truth.shape:
        raise InputError(f"both cubes must have one shape, got {recovered.shape} and {truth.shape}.")
    (n_channels, n_pix), kept = truth.shape, weights > 0

    def lines(block):
        error = np.subtract(recovered[:, block], truth[:, block], dtype=np.float64)
        error[:, ~kept[block]] = 0
        return error

    covariance, total, squares = np.zeros((n_channels, n_channels)), np.zeros(n_channels), 0.0
    for block in progress(blocks(n_pix), "difference to the truth"):
        error = lines(block)
        covariance += error @ error.T
        inside = truth[:, block][:, kept[block]].astype(np.float64)
        total += inside.sum(axis=1)
        squares += np.sum(inside**2)
    spread = squares - total @ total / np.count_nonzero(kept)
    values, axes = np.linalg.eigh(covariance)
    spectra = axes[:, values > FAINT * spread]
    maps = np.empty((spectra.shape[1], n_pix))
    for block in blocks(n_pix):
        maps[:, block] = spectra.T @ lines(block)
    return LowRankCube(spectra=spectra, maps=maps)


def frequency_power_without(total, removed, channel_width, cube, error=None):
    """`FrequencyPower` of a cube plus its error without some lines of sight, from `total`, that of all.

    Only the removed lines are read: their power is subtracted from a sum with a rounding error of 1e-7 of
    `total` for a float32 cube. So only the error, not the cube, may be far brighter there than elsewhere.

    Parameters
    ----------
    total
        `FrequencyPower` of the sum.
    removed
        The lines to exclude, (n_pix,) bool.
    channel_width
        MHz.
    cube, error
        (n_channels, n_pix), mK, and a `LowRankCube` or None: read on removed lines, and for channel means.

    Raises
    ------
    InputError
        If no line is kept.
    """
    (n_channels, n_pix), pixels = cube.shape, np.flatnonzero(removed)
    if not (n_kept := n_pix - len(pixels)):
        raise InputError("no line of sight is kept, so there is no mean over those.")
    means = cube.mean(axis=1, dtype=np.float64)
    if error is not None:
        means += error.spectra @ error.maps.mean(axis=1)
    squares, sums = np.zeros(len(total.k)), np.zeros(len(total.k), dtype=complex)
    for block in (pixels[part] for part in blocks(len(pixels), BLOCK)):
        lines = cube[:, block] - means[:, None]
        modes = tapered_modes(lines if error is None else lines + error.lines(block), total.taper)
        squares += np.sum(modes.real**2 + modes.imag**2, axis=1)
        sums += modes.sum(axis=1)
    # The other lines add up to -sums, and their mean must be subtracted from each.
    squares += np.abs(sums) ** 2 / n_kept
    power = (n_pix * total.power - squares * channel_width / n_channels) / n_kept
    return replace(total, power=power)


def line_errors(error):
    """Mean squared error of every line of sight, (n_pix,), mK^2 (paper, Sect. 5.1), of a `LowRankCube`.

    The mean of each channel over the sky, which no method recovers, is not counted as error.
    """
    gram = error.spectra.T @ error.spectra / len(error.spectra)
    means = error.maps.mean(axis=1, keepdims=True)
    errors = np.empty(error.maps.shape[1])
    for block in blocks(len(errors)):
        maps = error.maps[:, block] - means
        errors[block] = np.einsum("mp,mp->p", maps, gram @ maps)
    return errors


def masked_alms(maps, *, mask=None, alms=None):
    """Coefficients to 3 nside - 1 of every channel less its mean, times the mask, (n_channels, n_alm).

    Parameters
    ----------
    maps, mask
        As in `angular_power`; float32 maps give complex64.
    alms
        Coefficients of the maps without a mask, to 3 nside - 1, if known: if the mask keeps most of the
        sky, only the faint removed part is transformed, for which plain quadrature is enough. Or a
        function of a slice of channels that returns theirs, which needs no copy of them.

    Raises
    ------
    InputError
        See `angular_power`; also for coefficients that do not match the maps, or, if these are given,
        maps that are not finite everywhere.
    """
    maps, weights = checked_maps(maps, mask)
    if alms is not None:
        checked_maps(maps, None)
        if not callable(alms):
            _check_alms(alms, maps.shape)
    kind = np.result_type(maps.dtype, np.complex64)
    if alms is None or weights.mean() < _MOST:
        out = np.empty((len(maps), sphere.alm_size(3 * sphere.nside_of(maps) - 1)), dtype=kind)
        for pixels, alm in zip(progress(maps, "analysis"), out, strict=True):
            alm[:] = sphere.analyse(weighted(pixels, weights).astype(maps.dtype))
        return out
    made = alms(slice(None)) if callable(alms) else alms
    out = made.astype(np.result_type(made, kind), copy=made is alms)
    removed = np.flatnonzero(weights < 1)
    if not len(removed):
        out[:, 0] = 0
        return out
    shares, field = 1 - weights[removed], np.zeros(len(weights), dtype=maps.dtype)
    for pixels, alm in zip(progress(maps, "analysis"), out, strict=True):
        total, some = pixels.sum(dtype=np.float64), pixels[removed].astype(np.float64)
        mean = (total - shares @ some) / weights.sum()
        alm[0] = np.sqrt(4 * np.pi) * (total / len(pixels) - mean)
        field[removed] = shares * (some - mean)
        alm -= sphere.analyse(field, n_iter=0, pixels=removed)
    return out


def masked_power(alms, mask=None):
    """`AngularPower` of coefficients (n_channels, n_alm) of a cube times this mask (see `masked_alms`)."""
    if mask is None:
        return decouple(sphere.power_spectrum(alms))
    _check_alms(alms, (len(alms), len(mask)))
    return decouple(sphere.power_spectrum(alms), mask_weights(mask, len(mask)))


def recovered_power(truth_alms, error, *, mask=None, true=None):
    """Angular power spectrum of a recovered cube, from the coefficients of the truth.

    Only the few maps of the error are transformed: alm(recovered) = alm(truth) + spectra @ alm(maps).

    Parameters
    ----------
    truth_alms
        Coefficients (n_channels, n_alm) of the truth as returned by `masked_alms`, or those used to make
        it. Instead of the truth, any cube that differs from the recovered one by few spectra will do.
        Without a mask they may end at any l, and the spectra end there. Or, with `true`, a function of a
        slice of channels that returns theirs, so that those of all channels are never in memory.
    error
        recovered - truth, a `LowRankCube` from `difference` or `LowRankCube.truncate`: products are in
        single precision, so terms must not cancel.
    mask
        As in `angular_power`, the mask of `truth_alms`.
    true
        Their `AngularPower` at every l, without a mask, if known.

    Returns
    -------
    AngularPower
        As from `angular_power`, up to l = 2 nside to 1 % in a single channel at a single l, and to 0.1 %
        averaged over channels.

    Raises
    ------
    InputError
        For an invalid mask; coefficients of other channels than the error, or with a mask not to
        3 nside - 1; a function with a mask or without `true`.
    """
    n_channels, n_pix = len(error.spectra), error.maps.shape[1]
    weights, alms_of = mask_weights(mask, n_pix), truth_alms
    if not callable(truth_alms):
        if mask is not None or np.ndim(truth_alms) != 2 or len(truth_alms) != n_channels:
            _check_alms(truth_alms, (n_channels, n_pix))
        alms_of, true = truth_alms.__getitem__, true or masked_power(truth_alms)
    elif true is None or mask is not None:
        raise InputError("a function that makes coefficients needs their spectrum, true=, and takes no mask.")
    lmax, variance = len(true.degrees) - 1, true.variance
    alms = np.empty((len(error.maps), sphere.alm_size(lmax)), dtype=np.complex64)
    for spectrum, pixels, alm in zip(error.spectra.T, error.maps, alms, strict=True):
        maps = weighted(pixels, weights)
        # A rough analysis is enough for a term that is minor in every channel.
        minor = (spectrum**2 * np.mean(maps**2) < _MINOR * variance).all()
        alm[:] = sphere.analyse(maps.astype(np.float32), lmax, n_iter=0 if minor else sphere.N_ITER)
    pseudo = np.empty((n_channels, lmax + 1))
    for channels in progress(blocks(n_channels, _CHANNELS), "angular spectra"):
        recovered = alms_of(channels) + error.spectra[channels].astype(np.float32) @ alms
        pseudo[channels] = sphere.power_spectrum(recovered)
    return decouple(pseudo, None if mask is None else weights)


def _check_alms(alms, shape):
    """Refuse coefficients that cannot be those of a cube (n_channels, n_pix), to 3 nside - 1."""
    lmax = 3 * sphere.nside_of(np.empty(shape[1], dtype=bool)) - 1
    expected = (shape[0], sphere.alm_size(lmax))
    if np.shape(alms) != expected:
        raise InputError(
            f"coefficients must have shape (n_channels, n_alm) = {expected}, got {np.shape(alms)}; "
            f"analyse every channel of the truth to l = 3 nside - 1 = {lmax}."
        )


@dataclass(frozen=True, kw_only=True)
class Moments:
    """Second moments over lines of sight of a truth T and of its error, spectra times maps M.

    Attributes
    ----------
    variance
        Variance of T in every channel, (n_channels,), mK^2.
    cross
        Mean of T M, (n_channels, n_modes).
    gram
        Mean of M M^T, (n_modes, n_modes).
    spectra
        Spectra of the error, (n_channels, n_modes).
    """

    variance: np.ndarray
    cross: np.ndarray
    gram: np.ndarray
    spectra: np.ndarray

    @classmethod
    def of(cls, truth, error, *, mask=None):
        """Moments of a cube (n_channels, n_pix) and a `LowRankCube`, over the lines in `mask` (n_pix,) bool.

        Means over these lines are subtracted from both; no copy of the cube is made.
        """
        n_channels, n_pix = truth.shape
        maps = error.maps if mask is None else error.maps[:, mask]
        maps = maps - maps.mean(axis=1, keepdims=True)
        total, squares = np.zeros(n_channels), np.zeros(n_channels)
        cross = np.zeros((n_channels, len(maps)))
        start = 0
        for block in progress(blocks(n_pix, BLOCK), "moments"):
            inside = truth[:, block] if mask is None else truth[:, block][:, mask[block]]
            lines = inside.astype(np.float64)
            total += lines.sum(axis=1)
            squares += np.einsum("cp,cp->c", lines, lines)
            cross += lines @ maps[:, start : start + lines.shape[1]].T
            start += lines.shape[1]
        return cls(
            variance=squares / start - (total / start) ** 2,
            cross=cross / start,
            gram=maps @ maps.T / start,
            spectra=error.spectra,
        )

    @property
    def correlation(self):
        """Pearson r of T and of T with its error in every channel, (n_channels,) (paper, Eq. A.1).

        NaN where either is 0 everywhere.
        """
        common = np.einsum("cm,cm->c", self.spectra, self.cross)
        recovered = (
            self.variance + 2 * common + np.einsum("cm,mn,cn->c", self.spectra, self.gram, self.spectra)
        )
        size = np.sqrt(self.variance * np.maximum(recovered, 0))
        return np.divide(self.variance + common, size, out=np.full(len(size), np.nan), where=size > 0)

    def frequency_power(self, true, channel_width):
        """`FrequencyPower` of T plus its error, given that of T on the same lines of sight.

        The Fourier transform along a line is linear, also with a taper: only the transforms of the spectra
        and of the products of T with the maps are missing.
        """
        spectra, cross = (tapered_modes(one, true.taper) for one in (self.spectra, self.cross))
        more = 2 * np.einsum("km,km->k", spectra.conj(), cross).real
        more += np.einsum("km,mn,kn->k", spectra, self.gram, spectra.conj()).real
        return replace(true, power=true.power + more * channel_width / len(self.variance))
