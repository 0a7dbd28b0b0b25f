"""Checks of user input; each raises `InputError` with the value received and a way out."""

import numbers
import sys
from dataclasses import MISSING, field, fields

import numpy as np

from himap.core.errors import InputError, nearest

_LARGEST = 1e15  # mK; larger values are no sky: healpy marks missing pixels with -1.6e30
_UNEVEN = 1.01  # largest spacing of neighbouring channels over the smallest


def real_array(label, values):
    """`values` as an array of real numbers, astropy temperatures in mK; not masked, ragged or complex."""
    if getattr(getattr(values, "unit", None), "physical_type", "") == "temperature":
        values = _in_unit(label, values, "mK")
    if np.ma.is_masked(values):
        raise InputError(f"{label} has masked values; fill them first, as with values.filled(...).")
    try:
        values = np.asarray(values)
    except ValueError:
        raise InputError(f"{label} must be one array, got rows of unequal length.") from None
    if values.dtype.kind not in "fiu":
        raise InputError(f"{label} must be real numbers, got {values.dtype}.")
    return values


def checked_cube(label, maps, *, min_channels=1, kept=None):
    """`maps` as an array (n_channels, n_pix), float32 or float64, finite where `kept` is True.

    `kept` is (n_pix,) or (n_channels, n_pix), None for everywhere. float32 is returned without a copy;
    everything else becomes float64.
    """
    maps = real_array(label, maps)
    if maps.ndim != 2 or len(maps) < min_channels or maps.shape[1] < 1:
        channels = f" with {min_channels} or more channels" if min_channels > 1 else ""
        raise InputError(f"{label} must have shape (n_channels, n_pix){channels}, got {maps.shape}.")
    if maps.dtype != np.float32:
        maps = maps.astype(np.float64, copy=False)
    rows = np.broadcast_to(True if kept is None else kept, maps.shape)
    n_bad = 0
    for pixels, inside in zip(maps, rows, strict=True):
        if not (pixels.min() > -_LARGEST and pixels.max() < _LARGEST):  # so too if there is a NaN
            n_bad += np.count_nonzero(~(np.abs(pixels) < _LARGEST) & inside)
    if n_bad:
        raise InputError(
            f"{label} must be finite everywhere, got {n_bad} NaN, infinite or UNSEEN pixels; fill or cut "
            "them first."
        )
    return maps


def in_mhz(freqs):
    """Frequencies as numbers in MHz; also accepts an astropy quantity."""
    return _in_unit("freqs", freqs, "MHz") if hasattr(freqs, "to_value") else freqs


def _in_unit(label, values, unit):
    """The numbers of an astropy quantity in a unit."""
    try:
        return values.to_value(unit)
    except ValueError as error:  # UnitConversionError is one
        raise InputError(f"{label} must have a unit that is one of {unit} ({error}).") from None


def checked_freqs(freqs, n_channels):
    """Channel centres in MHz, (n_channels,) float64, positive and ascending; accepts astropy quantities."""
    freqs = real_array("freqs", in_mhz(freqs)).astype(float)
    if freqs.shape != (n_channels,):
        raise InputError(f"freqs must be one MHz value per channel, ({n_channels},), got {freqs.shape}.")
    if not n_channels or not (np.isfinite(freqs) & (freqs > 0)).all():
        raise InputError("freqs must be positive and finite, in MHz, of one channel or more.")
    if not (np.diff(freqs) > 0).all():
        raise InputError("freqs must be ascending, in MHz; sort the channels and maps together.")
    if not 10 < freqs[0] <= freqs[-1] < 1e5:
        raise InputError(f"freqs are in MHz; {freqs[0]:g} to {freqs[-1]:g} looks like another unit.")
    return freqs


def evenly_spaced(freqs):
    """Whether channels (n_channels,), two or more, ascending, have equal spacing to 1 %."""
    steps = np.diff(freqs)
    return steps.max() <= _UNEVEN * steps.min()


def checked_beams(label, beams, n_channels):
    """b_l of every channel, (n_channels, lmax + 1) float64, finite and above zero."""
    beams = real_array(label, beams).astype(float)
    if beams.ndim != 2 or len(beams) != n_channels or beams.shape[1] < 2:
        wanted = f"({n_channels}, lmax + 1) with lmax of 1 or more"
        raise InputError(f"{label} must be b_l of shape {wanted}, got {beams.shape}.")
    bad = np.argwhere(~((beams > 0) & np.isfinite(beams)))
    if len(bad):
        channel, degree = bad[0]
        raise InputError(
            f"{label} must be finite and above zero, got {beams[channel, degree]} in channel {channel} at "
            f"l = {degree} and {len(bad) - 1} more like it; end the b_l below that l."
        )
    return beams


