"""Foreground emission as power laws in frequency (paper, Eqs. 1, 2 and 5)."""

import itertools
from dataclasses import dataclass
from math import factorial

import numpy as np

_TOLERANCE = 1e-12  # of the brightness: far below the last digit of float32 maps


@dataclass(frozen=True, kw_only=True)
class PowerLaw:
    """One component, T(nu, p) = amplitude(p) (nu / freq_ref)^index(p).

    Parameters
    ----------
    name
        Name in labels and messages.
    amplitude
        Brightness temperature at `freq_ref`, mK (Rayleigh-Jeans), shape (n_pix,), RING, Galactic.
    freq_ref
        Reference frequency, MHz.
    index
        Spectral index, a number or shape (n_pix,); before `small_scales.refine_template` a map of any nside.
    """

    name: str
    amplitude: np.ndarray
    freq_ref: float
    index: np.ndarray | float

    def map(self, freq):
        """The component at `freq` (MHz), mK, shape (n_pix,), float64."""
        return self.amplitude * (freq / self.freq_ref) ** self.index


def emission_modes(components, freqs):
    """The sum of `components` as a short sum of spectra times maps.

    It is exact to 1e-11 of the brightest pixel at 900 to 1400 MHz, and to 1e-9 from 240 MHz on.

    With x = ln(nu / nu_0) from the middle of the band and beta the middle of the range of the index, (nu /
    nu_0)^index = (nu / nu_0)^beta sum_n x^n (index - beta)^n / n!, which converges after about ten terms. So
    linear operations, such as a transform, need not be repeated for each channel.

    Returns
    -------
    spectra
        (n_channels, n_modes).
    maps
        mK, (n_modes, n_pix).
    """
    freqs = np.asarray(freqs, dtype=float)
    middle = np.sqrt(freqs[0] * freqs[-1])
    x = np.log(freqs / middle)
    spectra, maps = [], []
    for component in components:
        low, high = np.min(component.index), np.max(component.index)
        centre, term = 0.5 * (low + high), np.exp(x * 0.5 * (low + high))
        pixels = component.map(middle)
        for order in itertools.count(1):
            spectra.append(term)
            maps.append(pixels)
            term, pixels = term * x / order, pixels * (component.index - centre)
            if (np.abs(x).max() * 0.5 * (high - low)) ** order <= _TOLERANCE * factorial(order):
                break
    # Use as few terms as the sum needs: similar components share theirs.
    axes, triangle = np.linalg.qr(np.stack(maps).T)
    left, size, right = np.linalg.svd(np.stack(spectra, axis=1) @ triangle.T, full_matrices=False)
    kept = size > 0.1 * _TOLERANCE * size[0]  # faint pixels keep their digits, too
    return left[:, kept] * size[kept], right[kept] @ axes.T


def emission_maps(components, freqs):
    """The sum of `components` at `freqs` (MHz): maps in mK, (n_channels, n_pix), float32.

    Each channel is summed in float64 and evaluated at its centre: over a channel of width w the mean of
    a power law differs by w^2/24 d2T/dnu2, for 5 MHz and index -3 by 1.5e-5 of T, smoothly in frequency.
    """
    maps = np.empty((len(freqs), len(components[0].amplitude)), dtype=np.float32)
    for freq, out in zip(freqs, maps, strict=True):
        out[:] = sum(component.map(freq) for component in components)
    return maps
