"""Cleaned cubes, written as the cube was given: HDF5, FITS or .npy, complete files or none."""

import json
import os
import tempfile
from dataclasses import asdict
from pathlib import Path

import h5py
import numpy as np

from himap import __version__
from himap.core.errors import InputError, plain_text, shortened
from himap.core.files import atomic_files, check_free
from himap.cubes.cleaning import check_cleaned
from himap.cubes.hdf5_access import meaning_of

OUTPUTS = (".h5", ".hdf5", ".fits", ".fits.gz", ".npy")
"""What the name of a cleaned cube ends with."""

_COLUMNS = 999  # at most in a table in FITS


def ending_of(path):
    """The one of `OUTPUTS` that a name ends with, in small letters; its suffix for other names."""
    return next((end for end in OUTPUTS if path.name.lower().endswith(end)), path.suffix)


def companion(path, ending):
    """A file next to a cleaned cube, of the same name but for its end."""
    return path.with_name(f"{path.name[: len(path.name) - len(ending_of(path))]}{ending}")


def check_columns(cube, path):
    """Refuse a file in FITS for HEALPix maps of more channels than its table can have columns."""
    pixels = cube.layout.pixels
    n_columns = len(cube.layout.freqs) + bool(pixels.whole_sky and pixels.partial)
    if pixels.whole_sky and ending_of(Path(path)).startswith(".fits") and n_columns > _COLUMNS:
        raise InputError(
            f"a table in FITS has {_COLUMNS} columns at most, and {path} would need {n_columns}: write "
            f"HDF5, {companion(Path(path), '.h5')}."
        )


def check_output(path, *, overwrite, inputs=(), endings=(), page=False):
    """All files of a cleaned cube, or of a page, `path` first, which can be written.

    Parameters
    ----------
    path, overwrite
        The first file, and whether they may be there already.
    inputs
        Files that are never written over.
    endings
        Those of further files of its name.
    page
        Whether it is a page in HTML.

    Raises
    ------
    InputError
        Another ending, a folder that cannot be written to, a file that is there and not to be overwritten, or
        one of `inputs`.
    """
    path, more = Path(path), ()
    ending = ending_of(path)
    if page and ending != ".html":
        raise InputError(f"the page is a .html file, got {path}.")
    if not page and ending not in OUTPUTS:
        raise InputError(f"the output is a {', '.join(OUTPUTS[:-1])} or {OUTPUTS[-1]} file, got {path}.")
    if ending not in (".h5", ".hdf5", ".html"):
        more = (f"_foreground{ending}", "_mixing.txt")
    paths = [path, *(companion(path, end) for end in (*more, *endings))]
    folder = Path(os.path.realpath(path.parent))
    try:  # what the permissions promise is not always so
        with tempfile.TemporaryFile(dir=folder):
            pass
        places = [Path(os.path.realpath(each)) for each in paths]
        _ = [place.exists() for place in places]  # raises for a name that none can have
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"the output {path} cannot be written ({reason}): choose another name, or another folder than "
            f"{folder}."
        ) from None
    originals = {Path(os.path.realpath(each)) for each in inputs if os.path.lexists(each)}
    for each, place in zip(paths, places, strict=True):
        if originals & {place, folder}:
            raise InputError(f"{each} would change what it is made from; choose another output.")
    check_free(paths, overwrite=overwrite)
    return paths


def save_cleaned(cleaned, path, *, overwrite=False):
    """Write a `CleanedCube`: residual, foreground and mixing matrix.

    Channels, pixels and units are as in the file that the cube came from, and so is the header of an image;
    pixels that were not seen are NaN (of HEALPix in FITS: UNSEEN). Of a voxel that was missing the residual
    is NaN, the foreground what was estimated of it. An HDF5 file holds it all; with FITS and .npy come
    NAME_foreground and NAME_mixing.txt.

    Returns
    -------
    list
        The paths that were written.

    Raises
    ------
    InputError
        Another ending than those of `OUTPUTS`, more channels than FITS has columns, or a file that is there
        already, without `overwrite`.
    """
    check_cleaned(cleaned)
    check_columns(cleaned.cube, path)
    paths = check_output(path, overwrite=overwrite)
    with atomic_files(*paths) as temporary:  # all of them or none
        write_cleaned(cleaned, temporary)
    return paths


