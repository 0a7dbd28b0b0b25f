"""Write cleaned cubes in the layout of the input: HDF5, FITS or .npy, complete files or none."""

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
"""File name endings of a cleaned cube."""

_COLUMNS = 999  # maximum of a table in FITS


def ending_of(path):
    """The one of `OUTPUTS` that a name ends with, or else its suffix, in lower case."""
    return next((end for end in OUTPUTS if path.name.lower().endswith(end)), path.suffix.lower())


def companion(path, ending):
    """A file next to a cleaned cube, with the same name and another ending."""
    return path.with_name(f"{path.name[: len(path.name) - len(ending_of(path))]}{ending}")


def check_columns(cube, path):
    """Refuse a FITS file for HEALPix maps with more channels than its table can have columns."""
    pixels = cube.layout.pixels
    n_columns = len(cube.layout.freqs) + bool(pixels.whole_sky and pixels.partial)
    if pixels.whole_sky and ending_of(Path(path)).startswith(".fits") and n_columns > _COLUMNS:
        raise InputError(
            f"a FITS table has at most {_COLUMNS} columns, and {path} would need {n_columns}: write HDF5, "
            f"{companion(Path(path), '.h5')}."
        )


def check_output(path, *, overwrite, inputs=(), endings=(), page=False):
    """Check all output files of a cleaned cube, or of a page, and return them, `path` first.

    Parameters
    ----------
    path, overwrite
        The first file, and whether existing files may be replaced.
    inputs
        Files that are never overwritten.
    endings
        Endings of further files with the same name.
    page
        Whether the output is an HTML page.

    Raises
    ------
    InputError
        Another ending, a folder that is not writable, an existing file without `overwrite`, or one of
        `inputs`.
    """
    path, more = Path(path), ()
    ending = ending_of(path)
    if page and ending != ".html":
        raise InputError(f"the page must be a .html file, got {path}.")
    if not page and ending not in OUTPUTS:
        raise InputError(f"the output must be a {', '.join(OUTPUTS[:-1])} or {OUTPUTS[-1]} file, got {path}.")
    if ending not in (".h5", ".hdf5", ".html"):
        more = (f"_foreground{ending}", "_mixing.txt")
    paths = [path, *(companion(path, end) for end in (*more, *endings))]
    folder = Path(os.path.realpath(path.parent))
    try:  # permissions are not always reliable
        with tempfile.TemporaryFile(dir=folder):
            pass
        places = [Path(os.path.realpath(each)) for each in paths]
        _ = [place.exists() for place in places]  # raises for an invalid name
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"the output {path} cannot be written ({reason}): choose another name, or another folder than "
            f"{folder}."
        ) from None
    originals = {Path(os.path.realpath(each)) for each in inputs if os.path.lexists(each)}
    for each, place in zip(paths, places, strict=True):
        if originals & {place, folder}:
            raise InputError(f"{each} is an input and would be overwritten; choose another output.")
    check_free(paths, overwrite=overwrite)
    return paths


def save_cleaned(cleaned, path, *, overwrite=False):
    """Write a `CleanedCube`: residual, foreground and mixing matrix.

    Channels, pixels, units and the header of an image are those of the input file; unobserved pixels are NaN
    (UNSEEN for HEALPix in FITS). In missing voxels the residual is NaN, and the foreground is its estimate
    there. An HDF5 file contains all results; FITS and .npy are accompanied by NAME_foreground and
    NAME_mixing.txt.

    Returns
    -------
    list
        The paths of the written files.

    Raises
    ------
    InputError
        An ending not in `OUTPUTS`, more channels than FITS has columns, or an existing file without
        `overwrite`.
    """
    check_cleaned(cleaned)
    check_columns(cleaned.cube, path)
    paths = check_output(path, overwrite=overwrite)
    with atomic_files(*paths) as temporary:  # all files or none
        write_cleaned(cleaned, temporary)
    return paths


def write_cleaned(cleaned, paths, *, said=None):
    """Write a `CleanedCube` to files, `paths` from `check_output`.

    The assumptions (`said`, sentences; default: those of the cube) and the remarks on the result are written
    to the attribute `remarks` of HDF5, HISTORY of FITS, and the head of the table; likewise the parameters of
    the method, in HDF5 as the attribute `parameters`, in JSON.
    """
    sentences = [*(cleaned.cube.said if said is None else said), *cleaned.remarks]
    cube, layout, mixing = cleaned.cube, cleaned.cube.layout, cleaned.separation.mixing
    about = {"method": cleaned.method.name, "himap": __version__}
    parameters = json.dumps(asdict(cleaned.method))
    if cleaned.ensemble is not None:  # index and number of restarts, and of likely failures
        about |= {"restart": cleaned.method.restart, "restarts": len(cleaned.ensemble.members)}
        about |= {"failed": sum(map(bool, cleaned.ensemble.flags))}
    cubes = {"residual": cleaned.residual_with_nan, "foreground": cleaned.foreground}
    as_given = ((name, layout.as_given(maps, cube.mask)) for name, maps in cubes.items())  # one at a time
    if ending_of(paths[0]) in (".h5", ".hdf5"):
        try:
            _write_hdf5(cleaned, paths[0], as_given, about | {"parameters": parameters}, sentences)
        except RuntimeError as error:  # raised by h5py on closing a file on a full disk
            raise OSError(str(error)) from None
        return
    *targets, table = paths
    sentences = [f"parameters: {parameters}", *sentences]
    for target, (name, maps) in zip(targets, as_given, strict=True):
        if ending_of(target) == ".npy":
            with open(target, "wb") as file:  # np.save would add .npy to a name ending in .NPY
                np.save(file, maps)
        else:
            cards = [(key.upper(), value) for key, value in about.items()]
            cards += [("HISTORY", text) for text in map(_in_ascii, sentences)]
            written = companion(target, ending_of(target))  # astropy compresses .gz in small letters alone
            layout.pixels.write(written, maps, layout, name=name, cards=cards)
            os.replace(written, target)
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
        # h5py allows no zero bytes in texts, and a FITS card may have the name of a pixel attribute.
        kept = {key: value for key, value in layout.about.items() if meaning_of(key) in (None, "SPECSYS")}
        texts = {key: value for key, value in kept.items() if "\0" not in f"{value}"}
        file.attrs.update(texts | attributes | about)


def _in_ascii(sentence):
    return plain_text(sentence).encode("ascii", "backslashreplace").decode()
