"""What was made of a cube, written as it was given: HDF5, FITS or .npy, whole files or none."""

import json
import os
import re
import tempfile
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

import h5py
import numpy as np

from himap import __version__
from himap.core.errors import InputError
from himap.core.files import check_free, whole_files
from himap.core.reading import there_is

OUTPUTS = (".h5", ".fits", ".npy")

_AROUND = 20_000  # bytes of HDF5 around the maps, and of the mixing matrix


def check_cube_output(path, *, overwrite, inputs=(), endings=(".html",)):
    """`path` as one that can be written, or an error before the work begins.

    `endings` are those of what is written beside it under its name.

    Raises
    ------
    InputError
        Another ending, a folder that cannot be written to, a file that is there and not to be overwritten, or
        one of `inputs`, which never is.
    """
    path = _checked_name(path)
    _check_place([*files_of(path), *map(path.with_suffix, endings)], overwrite, inputs)
    return path


def check_page(path, *, overwrite, inputs=(), endings=()):
    """`path` as one that a page can be written to; `endings` and errors as of `check_cube_output`."""
    path = Path(path)
    if path.suffix != ".html":
        raise InputError(f"the page is a .html file, got {path}.")
    _check_place([path, *map(path.with_suffix, endings)], overwrite, inputs)
    return path


def _checked_name(path):
    path = Path(path)
    if path.suffix not in OUTPUTS:
        raise InputError(f"the output is a {', '.join(OUTPUTS[:-1])} or {OUTPUTS[-1]} file, got {path}.")
    return path


def _check_place(paths, overwrite, inputs=()):
    folder = _real(paths[0].parent)
    try:  # what the permissions promise is not always so
        with tempfile.TemporaryFile(dir=folder):
            pass
        for path in paths:
            _real(path).exists()  # raises for a name that none can have
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"the output {paths[0]} cannot be written ({reason}): is {folder} a folder that can be, and the "
            "name one that a file can have?"
        ) from None
    originals = {_real(path) for path in inputs if there_is(path)}
    for path in paths:
        if originals & {_real(path), folder}:
            raise InputError(f"{path} would change what it is made from; choose another output.")
    check_free(paths, overwrite=overwrite)


def _real(path):
    """Where links lead to; also for a loop of links, which leads nowhere."""
    return Path(os.path.realpath(path))


def files_of(path):
    """All files that a cleaned cube is written to, `path` first."""
    if path.suffix == ".h5":
        return [path]
    endings = (f"_foreground{path.suffix}", "_mixing.txt")
    return [path, *(path.with_name(path.stem + ending) for ending in endings)]


def save_cleaned(cleaned, path, *, overwrite=False):
    """Write a `CleanedCube`: residual, foreground and mixing matrix.

    Channels, pixels and units are as in the file that the cube came from, and so is the header of an image;
    pixels that were not seen are NaN (of HEALPix in FITS: UNSEEN). Of a voxel that was missing the residual
    is NaN, the foreground what was found of it. An HDF5 file holds it all; beside FITS and .npy there are
    NAME_foreground and NAME_mixing.txt.

    Returns
    -------
    list
        The paths that were written.

    Raises
    ------
    InputError
        Another ending than .h5, .fits or .npy, or a file that is there already, without `overwrite`.
    """
    path = _checked_name(path)
    paths = files_of(path)
    _check_place(paths, overwrite)
    with whole_files(*paths) as temporary:  # all of them or none
        write_cleaned(cleaned, temporary)
    return paths


def write_cleaned(cleaned, paths):
    """Write a `CleanedCube` to files, `paths` as of `files_of`; all or none with `whole_files`."""
    if paths[0].suffix == ".h5":
        _write_hdf5(cleaned, paths[0])
        return
    cube, (*targets, table) = cleaned.cube, paths
    for target, (name, maps) in zip(targets, _as_given(cleaned), strict=True):
        if target.suffix == ".npy":
            np.save(target, maps)
        else:
            cards = [("METHOD", cleaned.method.name), ("HIMAP", __version__)]
            cube.layout.pixels.write(target, maps, cube.layout, name=name, cards=cards)
    header = "frequency [MHz], then the columns of the mixing matrix"
    np.savetxt(table, np.column_stack([cube.freqs, cleaned.separation.mixing]), header=header)


def _as_given(cleaned):
    """(name, cube as in the file) of what is written, one at a time."""
    for name, maps in (("residual", cleaned.residual_with_nan), ("foreground", cleaned.foreground)):
        yield name, cleaned.cube.layout.as_given(maps, cleaned.cube.mask)


def _write_hdf5(cleaned, path):
    cube, mixing = cleaned.cube, cleaned.separation.mixing
    n_voxels = len(cube.freqs) * len(cube.mask)
    _reserve(path, n_voxels * (cleaned.residual.itemsize + cube.maps.itemsize))
    with _plain_errors(), h5py.File(path, "w") as file:
        for name, maps in _as_given(cleaned):
            file.create_dataset(name, data=maps).attrs["unit"] = cube.layout.unit
        file.create_dataset("freqs", data=cube.layout.freqs).attrs["unit"] = "MHz"
        file.create_dataset("mixing", data=mixing).attrs["rows"] = "channels by frequency, ascending"
        file.attrs.update(cube.layout.pixels.attributes())
        file.attrs["method"] = cleaned.method.name
        file.attrs["parameters"] = json.dumps(asdict(cleaned.method))
        file.attrs["himap"] = __version__


def _reserve(path, n_bytes):
    """Refuse a file that the disk has no room for, before HDF5 finds out: it tells that in tracebacks."""
    if hasattr(os, "posix_fallocate"):  # macOS has none
        with open(path, "wb") as file:
            os.posix_fallocate(file.fileno(), 0, n_bytes + _AROUND)


@contextmanager
def _plain_errors():
    """HDF5 tells a full disk in a page of text, or as a RuntimeError when the file is closed."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        number = re.search(r"errno = (\d+)", str(error))
        if number is None:
            raise
        raise OSError(int(number[1]), os.strerror(int(number[1]))) from None
