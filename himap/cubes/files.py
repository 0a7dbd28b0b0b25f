"""Cubes of channel maps as they are on disk: HDF5, FITS, .npy. Nothing that is read can run code."""

import operator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from himap.core.checks import real_array
from himap.core.errors import InputError
from himap.core.memory import PROCESS, check_room
from himap.core.reading import format_of, mapped_array, read_array, read_numbers, reading, regular_file
from himap.cubes import fits, hdf5
from himap.cubes.axes import pixel_axis, remark_on_axes
from himap.cubes.cube import are_scattered, make_cube
from himap.cubes.image_files import check_no_flux
from himap.cubes.layout import Layout, check_cube_room, same_freqs
from himap.cubes.names import check_names, fits_in, unlike_names
from himap.cubes.weights import is_path, voxel_weights, weight_datasets
from himap.maps.frames import frame_of, is_nested
from himap.maps.healpix_io import temperature_unit
from himap.maps.sphere import sphere_sizes
from himap.removal.gnilc import LINE

_HELD = 4  # cubes in float32 that cleaning holds at once beside the one in the file; measured with 0.1 GB
_HELD_TRUTH = 2  # more of them for a truth
_HELD_WEIGHTS = 3  # more of them for weights
_UNIT_IN = {
    "image": "as BUNIT in the header",
    "HDF5": "as the attribute unit of the dataset",
    "npy": "which is given with unit= (--unit)",
    **dict.fromkeys((None, "FITS"), "as TUNIT of each column, which healpy.write_map(column_units=) does"),
}
_REDSHIFT = 1e-5  # the same of redshifts, which have six digits


def read_cube(
    path,
    *,
    freqs=None,
    unit=None,
    order=None,
    frame=None,
    maps_name=None,
    freqs_name=None,
    axes=None,
    weights=None,
    flags=None,
    scattered=False,
    rotate=False,
):
    """A `Cube` from a file; see `himap.cubes.files.read_file` for the formats.

    Parameters
    ----------
    path
        File, or folder of files.
    freqs
        Channel centres in MHz, in the order of the channels in the file: an array, or the path of a file with
        one number a line, or of a table of edges (`himap.cubes.files.read_freqs`); for files that do not
        state them.
    unit
        "K", "mK" or "uK", if the file does not say.
    order
        "RING" or "NESTED", if the file does not say; RING unless given.
    frame
        Of the coordinates, "G", "C" or "E", if the file does not say.
    maps_name, freqs_name
        Datasets of an HDF5 file.
    axes
        Those of the array, in the order of numpy, where they are not as the file says, or it does not say:
        "ra,dec,freq" of images whose array was not turned round for its header; "pixel,freq" of maps.
    weights
        Hits or inverse variances, of which only ratios matter, 0 where not seen: of pixels, (n_pix,), or of
        voxels, (n_channels, n_pix), pixels and channels in the order of the file; or the path of such an
        array in .npy, of HEALPix maps in FITS, in any order of pixels, or of HDF5 with a dataset ``weights``.
    flags
        True (or 1) where a voxel, or all of a pixel, is bad: as `weights`, the dataset is called ``flags``.
    scattered
        Whether voxels that are missing in the file itself (NaN) are flags, for methods that take weights,
        where more than 1 % of the pixels are missing in some channels and seen in others.
    rotate
        Whether weights and flags of another frame are rotated to that of the maps, or refused.

    Raises
    ------
    InputError
        What is missing or contradicts the file, and how to give it.

    Notes
    -----
    With weights or flags a pixel that is missing in some channels is kept, and what is missing is filled, or
    left out, by the method. Without, the pixels that are seen in all channels are kept.
    """
    weighed = weights is not None or flags is not None
    names = {"maps_name": maps_name, "freqs_name": freqs_name, "aside": weight_datasets(path, weights, flags)}
    with reading(path):
        maps, layout = read_file(path, **names, axes=axes, held=_HELD + _HELD_WEIGHTS * weighed)
        layout = completed(path, len(maps), layout, freqs=freqs, unit=unit, order=order, frame=frame)
        if not layout.pixels.whole_sky and axes is None:
            layout = layout.noted(*remark_on_axes(maps, layout.pixels))
        if weighed:
            weights, layout = voxel_weights(maps, layout, weights=weights, flags=flags, rotate=rotate)
        elif scattered and are_scattered(maps):
            check_room(f"work on {path}", PROCESS + 4 * (_HELD + _HELD_WEIGHTS) * maps.size)
            weights, layout = voxel_weights(maps, layout)
        return make_cube(maps, layout, weights=weights)


