"""What was made of a cube, written as it was given: HDF5, FITS or .npy, whole files or none."""

import json
import os
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

import h5py
import healpy as hp
import numpy as np

from himap import __version__
from himap.errors import InputError
from himap.outputs import whole_file

__all__ = ["OUTPUTS", "check_cube_output", "check_page", "save_cleaned"]

OUTPUTS = (".h5", ".fits", ".npy")


def check_cube_output(path, *, overwrite):
    """`path` as one that can be written, or an error before the work begins.

    Raises
    ------
    InputError
        Another ending, a folder that cannot be written to, or a file that is there and not to be overwritten.
    """
    path = Path(path)
    if path.suffix not in OUTPUTS:
        raise InputError(f"the output is a {', '.join(OUTPUTS[:-1])} or {OUTPUTS[-1]} file, got {path}.")
    _check_place(companions(path), overwrite)
    return path


def check_page(path, *, overwrite):
    """`path` as one that a page can be written to; raises as `check_cube_output`."""
    path = Path(path)
    if path.suffix != ".html":
        raise InputError(f"the page is a .html file, got {path}.")
    _check_place([path], overwrite)
    return path


def _check_place(paths, overwrite):
    folder = paths[0].resolve().parent
    if paths[0].is_dir() or not folder.is_dir() or not os.access(folder, os.W_OK):
        raise InputError(f"the output {paths[0]} cannot be written: is {folder} a folder that can be?")
    for one in paths:
        if one.exists() and not overwrite:
            raise InputError(f"{one} exists; choose another output, or give --overwrite.")


def companions(path):
    """All files that go with the output `path`, itself included."""
    path = Path(path)
    beside = [path.with_suffix(".html")]
    if path.suffix != ".h5":
        beside += [path.with_name(f"{path.stem}_foreground{path.suffix}"), _named(path, "_mixing.txt")]
    return [path, *beside]


def save_cleaned(cleaned, path):
    """Write a `CleanedCube`: residual, foreground and mixing matrix.

    Channels, pixels and units are as in the file that the cube came from; pixels that were not seen are NaN
    (in FITS: UNSEEN). An HDF5 file holds it all; beside FITS and .npy there are NAME_foreground and
    NAME_mixing.txt.

    Returns
    -------
    list
        The paths that were written.
    """
    path, cube = Path(path), cleaned.cube
    if path.suffix == ".h5":
        with whole_file(path) as temporary:
            _write_hdf5(cleaned, temporary)
        return [path]
    paths = [path, path.with_name(f"{path.stem}_foreground{path.suffix}"), _named(path, "_mixing.txt")]
    with ExitStack() as stack:  # all of them or none
        *targets, table = [stack.enter_context(whole_file(one)) for one in paths]
        for target, (name, maps) in zip(targets, _as_given(cleaned), strict=True):
            if path.suffix == ".npy":
                np.save(target, maps)
            else:
                _write_fits(name, maps, cleaned, target)
        header = "frequency [MHz], then the columns of the mixing matrix"
        np.savetxt(table, np.column_stack([cube.freqs, cleaned.separation.mixing]), header=header)
    return paths


def _named(path, ending):
    return path.with_name(path.stem + ending)


def _as_given(cleaned):
    """(name, cube as in the file) of what is written, one at a time."""
    for name, maps in (("residual", cleaned.residual), ("foreground", cleaned.foreground)):
        yield name, cleaned.cube.layout.as_given(maps, cleaned.cube.mask)


def _freqs_as_given(cube):
    freqs = np.full(cube.layout.n_channels, np.nan)
    freqs[cube.layout.channels] = cube.freqs
    return freqs


def _write_hdf5(cleaned, path):
    cube, found = cleaned.cube, cleaned.separation
    with h5py.File(path, "w") as file:
        for name, maps in _as_given(cleaned):
            file.create_dataset(name, data=maps).attrs["unit"] = cube.layout.unit
        file.create_dataset("freqs", data=_freqs_as_given(cube)).attrs["unit"] = "MHz"
        file.create_dataset("mixing", data=found.mixing).attrs["rows"] = "channels by frequency, ascending"
        file.attrs["ordering"] = "NESTED" if cube.layout.nested else "RING"
        file.attrs["method"] = cleaned.method.name
        file.attrs["parameters"] = json.dumps(asdict(cleaned.method))
        file.attrs["himap"] = __version__


def _write_fits(name, maps, cleaned, path):
    layout = cleaned.cube.layout
    freqs = _freqs_as_given(cleaned.cube)
    maps[~np.isfinite(maps)] = hp.UNSEEN
    hp.write_map(
        path,
        maps,
        nest=layout.nested,
        dtype=np.float32,
        column_names=[f"{name} {freq:g} MHz" for freq in freqs],
        column_units=layout.unit,
        extra_header=[("METHOD", cleaned.method.name), ("HIMAP", __version__)],
    )
