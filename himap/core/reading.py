"""Reading files, and plain numbers from them. Reading never executes code or blocks forever."""

import gzip
import os
import re
import stat
import warnings
import zlib
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from himap.core.errors import InputError, plain_text
from himap.core.memory import check_room

_LARGEST_TEXT = 1e8  # bytes of a table of numbers in text
_ROOM = 10  # bytes of memory for each byte of such a text
_NUMBER = re.compile(r"[-+]?[0-9]+(,[0-9]+)?")  # an integer, or with a possible decimal comma
_FORMATS = {  # (first bytes, endings of names)
    "HDF5": (b"\x89HDF\r\n\x1a\n", (".h5", ".hdf5", ".hdf", ".hd5")),
    "FITS": (b"SIMPLE  =", (".fits", ".fit", ".fits.gz", ".fits.fz")),
    "npy": (b"\x93NUMPY", (".npy",)),
}


@contextmanager
def reading(path, kind=None):
    """Context of reading `path`: every `InputError` names it, and if `kind`, a type of file, is given, errors
    of libraries for a damaged file become InputError."""
    try:
        yield
    except InputError as error:
        if plain_text(str(path)) in str(error):
            raise
        raise InputError(f"{path}: {error}") from None
    except Exception as error:
        if kind is None:
            raise
        raise InputError(
            f"{path} cannot be read as {kind} ({type(error).__name__}: {error}). Is it complete?"
        ) from None


def is_file(path):
    """Whether `path` leads to a file that is not a folder; False for an impossible name."""
    return os.path.exists(path) and not os.path.isdir(path)


def regular_file(path, kind="file"):
    """`path`, a file that can be read without blocking, as a `Path`; errors call it a `kind`.

    InputError if it does not exist or may not be read, or if it is a folder, a pipe or a device.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"the {kind} must be given by its path, got {type(path).__name__}.")
    try:
        if not str(path):
            raise FileNotFoundError
        mode = os.stat(path).st_mode
        if stat.S_ISREG(mode):
            with open(path, "rb"):
                return Path(path)
    except (OSError, ValueError) as error:
        if isinstance(error, FileNotFoundError) and not os.path.lexists(path):
            raise InputError(f"there is no {kind} {str(path)!r}.") from None
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"the {kind} {path} cannot be read ({reason}).") from None
    came = "a folder" if stat.S_ISDIR(mode) else "a pipe or a device"
    raise InputError(f"the {kind} {path} must be a file that is on disk, got {came}.")


def format_of(path):
    """ "HDF5", "FITS" or "npy", from the first bytes of a file, or else from its extension; or None."""
    import h5py  # slow, and rarely needed

    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise ValueError("opening it may wait for ever")
        with open(path, "rb") as file:
            first = file.read(9)
            if first[:2] == b"\x1f\x8b":
                with gzip.open(path) as unpacked:
                    first = unpacked.read(9)
                if not first.startswith(_FORMATS["FITS"][0]):  # only FITS is read in packed form
                    return None
            for name, (magic, _) in _FORMATS.items():
                if first.startswith(magic):
                    return name
        if h5py.is_hdf5(path):  # preceded by other bytes
            return "HDF5"
    except (OSError, EOFError, ValueError, zlib.error):
        pass  # its reader raises the error
    ending = str(path).lower().endswith
    return next((name for name, (_, endings) in _FORMATS.items() if ending(endings)), None)


def mapped_array(path):
    """The array of a .npy file, memory-mapped.

    InputError for another file, a truncated one, and arrays of objects, which could execute code.
    """
    path = regular_file(path)
    if (form := format_of(path)) in ("HDF5", "FITS"):
        raise InputError(f"{path} must be a .npy file, and is {form}.")
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # numpy evaluates the header, which raises nearly anything
        raise InputError(
            f"{path} is no .npy file of plain numbers ({type(error).__name__}: {error})."
        ) from None
    if not isinstance(array, np.ndarray):
        array.close()
        raise InputError(f"{path} is an archive of arrays (.npz); save the one that is meant as .npy.")
    return array


def read_array(path):
    """The array of a .npy file, in memory; errors as in `mapped_array`, and if it does not fit."""
    mapped = mapped_array(path)
    check_room(str(path), mapped.nbytes)
    return np.array(mapped)


def read_numbers(path):
    """Numbers from a .npy file, or a text file with columns separated by blanks or commas, float64.

    InputError if there is no such file, or it does not hold at least one real number.
    """
    path = regular_file(path)
    values = read_array(path) if format_of(path) == "npy" else _table(path)
    if values.dtype.kind not in "fiu" or not values.size:
        came = f"{values.dtype}" if values.size else "none"
        raise InputError(f"{path} must hold real numbers, got {came}.")
    return values.astype(float)


def _table(path):
    size = path.stat().st_size
    if size > _LARGEST_TEXT:
        raise InputError(f"{path} has {size / 1e6:.4g} MB of text; write that many numbers as .npy.")
    check_room(str(path), _ROOM * size)
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (UnicodeDecodeError, OSError):
        raise InputError(f"{path} is no text in UTF-8; save it as such, or as .npy.") from None
    words = [re.split(r"[\s;]+", line.partition("#")[0].strip()) for line in lines]
    words = [row for row in words if row != [""] and _NUMBER.fullmatch(row[0])]
    with_comma = [word for row in words for word in row if "," in word]
    if with_comma and all(_NUMBER.fullmatch(word) for row in words for word in row):
        first, last = np.array([(row[0].split(",") * 2)[:2] for row in words], dtype=int).T
        are_pairs = len(with_comma) == len(words) == sum(map(len, words))  # of integers, for example edges
        if not (are_pairs and ((last[:-1] == first[1:]).all() or (first[:-1] == last[1:]).all())):
            raise InputError(
                f"{path} has numbers with decimal commas, such as {with_comma[0]}: write points, "
                f"{with_comma[0].replace(',', '.')}, and blanks between columns."
            )
    try:
        with warnings.catch_warnings(action="ignore", category=UserWarning):  # for a file without numbers
            return np.loadtxt([line.replace(",", " ") for line in lines], ndmin=1)
    except ValueError as error:
        word = next(
            (line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")), ""
        )
        if not re.match(r"[-+.\d]", word):
            raise InputError(
                f"{path} must hold numbers alone, got {word[:40]!r} before them; put # in front of that line."
            ) from None
        raise InputError(f"{path} is no table of numbers ({error}).") from None
