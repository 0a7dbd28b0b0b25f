"""The order of HEALPix pixels and their coordinate frame, as given by ORDERING and COORDSYS."""

import re

from himap.core.errors import InputError

FRAMES = {"G": "Galactic", "C": "celestial", "E": "ecliptic"}
"""The frames between which healpy rotates."""

_SPELLINGS = {
    **dict.fromkeys(("G", "GAL", "GALACTIC"), "G"),
    **dict.fromkeys(("C", "Q", "CEL", "CELESTIAL", "EQ", "EQUATORIAL", "RADEC"), "C"),
    **dict.fromkeys(("J2000", "FK5", "ICRS"), "C"),  # 0.02 arcsec apart
    **dict.fromkeys(("E", "ECL", "ECLIPTIC"), "E"),
    **dict.fromkeys(("", "NONE", "UNKNOWN"), None),
}
_NOT_ROTATED = ("FK4", "FK4-NO-E", "GAPPT", "S", "H")  # also of FITS; supergalactic and helioecliptic last
_J2000 = 2000.0
_OF_EQUINOX = re.compile(r"(C)([0-9.]+)")
_EQUINOX = re.compile(r"[BJ]?([0-9]+\.?[0-9]*)")

_SPECTRAL = ("TOPOCENT", "GEOCENTR", "BARYCENT", "HELIOCEN", "LSRK", "LSRD")
_SPECTRAL += ("GALACTOC", "LOCALGRP", "CMBDIPOL", "SOURCE")
_SHORT = {  # as CASA and AIPS spell them
    **{"TOPO": "TOPOCENT", "GEO": "GEOCENTR", "BARY": "BARYCENT", "LSR": "LSRK", "GALACTO": "GALACTOC"},
    **{"LGROUP": "LOCALGRP", "CMB": "CMBDIPOL", "REST": "SOURCE"},
}


def frame_of(text, equinox=None, name="COORDSYS"):
    """The letter in `FRAMES` of a coordinate frame in any spelling; None if none is stated.

    An `equinox` other than 2000 follows the letter. For FITS frames that are not rotated, the result is their
    word in capitals. `name` is used in the error.

    Raises
    ------
    InputError
        For any other text or a number, or an invalid equinox.
    """
    word = "" if text is None else str(text).strip().upper()
    frame = _SPELLINGS.get(word, word)
    if frame not in (None, *FRAMES, *_NOT_ROTATED):
        known = ", ".join((*FRAMES, "ICRS", "FK5", *_NOT_ROTATED))
        raise InputError(f"{name} must be one of {known}, got {text!r}; correct it.")
    year = equinox_of(equinox, f"EQUINOX beside {name}")
    return f"C{year:g}" if frame == "C" and year not in (None, _J2000) else frame


def equinox_of(value, name="EQUINOX"):
    """The year of an equinox in any form, such as 2000 or J2000; None if there is none.

    Raises
    ------
    InputError
        For anything else; `name` is used in the error.
    """
    if value is None or value != value:  # NaN of astropy
        return None
    match = _EQUINOX.fullmatch(str(value).strip().upper())
    if match is None:
        raise InputError(f"{name} must be a year, such as 2000, got {value!r}; correct it.")
    return float(match[1])


def spectral_frame_of(text):
    """The FITS word for the rest frame of frequencies in any spelling, such as TOPOCENT; None if empty.

    Raises
    ------
    InputError
        For any other text, or a number.
    """
    word = "" if text is None else str(text).strip().upper()
    frame = _SHORT.get(word, word[:8])
    if frame not in ("", *_SPECTRAL):
        raise InputError(f"SPECSYS must be one of {', '.join(_SPECTRAL)}, got {text!r}; correct it.")
    return frame or None


def frame_name(frame):
    """A coordinate frame, as returned by `frame_of`, in words."""
    match = _OF_EQUINOX.fullmatch(frame or "")
    return f"celestial of {match[2]}" if match else FRAMES.get(frame, frame or "frame not stated")


def frame_cards(frame):
    """The header cards from which `frame_of` returns this frame."""
    match = _OF_EQUINOX.fullmatch(frame or "")
    return [("COORDSYS", "C"), ("EQUINOX", float(match[2]))] if match else [("COORDSYS", frame)] * bool(frame)


def is_nested(order, name="the order of pixels"):
    """Whether a text means NESTED order; None if there is none. `name` is used in the error."""
    if order is None:
        return None
    nested = {"RING": False, "NEST": True, "NESTED": True}.get(order.strip().upper())
    if nested is None:
        raise InputError(f"{name} must be RING or NESTED, got {order!r}.")
    return nested
