"""What the maps of a cube of one's own see, and what is odd about them."""

import numpy as np

from himap.core.checks import checked_freqs, evenly_spaced
from himap.core.errors import InputError
from himap.cubes.layout import LARGEST
from himap.maps.blocked import precision


def seen_everywhere(maps, order, remarks):
    """Of the channels in `order` those that see anything, and the pixels that all of these see."""
    channels, mask = [], np.ones(maps.shape[1], dtype=bool)
    for place in order:
        seen = np.abs(wide(maps[place])) < LARGEST  # False for NaN
        if seen.any():
            channels.append(place)
            mask &= seen
    _check_channels(len(channels), len(maps), remarks)
    return np.array(channels), mask


def seen_somewhere(weights, order, remarks):
    """Of the channels in `order` those that have any weight, and the pixels that some of these see."""
    channels = np.array([place for place in order if weights[place].any()], dtype=int)
    _check_channels(len(channels), len(weights), remarks)
    return channels, weights.any(axis=0)


def _check_channels(n_seeing, n_channels, remarks):
    if n_seeing < 2:
        raise InputError(f"a cube needs two channels with seen pixels, got {n_seeing} of {n_channels}.")
    if n_seeing < n_channels:
        remarks.append(f"{n_channels - n_seeing} of {n_channels} channels see nothing and are left out.")


def wide(pixels):
    """Pixels in float32 or float64: float16 ends at 65504, and longer floats take room."""
    wide = np.result_type(pixels.dtype, np.float32) != np.float32
    return pixels.astype(np.float64 if wide else np.float32, copy=False)


def cube_floats(maps, channels, mask, factor):
    """float32, or float64 for maps that have these digits and need them; `factor` makes them mK."""
    if np.result_type(maps.dtype, np.float32) == np.float32:
        return np.float32
    squares = (np.mean(np.square(maps[place][mask], dtype=np.float64)) for place in channels)
    return precision(factor * np.sqrt(max(squares)))


def own_freqs(freqs):
    """Ascending frequencies; which of them are equal, if some are."""
    twice = freqs[1:][np.diff(freqs) == 0]
    if len(twice):
        raise InputError(f"two channels have the frequency {twice[0]:g} MHz; leave one of them out.")
    return checked_freqs(freqs, len(freqs))


def look_at(maps, freqs, remarks):
    """Say what is odd about a cube, and may be a mistake: zeros, constant channels, uneven ones."""
    if not maps.any():
        raise InputError("all maps are zero.")
    constant = [freq for freq, pixels in zip(freqs, maps, strict=True) if pixels.min() == pixels.max()]
    if constant and maps.shape[1] > 1:
        names = ", ".join(f"{freq:g}" for freq in constant[:5])
        remarks.append(f"{len(constant)} channels have one value everywhere, as dead ones: {names} MHz.")
    empty = np.mean(~maps.any(axis=0))
    if empty:
        remarks.append(f"{empty:.1%} of the pixels are 0 in all channels; make them NaN if they are missing.")
    if not evenly_spaced(freqs):
        steps = np.diff(freqs)
        remarks.append(
            f"channels are {steps.min():g} to {steps.max():g} MHz apart; P(k) takes them as evenly spaced."
        )
