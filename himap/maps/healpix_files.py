"""HEALPix maps in FITS files, and the words of their headers: units, ordering, coordinates."""

import re
import warnings
from dataclasses import dataclass

import healpy as hp
import numpy as np
from astropy.io import fits
from astropy.utils.exceptions import AstropyWarning

from himap.core.errors import InputError
from himap.core.reading import regular_file
from himap.maps import sphere
from himap.maps.healpix_tables import maps_of_table, only_table

ENDINGS = (".fits", ".fit", ".fits.gz", ".fits.fz")
"""What the names of FITS files end with."""

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


def read_maps(path, *, n_maps=None, held=1):
    """The `HealpixFile` of a FITS file, with its first `n_maps` maps, or with all.

    Parameters
    ----------
    path, n_maps
        The file, and how many maps are wanted.
    held
        How many arrays of their size the caller will hold: they must fit into memory.

    Raises
    ------
    InputError
        The file cannot be read, holds more maps elsewhere, or too many; its maps have no valid nside, or its
        ORDERING is none.
    """
    path = regular_file(path)
    try:
        with warnings.catch_warnings(), fits.open(path, memmap=False) as file:
            warnings.simplefilter("ignore", AstropyWarning)  # of what is an error a line below, or harmless
            table = only_table(file, first=n_maps is not None)
            header = dict(table.header)
            partial = _text(header, "INDXSCHM") == "EXPLICIT" or _text(header, "OBJECT") == "PARTIAL"
            maps, columns = maps_of_table(table, n_maps=n_maps, partial=partial, held=held)
    except Exception as error:  # astropy raises nearly anything for a file that is something else
        reason = f"({type(error).__name__}: {error}). Write it again with healpy.write_map, whole."
        raise InputError(
            f"{path} cannot be read as HEALPix maps in FITS: its table could not be read"
            + (f"; {error}" if isinstance(error, InputError) else f" {reason}")
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


def write_maps(path, maps, *, names, unit, nested, partial=False, cards=()):
    """Write maps (n, n_pix), a column each in their precision; what is not finite becomes UNSEEN.

    Parameters
    ----------
    path, maps
        The file, and floats, changed in place: a cube may be too large for a copy.
    names, unit, nested
        The columns, (n,), their one unit (None where they have none), and whether pixels are in NESTED order.
    partial
        Whether to write only the pixels that a map has a value in, with their numbers (explicit indexing).
    cards
        Further cards of the header, (key, value) or (key, value, comment).
    """
    seen = np.flatnonzero(np.isfinite(maps).any(axis=0)) if partial else None
    maps[~np.isfinite(maps)] = hp.UNSEEN
    if partial:
        _write_partial(path, maps, seen, names=names, unit=unit, nested=nested, cards=cards)
        return
    columns = {"column_names": names, "column_units": unit, "dtype": maps.dtype}
    hp.write_map(path, maps, nest=nested, extra_header=cards, **columns)


def _write_partial(path, maps, seen, *, names, unit, nested, cards):
    """As healpy's files of a part of the sky, which have the pixels of the first map alone."""
    kind = {"f4": "E", "f8": "D"}[maps.dtype.str[1:]]
    columns = [fits.Column(name="PIXEL", format="K", array=seen)]
    columns += [
        fits.Column(name=name, format=kind, unit=unit, array=pixels[seen])
        for name, pixels in zip(names, maps, strict=True)
    ]
    table = fits.BinTableHDU.from_columns(columns)
    words = {
        "PIXTYPE": "HEALPIX",
        "ORDERING": "NESTED" if nested else "RING",
        "NSIDE": sphere.nside_of(maps),
        "INDXSCHM": "EXPLICIT",
        "OBJECT": "PARTIAL",
    }
    for key, *value in [*words.items(), *cards]:
        table.header[key] = tuple(value)
    table.writeto(path)


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
