"""The order of HEALPix pixels and the frame of their coordinates, as ORDERING and COORDSYS name them."""

import re

from himap.core.errors import InputError

FRAMES = {"G": "Galactic", "C": "celestial", "E": "ecliptic"}
"""The frames that healpy rotates into each other."""

_SPELLINGS = {
    **dict.fromkeys(("G", "GAL", "GALACTIC"), "G"),
    **dict.fromkeys(("C", "Q", "CEL", "CELESTIAL", "EQ", "EQUATORIAL", "RADEC"), "C"),
    **dict.fromkeys(("J2000", "FK5", "ICRS"), "C"),  # 0.02 arcsec apart
    **dict.fromkeys(("E", "ECL", "ECLIPTIC"), "E"),
    **dict.fromkeys(("", "NONE", "UNKNOWN"), None),
}
_J2000 = 2000.0
_OF_EQUINOX = re.compile(r"(C)([0-9.]+)")


def frame_of(text, equinox=None):
    """The letter in `FRAMES` of a frame of coordinates as it is spelled; None where none is named.

    With an `equinox` that is not 2000, behind that letter; any other text as it is, in capitals.
    """
    word = str(text or "").strip().upper()
    frame = _SPELLINGS.get(word, word)
    is_other = isinstance(equinox, int | float) and frame == "C" and abs(equinox - _J2000) > 0  # not NaN
    return f"C{equinox:g}" if is_other else frame


def frame_name(frame):
    """A frame of coordinates as of `frame_of`, for a sentence."""
    match = _OF_EQUINOX.fullmatch(frame or "")
    return f"celestial of {match[2]}" if match else FRAMES.get(frame, frame or "frame not stated")


def frame_cards(frame):
    """The cards of a header that `frame_of` makes this frame of."""
    match = _OF_EQUINOX.fullmatch(frame or "")
    return [("COORDSYS", "C"), ("EQUINOX", float(match[2]))] if match else [("COORDSYS", frame)] * bool(frame)


def is_nested(order, name="the order of pixels"):
    """Whether a text means NESTED order; None where there is none. `name` is what an error calls it."""
    if order is None:
        return None
    nested = {"RING": False, "NEST": True, "NESTED": True}.get(order.strip().upper())
    if nested is None:
        raise InputError(f"{name} must be RING or NESTED, got {order!r}.")
    return nested
