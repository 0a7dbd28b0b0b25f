"""HEALPix maps in FITS files, and the words of their headers: units, ordering, coordinates."""

import re
from dataclasses import dataclass

import healpy as hp
import numpy as np
from astropy.io import fits

from himap.errors import InputError
from himap.maps import sphere

__all__ = [
    "MILLIKELVIN",
    "HealpixFile",
    "is_nested",
    "read_maps",
    "temperature_unit",
    "to_ring",
    "write_maps",
]

MILLIKELVIN = {"K": 1e3, "mK": 1.0, "uK": 1e-3}
"""mK in one of each unit of brightness temperature."""

_SPELLINGS = {  # both letters mu, which look alike
    **{"k": "K", "kelvin": "K", "mk": "mK", "millikelvin": "mK", "uk": "uK", "microkelvin": "uK"},
    **{"\N{MICRO SIGN}k": "uK", "\N{GREEK SMALL LETTER MU}k": "uK"},
}
_RAYLEIGH_JEANS = re.compile(r"[ _]?\{?\(?rj\)?\}?$")


@dataclass(frozen=True, kw_only=True)
class HealpixFile:
    """The maps of a file, and what its header says of them; None for what it does not.

    Attributes
    ----------
    maps
        Of the whole sphere, a column each, (n, n_pix), in the ordering and units of the file; float32 or
        float64, NaN in pixels that have no value.
    names, units
        TTYPE and TUNIT of the column of each map, (n,).
    nested
        Whether pixels are in NESTED order.
    coordinates
        COORDSYS as text: G or GALACTIC, for instance.
    partial
        Whether the file is of a part of the sky: its first column tells the pixels, and is no map.
    header
        All its cards, a dict.
    """

    maps: np.ndarray
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    nested: bool | None
    coordinates: str | None
    partial: bool
    header: dict


def read_maps(path, *, n_maps=None):
    """The `HealpixFile` of a FITS file, with its first `n_maps` maps, or with all.

    Raises
    ------
    InputError
        The file cannot be read, its maps have no valid nside, or its ORDERING is none.
    """
    columns = None if n_maps is None else range(n_maps)
    try:
        with fits.open(path, memmap=False) as file:  # healpy would leave a damaged file open
            maps, cards = hp.read_map(file, field=columns, dtype=None, nest=None, h=True)
        maps, header = np.atleast_2d(maps), dict(cards)
        partial = _text(header, "INDXSCHM") == "EXPLICIT" or _text(header, "OBJECT") == "PARTIAL"
        columns = [n + 2 if partial else n + 1 for n in range(len(maps))]  # as FITS counts them
        maps = _with_nan(maps, header, columns)
        sphere.nside_of(maps)
    except Exception as error:  # healpy and astropy raise nearly anything for a file that is something else
        raise InputError(
            f"{path} cannot be read as HEALPix maps in FITS: its table could not be read "
            f"({type(error).__name__}: {error}). Write it again with healpy.write_map, whole and of a "
            "valid nside."
        ) from error
    return HealpixFile(
        maps=maps,
        names=tuple(str(header.get(f"TTYPE{column}")) for column in columns),
        units=tuple(_text(header, f"TUNIT{column}") for column in columns),
        nested=is_nested(_text(header, "ORDERING"), f"ORDERING in {path}"),
        coordinates=_text(header, "COORDSYS"),
        partial=partial,
        header=header,
    )


def _text(header, key):
    """The text of a card, None where there is none."""
    return str(header.get(key) or "").strip() or None


def _with_nan(maps, header, columns):
    """Maps as floats, NaN where they are UNSEEN, TNULL of their column or BAD_DATA."""
    maps = maps.astype(np.result_type(maps.dtype, np.float32), copy=False)  # exact, in native byte order
    for pixels, column in zip(maps, columns, strict=True):
        markers = (header.get(f"TNULL{column}"), header.get("BAD_DATA"))
        missing = np.array([value for value in markers if value is not None], dtype=maps.dtype)
        pixels[np.isin(pixels, missing) | hp.mask_bad(pixels)] = np.nan
    return maps


def write_maps(path, maps, *, names, unit, nested, cards=()):
    """Write maps (n, n_pix), a float32 column each; what is not finite becomes UNSEEN, in `maps` as well.

    Parameters
    ----------
    path, maps
        The file, and floats, changed in place: a cube may be too large for a copy.
    names, unit, nested
        The columns, (n,), their one unit (None where they have none), and whether pixels are in NESTED order.
    cards
        Further cards of the header, (key, value) or (key, value, comment).
    """
    maps[~np.isfinite(maps)] = hp.UNSEEN
    columns = {"column_names": names, "column_units": unit, "dtype": np.float32}
    hp.write_map(path, maps, nest=nested, extra_header=cards, **columns)


def is_nested(order, name="the order of pixels"):
    """Whether a text means NESTED order; None where there is none. `name` is what an error calls it."""
    if order is None:
        return None
    nested = {"RING": False, "NEST": True, "NESTED": True}.get(order.strip().upper())
    if nested is None:
        raise InputError(f"{name} must be RING or NESTED, got {order!r}.")
    return nested


def to_ring(pixels):
    """A map in RING order of one in NESTED order, (n_pix,)."""
    out = np.empty_like(pixels)
    out[sphere.nest_to_ring(sphere.nside_of(pixels))] = pixels
    return out


def temperature_unit(text, name="unit"):
    """The name in `MILLIKELVIN` of a unit as it is spelled: "K_RJ" is "K", "Millikelvin" is "mK".

    Case is not looked at: it tells milli from mega, but nobody has maps in MK, and "MK" is written for mK.

    Raises
    ------
    InputError
        It is no unit of (Rayleigh-Jeans) brightness temperature; the error calls it `name`.
    """
    spelled = str(text or "").strip()
    unit = _SPELLINGS.get(_RAYLEIGH_JEANS.sub("", spelled.lower()))
    if unit is None:
        came = f"{name} {spelled!r}" if spelled else f"no {name}"
        raise InputError(
            "maps must be brightness temperatures (Rayleigh-Jeans), with a unit out of K, K_RJ, mK, mK_RJ, "
            f"uK, uK_RJ, got {came}. Convert the maps, and write them with their unit, as "
            "healpy.write_map(..., column_units='K_RJ') does."
        )
    return unit
