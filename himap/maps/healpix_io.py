"""HEALPix maps in FITS files: their tables, and the conventions of headers and names.

Tables are read without healpy's reader, which uses the first of several tables, scales values before it looks
for markers of missing pixels, and counts negative pixel numbers from the end.
"""

import math
import re
from dataclasses import dataclass
from typing import NamedTuple
from warnings import catch_warnings

import healpy as hp
import numpy as np
from astropy.io import fits
from astropy.utils.exceptions import AstropyWarning

from himap.core.errors import InputError
from himap.core.memory import check_room
from himap.core.reading import reading, regular_file
from himap.maps import sphere
from himap.maps.frames import frame_cards, frame_of, is_nested

MILLIKELVIN = {"K": 1e3, "mK": 1.0, "uK": 1e-3}
"""mK in one of each unit of brightness temperature."""

_SPELLINGS = {  # both characters for mu, which look alike
    **{"k": "K", "kelvin": "K", "mk": "mK", "millikelvin": "mK", "uk": "uK", "microkelvin": "uK"},
    **{"\N{MICRO SIGN}k": "uK", "\N{GREEK SMALL LETTER MU}k": "uK"},
}
_RAYLEIGH_JEANS = re.compile(r"[ _]?\{?\(?(rj|t_?b|t_?mb)\)?\}?$")  # and main-beam temperature, treated alike
_NUMBERS = "BIJKED"  # letters of TFORM: integers and floats
_UNSEEN = 1e-5  # relative distance from healpy's UNSEEN up to which a pixel is missing
_FACTOR = {"mhz": 1.0, "ghz": 1e3}
_FREQ = re.compile(  # f950MHz is one, but not bw20MHz or 950p5MHz
    r"(?<![^\W_])(?<![.,])(?:f|freq|frequency|nu)?([0-9]+(?:\.([0-9]+))?)[ _-]?(mhz|ghz)(?![^\W_])",
    re.IGNORECASE,
)
_HERTZ = (1.0, 1e3, 1e-6)  # MHz in the possible units of a header without one: MHz, GHz, Hz
_ROUNDING = 1e-6  # relative difference up to which frequencies agree


@dataclass(frozen=True, kw_only=True)
class HealpixFile:
    """The maps of a file and the content of its header; None for what the header does not state.

    Attributes
    ----------
    maps
        Maps of the full sphere, one per column, (n, n_pix), in the ordering and units of the file; float32
        or float64, NaN in pixels without a value.
    names, units
        TTYPE and TUNIT of the column of each map, (n,).
    nested
        Whether pixels are in NESTED order.
    frame
        Coordinate frame, as returned by `himap.maps.frames.frame_of`.
    partial
        Whether the file covers a part of the sky: its first column then has pixel numbers, not a map.
    header
        All cards of the table, and those of the primary header that the table does not have, a dict.
    """

    maps: np.ndarray
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    nested: bool | None
    frame: str | None
    partial: bool
    header: dict


def read_maps(path, *, n_maps=None, held=1, logical=False):
    """Read the `HealpixFile` of a FITS file, with its first `n_maps` maps, or with all.

    Parameters
    ----------
    path, n_maps
        The file, and the number of maps to read.
    held
        Number of arrays of this size that the caller will hold: they must fit into memory.
    logical
        Whether columns may be logical, as in masks: 1 where true, 0 where false.

    Raises
    ------
    InputError
        If the file cannot be read, has maps in several tables, or too many maps; if its nside or ORDERING
        is invalid.
    """
    path = regular_file(path)
    quiet = catch_warnings(action="ignore", category=AstropyWarning)  # harmless, or followed by an error
    with reading(path, "HEALPix maps in FITS"), quiet, fits.open(path, memmap=False) as file:
        tables = [hdu for hdu in file if isinstance(hdu, fits.BinTableHDU)]
        if not tables:
            raise InputError(
                "there is no table of maps, or the file is incomplete; images in the plane are none."
            )
        lasts = [hdu.columns.dtype[-1].shape for hdu in tables]
        sizes = [hdu.header["NAXIS2"] * math.prod(shape) for hdu, shape in zip(tables, lasts, strict=True)]
        if sizes.count(sizes[0]) > 1 and n_maps is None:
            raise InputError(
                f"there are maps in {sizes.count(sizes[0])} tables; write them as columns of one, as "
                "healpy.write_map(path, maps) does."
            )
        table = tables[0]
        for one in (file[0], table):
            one.verify("silentfix+ignore")  # fixes nonstandard cards
        header = {**file[0].header, **table.header}
        keys = "PIXTYPE", "INDXSCHM", "OBJECT"
        pixels, scheme, sky = (str(card_text(header, key) or "").upper() for key in keys)
        if pixels not in ("", "HEALPIX") or scheme not in ("", "IMPLICIT", "EXPLICIT"):
            raise InputError(f"PIXTYPE = {pixels}, INDXSCHM = {scheme}: pixels must be those of HEALPix.")
        partial = scheme == "EXPLICIT" or sky == "PARTIAL"
        columns = range(1 + partial, 1 + len(table.columns))[:n_maps]  # as FITS counts, from 1
        maps = _maps_of(table, header, columns, partial, held, _NUMBERS + "L" * logical)
    return HealpixFile(
        maps=maps,
        names=tuple(str(header.get(f"TTYPE{column}")) for column in columns),
        units=tuple(card_text(header, f"TUNIT{column}") or card_text(header, "BUNIT") for column in columns),
        nested=is_nested(card_text(header, "ORDERING"), f"ORDERING in {path}"),
        frame=frame_of(header.get("COORDSYS"), header.get("EQUINOX"), f"COORDSYS in {path}"),
        partial=partial,
        header=header,
    )


