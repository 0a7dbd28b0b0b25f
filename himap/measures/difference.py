"""What a cleaned cube differs from the truth by, and all that follows from it along lines of sight.

An observation is the truth and a few spectra times maps, and a method takes a few spectra times maps away. So
its error is such a sum too, and means over lines of sight of what is left need no cube of it: they follow
from those of the truth, of the truth with the maps of the error, and of these with each other.
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft

from himap.core.errors import InputError
from himap.core.progress import progress
from himap.maps.blocked import blocks
from himap.maps.modes import MapModes
from himap.measures.power_spectra import FrequencyPower, checked_maps

_BLOCK = 4096  # lines of sight at a time: their float64 copy stays small

FAINT = 3e-8
"""Of the variance of the truth, summed over channels: terms of an error that no spectrum shows."""


def difference(recovered, truth, *, mask=None):
    """recovered - truth of two cubes (n_channels, n_pix), mK, a `MapModes` without its faintest terms.

    Where the `mask` (n_pix,), bool or weights, is zero, both may be anything and the maps are zero.

    Raises
    ------
    InputError
        Cubes of different shapes or that are not finite where kept, or a bad mask.
    """
    (recovered, weights), (truth, _) = checked_maps(recovered, mask), checked_maps(truth, mask)
    if recovered.shape != truth.shape:
        raise InputError(f"both cubes must have one shape, got {recovered.shape} and {truth.shape}.")
    (n_channels, n_pix), kept = truth.shape, weights > 0

    def lines(block):
        wrong = np.subtract(recovered[:, block], truth[:, block], dtype=np.float64)
        wrong[:, ~kept[block]] = 0
        return wrong

    covariance, total, squares = np.zeros((n_channels, n_channels)), np.zeros(n_channels), 0.0
    for block in progress(blocks(n_pix), "difference to the truth"):
        wrong = lines(block)
        covariance += wrong @ wrong.T
        inside = truth[:, block][:, kept[block]].astype(np.float64)
        total += inside.sum(axis=1)
        squares += np.sum(inside**2)
    spread = squares - total @ total / np.count_nonzero(kept)
    values, axes = np.linalg.eigh(covariance)
    spectra = axes[:, values > FAINT * spread]
    maps = np.empty((spectra.shape[1], n_pix))
    for block in blocks(n_pix):
        maps[:, block] = spectra.T @ lines(block)
    return MapModes(spectra=spectra, maps=maps)


def line_errors(error):
    """Mean squared error of every line of sight, (n_pix,), mK^2 (paper, Sect. 5.1), of a `MapModes`.

    The mean of each channel over the sky, which no method recovers, is no error.
    """
    gram = error.spectra.T @ error.spectra / len(error.spectra)
    means = error.maps.mean(axis=1, keepdims=True)
    errors = np.empty(error.maps.shape[1])
    for block in blocks(len(errors)):
        maps = error.maps[:, block] - means
        errors[block] = np.einsum("mp,mp->p", maps, gram @ maps)
    return errors


@dataclass(frozen=True, kw_only=True)
class Moments:
    """Second moments over lines of sight of a truth T and of its error, spectra times maps M.

    Attributes
    ----------
    variance
        Of T in every channel, (n_channels,), mK^2.
    cross
        Mean of T M, (n_channels, n_modes).
    gram
        Mean of M M^T, (n_modes, n_modes).
    spectra
        Of the error, (n_channels, n_modes).
    """

    variance: np.ndarray
    cross: np.ndarray
    gram: np.ndarray
    spectra: np.ndarray

    @classmethod
    def of(cls, truth, error, *, mask=None):
        """Of a cube (n_channels, n_pix) and a `MapModes`, over the lines in `mask` (n_pix,) bool.

        Both less their means over these lines; no copy of the cube is made.
        """
        n_channels, n_pix = truth.shape
        maps = error.maps if mask is None else error.maps[:, mask]
        maps = maps - maps.mean(axis=1, keepdims=True)
        total, squares = np.zeros(n_channels), np.zeros(n_channels)
        cross = np.zeros((n_channels, len(maps)))
        start = 0
        for block in progress(blocks(n_pix, _BLOCK), "moments"):
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

        NaN where nothing of T is left.
        """
        common = np.einsum("cm,cm->c", self.spectra, self.cross)
        recovered = (
            self.variance + 2 * common + np.einsum("cm,mn,cn->c", self.spectra, self.gram, self.spectra)
        )
        size = np.sqrt(self.variance * np.maximum(recovered, 0))
        return np.divide(self.variance + common, size, out=np.full(len(size), np.nan), where=size > 0)

    def frequency_power(self, true, channel_width):
        """`FrequencyPower` of T with its error, from that of T on the same lines of sight.

        The Fourier transform along a line is linear: what it makes of the products of T with the maps, and of
        the spectra, is all that the power lacks.
        """
        spectra, cross = fft.rfft(self.spectra, axis=0), fft.rfft(self.cross, axis=0)
        more = 2 * np.einsum("km,km->k", spectra.conj(), cross).real
        more += np.einsum("km,mn,kn->k", spectra, self.gram, spectra.conj()).real
        return FrequencyPower(k=true.k, power=true.power + more * channel_width / len(self.variance))