def checked_noise(label, noise, n_channels=None):
    """`noise` per pixel, mK, finite and above zero: a float, a tuple with one for each channel, or None."""
    if noise is None:
        return None
    values = real_array(label, noise)
    if values.ndim > 1 or not ((values > 0) & (values < np.inf)).all():
        raise InputError(f"{label} must be above zero, in mK per pixel, got {noise!r}.")
    if values.ndim and n_channels not in (None, len(values)):
        raise InputError(
            f"{label} must be one value or {n_channels}, one for each channel, got {len(values)}."
        )
    return tuple(values.tolist()) if values.ndim else float(values)


def whole_number(label, value, low, high):
    """`value` as an int between `low` and `high`, both included."""
    is_whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    if not is_whole or not low <= value <= high:
        raise InputError(f"{label} must be a whole number between {low} and {high}, got {value!r}.")
    return int(value)


def power_of_two(label, value, low, high):
    """`value` as an int between `low` and `high`, both included, and a power of two."""
    value = whole_number(label, value, low, high)
    if value & (value - 1):
        below = 2 ** (value.bit_length() - 1)
        raise InputError(f"{label} must be a power of two, got {value}; try {below} or {2 * below}.")
    return value


def parameter(default=MISSING, help="", *, minimum=None, maximum=None, above=False, choices=(), off=MISSING):
    """A dataclass field with a help text and valid values; without a default it must be given.

    Limits of a number are inclusive, except the lower one with `above`; `choices` are the valid values. With
    the value `off`, results are as before this field existed: it then enters no key of a product, so results
    computed earlier stay valid.
    """
    limits = {"minimum": minimum, "maximum": maximum, "above": above, "choices": choices}
    limits |= {} if off is MISSING else {"off": off}
    return field(default=default, metadata={"help": help, **limits})


def fields_on(instance):
    """Pairs of fields of a dataclass and their values, without fields at their `off` value."""
    pairs = ((item, getattr(instance, item.name)) for item in fields(instance))
    return [(item, one) for item, one in pairs if "off" not in item.metadata or one != item.metadata["off"]]


def with_fields(kind, values):
    """Make the dataclass of parameters `kind` from {field: value}; InputError for unknown fields."""
    known = [item.name for item in fields(kind)]
    if unknown := [f"{name}{nearest(name, known)}" for name in values if name not in known]:
        raise InputError(f"{kind.__name__} has no field {', '.join(unknown)}; it has {', '.join(known)}.")
    return kind(**values)


def checked_fields(instance):
    """Convert every field of a frozen dataclass, each a `parameter`, to its type; check limits or choices.

    Fields without choices and of types other than int, float and bool must be checked by their class.
    """
    for item in fields(instance):
        value, choices = getattr(instance, item.name), item.metadata["choices"]
        if choices and not any(type(value) is type(choice) and value == choice for choice in choices):
            *others, last = map(str, choices)
            raise InputError(f"{item.name} must be {', '.join(others)} or {last}, got {value!r}.")
        if item.type is bool and not isinstance(value, bool | np.bool_):
            raise InputError(f"{item.name} must be True or False, got {value!r}.")
        if choices or item.type not in (int, float):
            continue
        label = f"{item.name} ({item.metadata['help']}) must be"
        is_number = isinstance(value, numbers.Real) and not isinstance(value, bool)
        is_finite = is_number and abs(value) <= sys.float_info.max
        if not is_finite or (item.type is int and value != int(value)):
            kind = {int: "a whole number", float: "a number"}[item.type]
            raise InputError(f"{label} {kind}, got {value!r}.")
        low, high, above = (item.metadata[key] for key in ("minimum", "maximum", "above"))
        too_low = low is not None and (value < low or (above and value == low))
        if too_low or (high is not None and value > high):
            bounds = [f"{'above' if above else 'at least'} {low}"] * (low is not None)
            bounds += [f"at most {high}"] * (high is not None)
            raise InputError(f"{label} {' and '.join(bounds)}, got {value}.")
        object.__setattr__(instance, item.name, item.type(value))