def card_text(header, key):
    """The text of a card, None if it is absent or has no value."""
    return None if header.get(key) is None else str(header[key]).strip() or None


def _maps_of(hdu, header, columns, partial, held, letters):
    """The maps in some columns of a table, (n, n_pix) float32 or float64; `header` as in `HealpixFile`.

    NaN where a pixel is UNSEEN, the TNULL of its column or BAD_DATA, or has no value.
    """
    if not columns:
        raise InputError("there is no column with a map.")
    for column in hdu.columns[: columns[-1]]:
        if column.format.lstrip("0123456789") not in tuple(letters):
            raise InputError(
                f"maps are real numbers, and the column {column.name} has TFORM {column.format}."
            )
    n_pix = _n_pix(hdu, header.get("NSIDE"), columns, partial)
    check_room("it", hdu.size + 8 * held * len(columns) * n_pix)
    rows = hdu.data.view(np.ndarray)  # as they are stored: markers of missing pixels are not scaled
    stored = [rows[rows.dtype.names[n - 1]].ravel() for n in columns]
    floats = [np.result_type(values.dtype.newbyteorder("="), np.float32) for values in stored]
    if any(f"{key}{column}" in header for key in ("TSCAL", "TZERO") for column in columns):
        floats.append(np.float64)
    pixels = slice(None)
    if partial:
        pixels = rows[rows.dtype.names[0]].ravel()
        if pixels.dtype.kind not in "iu":
            raise InputError(f"its first column must be the pixel numbers, got {pixels.dtype}.")
        pixels = pixels.astype(np.int64) + int(header.get("TZERO1", 0))
        different = np.unique(pixels)
        if pixels.size and (different[0] < 0 or different[-1] >= n_pix or len(different) < len(pixels)):
            raise InputError(
                f"pixel numbers must be from 0 to {n_pix - 1}, each of them once, got {len(pixels)}, of "
                f"which {len(different)} differ, from {different[0]} to {different[-1]}."
            )
    maps = np.full((len(columns), n_pix), np.nan, dtype=np.result_type(*floats))
    for out, column, values in zip(maps, columns, stored, strict=True):
        out[pixels] = _scaled(values, header, column, maps.dtype)
    return maps


def _n_pix(hdu, nside, columns, partial):
    """Pixels of the sphere, by NSIDE in the header and the length of the columns."""
    n_rows = hdu.header["NAXIS2"]
    lengths = {int(hdu.columns[n - 1].format[:-1] or 1) * n_rows for n in columns}
    if len(lengths) > 1:
        raise InputError(f"its columns must have one length, got {sorted(lengths)}.")
    (n_pix,) = lengths
    may_be_spectra = n_pix not in (n_rows, 1024 * n_rows) and sphere.is_n_pix(n_rows)  # 1024 is usual
    if not isinstance(nside, int) and (partial or may_be_spectra):
        raise InputError(f"it must say NSIDE, a whole number, got {nside!r}.")
    n_pix = 12 * nside**2 if partial else n_pix
    right = sphere.nside_of(np.broadcast_to(0, n_pix))
    if nside is not None and str(nside).strip() not in (f"{right}", f"{right}.0"):
        raise InputError(
            f"it says NSIDE = {nside}, but its columns have {n_pix} pixels; write a column for each channel, "
            "as healpy.write_map(path, maps) does of (channels, pixels)."
        )
    return n_pix


def _scaled(stored, header, column, dtype):
    """Scaled values of a column from its stored ones; 1 or 0 for a logical column; NaN where missing."""
    is_logical = card_text(header, f"TFORM{column}").endswith("L")  # letters T and F
    values = (stored == ord("T") if is_logical else stored).astype(dtype)
    values *= dtype.type(header.get(f"TSCAL{column}", 1))
    values += dtype.type(header.get(f"TZERO{column}", 0))
    null, bad = header.get(f"TNULL{column}"), header.get("BAD_DATA")
    missing = np.abs(values - hp.UNSEEN) <= _UNSEEN * abs(hp.UNSEEN)
    if is_logical:
        missing |= stored == 0
    if null is not None:
        missing |= stored == null
    if stored.dtype.kind == "f":
        missing |= np.abs(stored.astype(dtype) - hp.UNSEEN) <= _UNSEEN * abs(hp.UNSEEN)
    if bad is not None:
        missing |= stored == stored.dtype.type(bad) if stored.dtype.kind == "f" else values == bad
    values[missing] = np.nan
    return values