def read_truth(
    path,
    *,
    cube=None,
    freqs=None,
    unit=None,
    order=None,
    frame=None,
    maps_name=None,
    freqs_name=None,
    axes=None,
    rotate=False,
):
    """A `Cube` of the truth, or a mock, of another: options as in `read_cube`, where its file says nothing.

    Channels that the file of the other, `cube`, has, but `cube` has not, are left out. Maps of the whole sky
    in another frame than that are rotated, if they may be (`rotate`).
    """
    with reading(path):
        try:
            maps, layout = read_file(path, held=_HELD_TRUTH)
        except InputError:
            if maps_name is freqs_name is axes is None:
                raise
            names = {"maps_name": maps_name, "freqs_name": freqs_name, "axes": axes}
            maps, layout = read_file(path, **names, held=_HELD_TRUTH)
        pixels = layout.pixels
        given = {"freqs": freqs, "unit": unit, "order": order, "frame": frame}
        stated = {"freqs": layout.freqs, "unit": layout.unit, "order": pixels.nested, "frame": pixels.frame}
        unsaid = {name: value for name, value in given.items() if stated[name] is None}
        truth = make_cube(maps, completed(path, len(maps), layout, **unsaid))
    return truth if cube is None else truth.channels_of(cube).in_frame_of(cube, str(path), rotate=rotate)


def frames_in(path):
    """The frame of coordinates and SPECSYS that the headers of a file or folder state, without its maps.

    Each None where nothing, or more than one, is stated.
    """
    path = fits_in(Path(path))[0][0] if Path(path).is_dir() else regular_file(path)
    form = format_of(path)
    with reading(path, form):
        frames = {"HDF5": hdf5.frames_in_hdf5, "FITS": fits.frames_in_fits}.get(form)
        return (None, None) if frames is None else frames(path)


def read_file(path, *, maps_name=None, freqs_name=None, axes=None, aside=(), held=1):
    """What an HDF5, FITS or .npy file, whatever its name ends with, or a folder of FITS files states.

    FITS holds HEALPix maps in a table, or an image cube with world coordinates; of these each file of a
    folder may have a range of channels.

    Parameters
    ----------
    path
        File or folder.
    maps_name, freqs_name
        Datasets of an HDF5 file; found by their shapes and names unless given.
    axes
        As of `read_cube`.
    aside
        Datasets of an HDF5 file that are no maps and no masks, by the last part of their names.
    held
        Cubes in float32 that the caller will hold at once: they must fit into memory.

    Returns
    -------
    (ndarray, Layout)
        Maps (n_channels, n_pix) in the order, unit and pixelisation of the file, NaN where it marks them
        missing; and what it states of them.

    Raises
    ------
    InputError
        No such file, another format, a file that does not hold one cube, or too large a one.
    """
    try:
        is_folder = bool(str(path)) and Path(path).is_dir()
    except (OSError, ValueError, RuntimeError):  # no name that a file can have
        is_folder = False
    path = Path(path) if is_folder else regular_file(path)
    form = "folder" if is_folder else format_of(path)
    if form == "HDF5":
        names = {"maps_name": maps_name, "freqs_name": freqs_name, "axes": axes}
        return hdf5.read_hdf5(path, **names, aside=aside, held=held)
    if form is None:
        raise InputError(
            f"{path}: a cube is HDF5, FITS or .npy, or a folder of FITS files, one for each channel; by its "
            "first bytes and its name this is none of them (unpack archives, and write netCDF as netCDF-4)."
        )
    if maps_name is not None or freqs_name is not None:
        raise InputError(f"names of datasets (--maps, --freqs-name) are for HDF5 files; {path} is none.")
    read = {"folder": fits.read_folder, "FITS": fits.read_fits, "npy": read_npy}[form]
    return read(path, axes=axes, held=held)


def read_npy(path, *, axes=None, held=1):
    """Maps and `Layout` of an array of HEALPix maps, which states nothing else."""
    maps = mapped_array(path)
    if maps.ndim != 2 or maps.dtype.kind not in "fiu" or not sphere_sizes(maps.shape):
        raise InputError(
            f"{path} must hold numbers of shape (n_channels, n_pix) with n_pix = 12 nside^2, "
            f"got {maps.dtype} {maps.shape}."
        )
    check_cube_room(path, maps.size, maps.dtype.itemsize, held)
    pixels, remarks = pixel_axis(maps.shape, axes)
    maps = read_array(path) if pixels else read_array(path).T
    return maps, Layout.of_sphere(maps, remarks=remarks)


