"""HDF5 files that are locked, and datasets that are packed in a way that is not known here."""

import re

import h5py

from himap.core.errors import InputError

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
