"""Names of the files in a folder: their order, and whether their numbers fit the frequencies of channels."""

import re

import numpy as np

from himap.core.errors import InputError
from himap.core.reading import format_of
from himap.maps.healpix_io import agreed, freqs_in
from himap.removal.gnilc import LINE

_DIGITS = re.compile(r"([0-9]+)")
_DECIMALS = re.compile(r"([0-9]+(?:[.,p][0-9]+)?)")
LISTED = 10  # files in a message
_IN_NAMES = (1.0, 1e3, 1e-3, 1e-6)  # MHz in what names may be in: MHz, GHz, kHz, Hz
_SHARE = 0.6  # of a channel, that a number in a name may be from its centre: names may have its edge


def fits_in(folder):
    """The FITS files in a folder in the order of their names, and a sentence on others, if any, in a list."""
    try:
        entries = sorted(folder.iterdir())
    except OSError as error:
        raise InputError(f"the folder {folder} cannot be read ({error.strerror}).") from None
    paths = [path for path in entries if format_of(path) == "FITS" and not path.name.startswith(".")]
    if not paths:
        raise InputError(f"the folder {folder} holds no FITS file.")
    paths.sort(key=lambda path: _by_numbers(path.name))
    others = [path.name for path in entries if path not in paths]
    more = ", ..." if len(others) > LISTED else ""
    listing = f"{', '.join(others[:LISTED])}{more}"
    return paths, [f"{len(others)} more in the folder, no maps, left out: {listing}."] if others else []


def _numbers_in(name, pattern=_DECIMALS):
    """A name as [text, number, text, ...]; numbers as decimals or, with `_DIGITS`, as digits alone."""
    parts = pattern.split(name)
    return [float(re.sub("[p,]", ".", part)) if n % 2 else part for n, part in enumerate(parts)]


def _by_numbers(name):
    """What names are sorted by: the numbers in them."""
    return _numbers_in(name), _numbers_in(name, _DIGITS)


def unlike_names(names):
    """A sentence on names of files that are unlike most but for their numbers, or nothing."""
    kinds = [tuple(_numbers_in(name, _DIGITS)[::2]) for name in names]
    if not names or len(set(kinds)) == len(kinds):
        return ""
    most = max(kinds, key=kinds.count)
    others = [name for name, kind in zip(names, kinds, strict=True) if kind != most]
    return f"Not named as most of the files: {', '.join(others[:3])}{', ...' * (len(others) > 3)}. " * (
        0 < len(others) < len(names) / 2
    )


def check_names(names, freqs):
    """Refuse frequencies (n,), MHz, that are given to files in another order than their names have.

    Names that have a number each near the frequencies, in any unit of these or as redshifts, must have that
    of their own; names whose order depends on how decimals are written, or on which of several numbers
    counts, must have such numbers.

    Raises
    ------
    InputError
        They do not.
    """
    split = [_numbers_in(name) for name in names]
    alike = len({tuple(parts[::2]) for parts in split}) == 1
    step = np.median(np.abs(np.diff(np.sort(freqs)))) if len(freqs) > 1 else 0.0
    near = []
    columns = np.array([parts[1::2] for parts in split]).T if alike else ()
    for column in columns:
        may_be = [(factor * column, _SHARE * step) for factor in _IN_NAMES]
        for numbers, reach in (*may_be, (LINE / (1 + column), np.inf)):  # redshifts are rounded more
            if len({*numbers}) == len(names) and np.median(np.abs(np.sort(numbers) - np.sort(freqs))) <= step:
                near.append((numbers, reach))
    for numbers, reach in near:
        other = (np.argsort(numbers) != np.argsort(freqs)) | (np.abs(numbers - freqs) > reach)
        if other.any():
            n = int(other.argmax())
            raise InputError(
                f"--freqs are given to the files in the order of their names, and {names[n]} would have "
                f"{freqs[n]:.10g} MHz: sort --freqs as the numbers in the names are, or rename the files."
            )
    of_each = [column for column in columns if len({*column}) == len(names)]
    if not near and not all((np.diff(one) > 0).all() for one in of_each):
        raise InputError(
            f"the files would be in the order {', '.join(names[:3])}, ..., by the first number that differs, "
            "and another, which each has its own of, says another order: rename the files, or move what is "
            "alike in several to the end of their names."
        )
    pairs = sorted(names, key=lambda name: _numbers_in(name, _DIGITS))
    if not near and pairs != list(names):
        n = next(n for n, name in enumerate(names) if name != pairs[n])
        raise InputError(
            f"whether {names[n]} comes before {pairs[n]} cannot be known, for their numbers may be decimals "
            "or not: write them with as many digits in all names."
        )


def stated_freqs(names, called, in_headers=(), paths=()):
    """What a `Layout` has of frequencies, a dict: those in all names, or in all headers; if both, they agree.

    Where there are none, a sentence on a name that seems to state one.
    """
    stated = [freqs_in(name) for name in names]
    if all(len(found) == 1 for found in stated):
        if not in_headers:
            return {"freqs": np.array([name.freq for (name,) in stated]), "freqs_from": called}
        both = zip(stated, in_headers, paths, strict=True)
        return {
            "freqs": np.array([agreed(*name, freq, path) for name, freq, path in both]),
            "freqs_from": called,
        }
    if in_headers and None not in in_headers:
        return {"freqs": np.array(in_headers), "freqs_from": "FREQ in the headers"}
    without = [name for name, found in zip(names, stated, strict=True) if not found]
    if 0 < len(without) < len(names) / 2:
        listing = ", ".join(without[:LISTED])
        return {"nearly": f"Most of {called} state one, but not {listing}: rename these, or move them away."}
    for name, found in zip(names, stated, strict=True):
        if "hz" in name.lower() and len(found) != 1:
            return {
                "nearly": f"The name {name!r} is not taken for one: it must have one number in MHz or GHz "
                "that stands by itself, such as map_950.5MHz.fits."
            }
    return {}