def completed(path, n_channels, layout, *, freqs=None, unit=None, order=None, frame=None):
    """The `Layout` of a file with what the caller gives of frequencies, unit, order and frame (`read_cube`).

    Raises
    ------
    InputError
        What is given contradicts the file, or neither says what is needed.
    """
    pixels, freqs_from = layout.pixels, layout.freqs_from or "what was given"
    if is_path(freqs):
        freqs, given_from = read_freqs(freqs)
        freqs_from = layout.freqs_from or given_from
    freqs = None if freqs is None else real_array("freqs", freqs).astype(float)
    freqs = _either(path, "list of frequencies", layout.freqs, freqs, same=_same_list, shown=_listed)
    if freqs is None:
        raise InputError(
            f"{path} does not tell its frequencies; give them with freqs= (--freqs FILE), MHz, or name their "
            f"dataset (--freqs-name). {layout.nearly}".rstrip()
        )
    if freqs.shape != (n_channels,):
        raise InputError(
            unlike_names(layout.names)
            + f"there must be one frequency for each of the {n_channels} channels, got {freqs.size}; if the "
            "axes of the array are others, name them in the order of numpy (--axes ra,dec,freq, dec,ra,freq "
            "and so on, or pixel,freq)."
        )
    if layout.names:
        if layout.freqs is None:
            check_names(layout.names, freqs)
        ends = (f"{layout.names[n]} ({freqs[n]:.10g} MHz)" for n in (0, -1))
        sentence = f"The first of its files is {', the last '.join(ends)}. {unlike_names(layout.names)}"
        layout = replace(layout, remarks=(sentence.strip(), *layout.remarks))
    if not pixels.whole_sky:
        check_no_flux(path, layout.unit or "")
        for name, value in {"order": order, "frame": frame}.items():
            if value is not None:
                raise InputError(f"an image has no {name} of HEALPix pixels; leave --{name} {value} out.")
    where = "image" if not pixels.whole_sky else None if Path(path).is_dir() else format_of(path)
    read_unit = partial(temperature_unit, where=_UNIT_IN[where])
    unit = _either(path, "unit", layout.unit, unit, same=lambda *both: len({*map(read_unit, both)}) == 1)
    if unit is None:
        raise InputError("the file does not say whether its maps are in K or mK; give unit= (--unit).")
    if pixels.whole_sky:
        nested = is_nested(None if order is None else str(order), "order")
        nested = _either(path, "order", pixels.nested, nested, shown={True: "NESTED", False: "RING"}.get)
        frame = frame_of(frame, name="the frame of coordinates (--frame)")
        frame = _either(path, "frame", pixels.frame, frame)
        if nested is None:
            layout = layout.noted(
                "the file does not say the order of its pixels: taken as RING (--order to change it)."
            )
        pixels = replace(pixels, nested=bool(nested), frame=frame)
    return replace(layout, pixels=pixels, freqs=freqs, freqs_from=freqs_from, unit=read_unit(unit))


def _either(path, what, stated, given, *, same=operator.eq, shown=str):
    """What the file states or else the caller gives, None where neither does; both must be the same."""
    if stated is not None and given is not None and not same(stated, given):
        raise InputError(
            f"{path}: the file says {shown(stated)}, but the {what} given is {shown(given)}; leave it out, "
            "or mend the file."
        )
    return given if stated is None else stated


def _same_list(first, second):
    return first.shape == second.shape and same_freqs(first, second).all()


def _listed(freqs):
    """Frequencies in their order, for messages."""
    texts = [f"{freq:g}" for freq in freqs.ravel()]
    return f"{', '.join(texts if len(texts) < 5 else [*texts[:3], '...', texts[-1]])} MHz ({len(texts)})"


def read_freqs(path):
    """Frequencies that a file states, (n,), in MHz, and what it states, in words.

    Parameters
    ----------
    path
        A .npy file or a text file with one number a line, the centre of a channel. Or a table of the edges of
        channels that adjoin each other, as those of CRIME and CoLoRe, of which the means are taken: lower and
        upper; before them the number of the channel, from 1, or nothing; behind them the redshifts of the
        upper and the lower edge, or nothing.

    Raises
    ------
    InputError
        Another table: which of its columns is meant cannot be known.
    """
    numbers = read_numbers(regular_file(path, "file of frequencies"))
    if numbers.ndim == 1 or 1 in numbers.shape:
        return numbers.ravel(), "what was given"
    edges = _edges(numbers) if numbers.ndim == 2 else None
    if edges is None:
        raise InputError(
            f"{path} must have one frequency a line, the centre of a channel in MHz, or the edges of "
            "channels that adjoin (lower upper, or number lower upper, or that and redshifts, as of CRIME); "
            f"got a table of shape {numbers.shape}. Write the centres to a file, one a line, with decimal "
            "points."
        )
    return edges.mean(axis=1), f"the edges of channels in {path}"


def _edges(table):
    """Lower and upper edges, (n, 2), of a table that is exactly one of those of `read_freqs`, or None."""
    n_rows, n_columns = table.shape
    first = 0 if n_columns == 2 else 1
    edges = table[:, first : first + 2]
    if n_columns not in (2, 3, 5) or (first and not np.array_equal(table[:, 0], np.arange(1, n_rows + 1))):
        return None
    lower, upper = edges.T
    adjoin = any(
        same_freqs(end[:-1], start[1:]).all()  # edges that two channels share
        for start, end in ((lower, upper), (upper, lower))
    )
    if not (adjoin and (lower > 0).all() and (lower < upper).all()):
        return None
    redshifts = LINE / edges[:, ::-1] - 1
    if n_columns == 5 and not np.allclose(table[:, 3:], redshifts, rtol=0, atol=_REDSHIFT):
        return None
    return edges
