"""HDF5 files that are locked, datasets that are packed, and attributes as text and numbers."""

import re

import h5py
import numpy as np

from himap.core.errors import InputError

_MISSING, _SCALE, _LIMITS = (  # of netCDF
    ("_FillValue", "missing_value"),
    ("scale_factor", "add_offset"),
    ("valid_min", "valid_max", "valid_range"),
)
PACKING = (*_MISSING, *_SCALE, *_LIMITS)

_FILTERS = {32001: "blosc", 32004: "lz4", 32008: "bitshuffle", 32013: "zfp", 32015: "zstd", 32026: "blosc2"}
_HELD_ELSEWHERE = (11, 13, 35)  # errno of a file that another process locks; others: the drive has no locks


def open_hdf5(path):
    """The open file called `path`; InputError with the way out where it is locked."""
    try:
        return h5py.File(path, "r")
    except OSError as error:
        number = re.search(r"unable to lock file, errno = (\d+)", str(error))
        if number is None and "already open for write" not in str(error):
            raise
        if number is not None and int(number[1]) not in _HELD_ELSEWHERE:
            raise InputError(
                f"{path} cannot be locked: its drive has no locks. If no program writes to it, set the "
                "environment variable HDF5_USE_FILE_LOCKING=FALSE and try again."
            ) from None
        raise InputError(
            f"{path} is open for writing in another program, such as a notebook: close it there "
            "(file.close()). After a program that crashed, h5clear -s makes it readable."
        ) from None


def read_stored(item, path, part=...):
    """(A part of) a dataset as it is stored; InputError where a filter it needs is not installed."""
    try:
        return item[part]
    except OSError:
        how = item.id.get_create_plist()
        filters = [how.get_filter(n) for n in range(how.get_nfilters())]
        missing = [
            _FILTERS.get(number, name.decode(errors="replace") or f"number {number}")
            for number, _, _, name in filters
            if not h5py.h5z.filter_avail(number)
        ]
        if not missing:
            raise
        raise InputError(
            f"{item.name[1:]} in {path} is compressed with a filter that is not installed here, "
            f"{', '.join(missing)}: point HDF5_PLUGIN_PATH at it (that of the package hdf5plugin is "
            "hdf5plugin.PLUGIN_PATH), or write the file again with gzip where the filter is "
            "(h5repack -f GZIP=4)."
        ) from None


def unpacked(item, label, stored, *, unsigned=False):
    """The numbers `stored` of a dataset by the conventions of netCDF: NaN where missing, scaled, shifted.

    `label` is what errors call it; `unsigned` whether its integers are, though their type is not.
    """
    stated = {key: _numbers(item, key, f"{key} of {label}") for key in PACKING}
    for key, numbers in stated.items():
        n_right = {"valid_range": 2, "missing_value": numbers.size}.get(key, 1)
        if numbers.size not in (0, n_right) or (key in _SCALE and not np.isfinite(numbers).all()):
            how_many = "two numbers" if n_right == 2 else "one number"
            raise InputError(f"{key} of {label} must be {how_many}, got {numbers}.")
    scale, offset = (next(iter(stated[key]), None) for key in _SCALE)
    if scale == 0:
        raise InputError(f"scale_factor of {label} must be a number other than 0, got 0.")
    if unsigned and stored.dtype.kind == "i":
        stored = stored.view(f"{stored.dtype.byteorder}u{stored.dtype.itemsize}")
    if not any(numbers.size for numbers in stated.values()):
        return stored
    values = stored.astype(np.result_type(stored.dtype, np.float32))
    for value in (value for key in _MISSING for value in stated[key]):
        values[stored == (stored.dtype.type(value) if stored.dtype.kind == "f" else value)] = np.nan
    for low in (*stated["valid_range"][:1], *stated["valid_min"]):
        values[stored < low] = np.nan
    for high in (*stated["valid_range"][1:], *stated["valid_max"]):
        values[stored > high] = np.nan
    values *= values.dtype.type(1 if scale is None else scale)
    values += values.dtype.type(0 if offset is None else offset)
    return values


def _numbers(item, key, label):
    """The attribute `key` of a dataset, (n,), empty where there is none."""
    if key not in item.attrs:
        return np.empty(0)
    try:
        value = np.asarray(item.attrs[key])
    except TypeError:
        value = np.empty(0)
    if not value.size or value.dtype.kind not in "fiu":
        raise InputError(f"{label} must be a number, got {item.attrs[key]!r}.")
    return value.ravel()


def has_kind(item, kinds):
    """Whether a dataset has numbers of one of these kinds, letters as of numpy."""
    try:
        return item.dtype.kind in kinds and item.shape is not None
    except TypeError:  # a type that numpy does not have
        return False


def text_of(item, *names):
    """The text of the attribute of one of these names, with an s or without, or None.

    Raises
    ------
    InputError
        Several are there, and say different things.
    """
    texts = {
        name: decoded(item.attrs[name])
        for name in item.attrs
        if {name.lower(), name.lower().removesuffix("s")} & {*names}
    }
    if len(set(texts.values())) > 1:
        both = ", ".join(f"{name} = {text!r}" for name, text in texts.items())
        raise InputError(f"attributes of {item.name} say different things: {both}. Delete what is wrong.")
    return next(iter(texts.values()), None)


def decoded(value):
    """A value as text, of bytes by UTF-8 or else Latin-1."""
    try:
        return value.decode() if isinstance(value, bytes) else str(value)
    except UnicodeDecodeError:
        return value.decode("latin-1")


def plain_value(item, name):
    """An attribute as text or a number, None if it is something else."""
    try:
        value = item.attrs[name]
    except (TypeError, OSError):  # a type that numpy does not have
        return None
    if isinstance(value, str | bytes):
        return decoded(value)
    return value.item() if isinstance(value, np.generic) else None
