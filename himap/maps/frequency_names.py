"""Frequencies that the names of files and columns state, such as map_950.5MHz.fits, by one strict rule.

A name states the frequency of a map if it has one number in MHz or GHz, written as a decimal, that stands by
itself: between separators such as _ and -, or at an end. A number with other digits before it, parted by
separators alone, may be the end of a range (900-910MHz) or of a number (900_11MHz), and states nothing.
"""

import re
from dataclasses import dataclass

import numpy as np

from himap.core.errors import InputError

_FACTOR = {"mhz": 1.0, "ghz": 1e3}
_TOKEN = re.compile(r"(?<![^\W_])(?<![.,])([0-9]+(?:\.([0-9]+))?)[ _-]?(mhz|ghz)(?![^\W_])", re.IGNORECASE)
_HERTZ = (1.0, 1e3, 1e-6)  # MHz in what a header may be in, if it does not say: MHz, GHz, Hz
_ROUNDING = 1e-6  # relative: frequencies that are told twice are the same


@dataclass(frozen=True)
class Stated:
    """A frequency that a name states, in MHz, and half of its last digit."""

    freq: float
    half_digit: float


def freqs_in(name):
    """All that a name states, a list of `Stated`; of a map it must be exactly one."""
    found = []
    for match in _TOKEN.finditer(name):
        before = [part for part in re.split(r"[\W_]+", name[: match.start()]) if part]
        if not (before and before[-1].isdigit()):
            factor, digits = _FACTOR[match[3].lower()], len(match[2] or "")
            found.append(Stated(float(match[1]) * factor, 0.5 * factor * 10.0**-digits))
    return found


def freq_in_header(header, path):
    """The card FREQ of a header, a number as it stands there, or None.

    Raises
    ------
    InputError
        It is something else.
    """
    if "FREQ" not in header:
        return None
    value = header["FREQ"]
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise InputError(f"FREQ in a header must be a number of MHz, got {value!r} in {path}.")
    return float(value)


def agreed(stated, header_freq, path):
    """The frequency in MHz that a name and a header tell, the header's digits where both do.

    Parameters
    ----------
    stated
        `Stated` of the name.
    header_freq
        `freq_in_header`, or None. The name says whether it is in MHz, GHz or Hz.
    path
        The file, for the error.

    Raises
    ------
    InputError
        They contradict each other.
    """
    if header_freq is None:
        return stated.freq
    values = header_freq * np.array(_HERTZ)
    close = np.abs(values - stated.freq) <= stated.half_digit + _ROUNDING * stated.freq
    if not close.any():
        raise InputError(
            f"names and headers must agree about frequencies: the name of {path} says {stated.freq:g} MHz, "
            f"and FREQ in its header {header_freq:g}. Rename the file, or mend the header."
        )
    return float(values[close.argmax()])