def write_cleaned(cleaned, paths, *, said=None):
    """Write a `CleanedCube` to files, `paths` as of `check_output`.

    What was assumed (`said`, sentences; default: those of the cube) and the remarks on the result go into the
    attribute `remarks` of HDF5, HISTORY of FITS, and the head of the table. So do the parameters of the
    method, which HDF5 has as the attribute `parameters`, in JSON.
    """
    sentences = [*(cleaned.cube.said if said is None else said), *cleaned.remarks]
    cube, layout, mixing = cleaned.cube, cleaned.cube.layout, cleaned.separation.mixing
    about = {"method": cleaned.method.name, "himap": __version__}
    parameters = json.dumps(asdict(cleaned.method))
    if cleaned.ensemble is not None:  # which of several restarts, of how many, and how many look failed
        about |= {"restart": cleaned.method.restart, "restarts": len(cleaned.ensemble.members)}
        about |= {"failed": sum(map(bool, cleaned.ensemble.flags))}
    cubes = {"residual": cleaned.residual_with_nan, "foreground": cleaned.foreground}
    as_given = ((name, layout.as_given(maps, cube.mask)) for name, maps in cubes.items())  # one at a time
    if ending_of(paths[0]) in (".h5", ".hdf5"):
        try:
            _write_hdf5(cleaned, paths[0], as_given, about | {"parameters": parameters}, sentences)
        except RuntimeError as error:  # what h5py raises for a full disk when a file is closed
            raise OSError(str(error)) from None
        return
    *targets, table = paths
    sentences = [f"parameters: {parameters}", *sentences]
    for target, (name, maps) in zip(targets, as_given, strict=True):
        if ending_of(target) == ".npy":
            with open(target, "wb") as file:  # np.save adds .npy to a name that ends with .NPY
                np.save(file, maps)
        else:
            cards = [(key.upper(), value) for key, value in about.items()]
            cards += [("HISTORY", text) for text in map(_in_ascii, sentences)]
            layout.pixels.write(target, maps, layout, name=name, cards=cards)
    header = "\n".join([*map(_in_ascii, sentences), "frequency [MHz], then the columns of the mixing matrix"])
    np.savetxt(table, np.column_stack([cube.freqs, mixing]), header=header)


def _write_hdf5(cleaned, path, as_given, about, sentences):
    layout = cleaned.cube.layout
    with h5py.File(path, "w") as file:
        for name, maps in as_given:
            file.create_dataset(name, data=maps).attrs["unit"] = layout.unit
        file.create_dataset("freqs", data=layout.freqs).attrs["unit"] = "MHz"
        mixing = cleaned.separation.mixing
        rows = np.full((len(layout.freqs), mixing.shape[1]), np.nan)
        rows[layout.channels] = mixing
        file.create_dataset("mixing", data=rows).attrs["rows"] = (
            "those of freqs; NaN of channels without data"
        )
        about |= {"remarks": shortened("\n".join(map(plain_text, sentences)))}
        attributes, datasets = layout.pixels.in_hdf5(layout)
        for name, values in datasets.items():
            file.create_dataset(name, data=values)
        # h5py has no zeros in texts, and a card of FITS may have the name of what says how pixels are kept.
        kept = {key: value for key, value in layout.about.items() if meaning_of(key) in (None, "SPECSYS")}
        texts = {key: value for key, value in kept.items() if "\0" not in f"{value}"}
        file.attrs.update(texts | attributes | about)


def _in_ascii(sentence):
    return plain_text(sentence).encode("ascii", "backslashreplace").decode()