def write_maps(path, maps, *, names, unit, nested, partial=False, frame=None, cards=()):
    """Write maps (n, n_pix), one per column with their precision; non-finite values become UNSEEN.

    Parameters
    ----------
    path, maps
        The file, and floats, which are changed in place: a cube may be too large for a copy.
    names, unit, nested
        Names of columns, (n,), their common unit (None for no unit), and whether pixels are NESTED.
    partial
        Whether to write only pixels with a value in any map, with their numbers (explicit indexing).
    frame
        As returned by `himap.maps.frames.frame_of`.
    cards
        Further header cards, (key, value) or (key, value, comment).
    """
    seen = np.flatnonzero(np.isfinite(maps).any(axis=0))
    maps[~np.isfinite(maps)] = hp.UNSEEN
    cards = [*frame_cards(frame), *cards]
    if not partial:
        columns = {"column_names": names, "column_units": unit, "dtype": maps.dtype}
        hp.write_map(path, maps, nest=nested, extra_header=cards, **columns)
        return
    # In healpy's files of a part of the sky, only pixels of the first map are kept.
    columns = [fits.Column(name="PIXEL", format="K", array=seen)]
    columns += [
        fits.Column(name=name, format={4: "E", 8: "D"}[maps.itemsize], unit=unit, array=pixels[seen])
        for name, pixels in zip(names, maps, strict=True)
    ]
    table = fits.BinTableHDU.from_columns(columns)
    words = {"PIXTYPE": "HEALPIX", "INDXSCHM": "EXPLICIT", "OBJECT": "PARTIAL"}
    words |= {"ORDERING": "NESTED" if nested else "RING", "NSIDE": sphere.nside_of(maps)}
    for key, *value in [*words.items(), *cards]:
        table.header[key] = tuple(value)
    table.writeto(path)


def to_ring(pixels):
    """Reorder a map from NESTED to RING, (n_pix,)."""
    return pixels[hp.ring2nest(sphere.nside_of(pixels), np.arange(len(pixels)))]


def temperature_unit(text, name="unit", where="as healpy.write_map(..., column_units='K_RJ') does"):
    """The name in `MILLIKELVIN` of a unit in any spelling: "K_RJ" is "K", "Millikelvin" is "mK".

    Case is ignored: it separates milli from mega, but nobody has maps in MK, and "MK" is written for mK.

    Raises
    ------
    InputError
        If it is not a unit of (Rayleigh-Jeans) brightness temperature; the error uses `name` for the unit,
        and `where` to say how to write it.
    """
    spelled = str(text or "").strip()
    unit = _SPELLINGS.get(_RAYLEIGH_JEANS.sub("", spelled.lower()))
    if unit is None:
        came = f"{name} {spelled!r}" if spelled else f"no {name}"
        raise InputError(
            "maps must be brightness temperatures (Rayleigh-Jeans), with a unit out of K, K_RJ, mK, mK_RJ, "
            f"uK, uK_RJ, got {came}. Convert the maps, and write them with their unit, {where}."
        )
    return unit


class Stated(NamedTuple):
    """A frequency stated in a name, in MHz, and half of its last digit."""

    freq: float
    half_digit: float


def freqs_in(name):
    """The frequencies stated in the name of a file or column, a list of `Stated`; one for a single map.

    For example map_950.5MHz.fits: a decimal in MHz or GHz between separators such as _ and -, or at an end;
    f, freq, frequency or nu may precede it (f950MHz), other letters not. A number that follows other digits,
    with only separators between, may be the end of a range (900-910MHz) or of a number (900_11MHz), and is
    ignored.
    """
    stated = []
    for match in _FREQ.finditer(name):
        start = name[: match.start()]
        before = [part for part in re.split(r"[\W_]+", start) if part]
        is_range = re.search(r"\d *- *$", start)  # also after letters, as in map900-910MHz
        if not (is_range or (before and before[-1].isdigit())):
            factor, digits = _FACTOR[match[3].lower()], len(match[2] or "")
            stated.append(Stated(float(match[1]) * factor, 0.5 * factor * 10.0**-digits))
    return stated


def freq_in_header(header, path):
    """The number in the header card FREQ, in any unit, or None; InputError if it is not a number."""
    value = header.get("FREQ")
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value)
    if "FREQ" in header and not is_number:
        raise InputError(f"FREQ in a header must be a number of MHz, got {value!r} in {path}.")
    return float(value) if is_number else None


def agreed(stated, header_freq, path):
    """The frequency in MHz from a name (`Stated`) and a header (`freq_in_header`), with the header's digits.

    The name shows whether the header is in MHz, GHz or Hz; `path` is the file, for the error.

    Raises
    ------
    InputError
        If they contradict each other.
    """
    if header_freq is None:
        return stated.freq
    values = header_freq * np.array(_HERTZ)
    close = np.abs(values - stated.freq) <= stated.half_digit + _ROUNDING * stated.freq
    if not close.any():
        raise InputError(
            f"names and headers must agree about frequencies: the name of {path} says {stated.freq:g} MHz, "
            f"and FREQ in its header {header_freq:g}. Rename the file, or correct the header."
        )
    return float(values[close.argmax()])
