"""Cubes of channel maps as they are on disk: HDF5, FITS, .npy. Nothing that is read can run code."""

import operator
import os
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from himap.core.checks import evenly_spaced, in_mhz, real_array
from himap.core.errors import InputError
from himap.core.reading import format_of, mapped_array, read_array, read_numbers, reading, regular_file
from himap.cubes import fits, hdf5
from himap.cubes.axes import check_names, pixel_axis, remark_on_axes
from himap.cubes.cube import are_scattered, make_cube
from himap.cubes.layout import Layout, check_cube_room, is_seen, same_freqs
from himap.cubes.weights import voxel_weights, weight_datasets
from himap.maps.frames import frame_of, is_nested
from himap.maps.healpix_io import temperature_unit
from himap.maps.sphere import sphere_sizes

_UNIT_IS = "as BUNIT in a header, TUNIT of each column of a table, or the attribute unit of a dataset"


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
    weighed, voxels = weights is not None or flags is not None, None
    names = {"maps_name": maps_name, "freqs_name": freqs_name, "aside": weight_datasets(path, weights, flags)}
    with reading(path):
        maps, layout = read_file(path, **names, axes=axes)
        layout = _completed(path, len(maps), layout, freqs=freqs, unit=unit, order=order, frame=frame)
        if not layout.pixels.whole_sky and axes is None:
            layout = layout.noted(*remark_on_axes(maps, layout.pixels))
        if weighed or (scattered and are_scattered(np.array([*map(is_seen, maps)]))):
            check_cube_room(path, maps.size, 0, weighed=True)
            voxels, layout = voxel_weights(maps.shape, layout, weights=weights, flags=flags, rotate=rotate)
        return make_cube(maps, layout, weights=voxels)


def read_truth(path, *, cube=None, maps_name=None, freqs_name=None, axes=None, rotate=False, **given):
    """A `Cube` of the truth, or a mock, of `cube`: options as in `read_cube`, where its file says nothing.

    Channels that the file of `cube` has, but `cube` has not, are left out. Maps of the whole sky in another
    frame are rotated, if they may be (`rotate`).
    """
    with reading(path):
        found, ways = None, [{}, {"maps_name": maps_name, "freqs_name": freqs_name, "axes": axes}]
        if axes is not None and format_of(path) != "HDF5":
            # The shape of an array hardly says which axis is which: axes that are given come first.
            found, ways = _read_by_header(path, cube), [{"axes": axes}, {}]
        try:
            maps, layout = found or read_file(path, **ways[0])
        except InputError:
            maps, layout = read_file(path, **ways[1])
        pixels = layout.pixels
        stated = {"freqs": layout.freqs, "unit": layout.unit, "order": pixels.nested, "frame": pixels.frame}
        unsaid = {name: value for name, value in given.items() if stated.get(name) is None}
        truth = make_cube(maps, _completed(path, len(maps), layout, **unsaid))
    return truth if cube is None else truth.channels_of(cube).in_frame_of(cube, str(path), rotate=rotate)


def _read_by_header(path, cube):
    """Maps and `Layout` of an image cube that has the channels and image of a `Cube` by its header, or None.

    None too where the header of the `Cube` has an axis of frequencies: axes that are given correct both.
    """
    if cube is not None and not cube.layout.freqs_from.startswith("the axis FREQ"):
        with suppress(InputError):
            maps, layout = read_file(path)
            if layout.freqs is not None and layout.pixels.same(cube.layout.pixels):
                near = same_freqs(layout.freqs[:, None], cube.freqs).any(axis=0)
                return (maps, layout) if near.all() else None
    return None


def read_file(path, *, maps_name=None, freqs_name=None, axes=None, aside=()):
    """Maps and `Layout` of an HDF5, FITS or .npy file, whatever its name ends with, or a folder of FITS.

    FITS holds HEALPix maps in a table, or an image cube with world coordinates; of these each file of a
    folder may have a range of channels. Options as of `read_cube`; `aside` are datasets of an HDF5 file that
    are no maps and no masks, by the last part of their names. Maps are (n_channels, n_pix) in the order, unit
    and pixelisation of the file, NaN where it marks them missing.

    Raises
    ------
    InputError
        No such file, another format, a file that does not hold one cube, or too large a one.
    """
    is_folder = isinstance(path, str | os.PathLike) and os.path.isdir(path)
    path = Path(path) if is_folder else regular_file(path)
    form = "FITS" if is_folder else format_of(path)
    if form == "HDF5":
        return hdf5.read_hdf5(path, maps_name=maps_name, freqs_name=freqs_name, axes=axes, aside=aside)
    if form is None:
        raise InputError(
            f"{path}: a cube is HDF5, FITS or .npy, or a folder of FITS files, one for each channel; by its "
            "first bytes and name this is none of them (unpack archives; write netCDF as netCDF-4)."
        )
    if (maps_name, freqs_name) != (None, None):
        raise InputError(f"names of datasets (--maps, --freqs-name) are for HDF5 files; {path} is none.")
    return read_npy(path, axes) if form == "npy" else fits.read_fits(path, axes)


def read_npy(path, axes=None):
    """Maps and `Layout` of an array of HEALPix maps, which states nothing else."""
    maps = mapped_array(path)
    if maps.ndim != 2 or maps.dtype.kind not in "fiu" or not sphere_sizes(maps.shape):
        raise InputError(
            f"{path} must hold numbers of shape (n_channels, n_pix) with n_pix = 12 nside^2, "
            f"got {maps.dtype} {maps.shape}."
        )
    check_cube_room(path, maps.size, maps.dtype.itemsize)
    pixels, remarks = pixel_axis(maps.shape, axes)
    maps = read_array(path) if pixels else read_array(path).T
    return maps, Layout.of_sphere(maps, remarks=remarks)


def _completed(path, n_channels, layout, *, freqs=None, unit=None, order=None, frame=None):
    """The `Layout` of a file with the frequencies, unit, order and frame that the caller gives."""
    layout = _with_freqs(path, n_channels, layout, freqs)
    if layout.pixels.whole_sky:
        nested = is_nested(None if order is None else str(order), "order")
        shown = {True: "NESTED", False: "RING"}.get
        nested = _either(path, "order", layout.pixels.nested, nested, shown=shown)
        frame = frame_of(frame, name="the frame of coordinates (--frame)")
        frame = _either(path, "frame", layout.pixels.frame, frame)
        if nested is None:
            layout = layout.noted(
                "the file does not say the order of its pixels: assumed to be RING (--order to change it)."
            )
        layout = replace(layout, pixels=replace(layout.pixels, nested=bool(nested), frame=frame))
    elif "jy" in (layout.unit or "").lower():
        raise InputError(
            f"{path} is in {layout.unit}, and a cube must be in K, mK or uK: convert every channel with "
            "astropy, (values * u.Jy / u.beam).to(u.K, u.brightness_temperature(freq, beam_area=...)), or "
            "without beam_area for MJy/sr, and write BUNIT = 'K'."
        )
    elif (order, frame) != (None, None):
        raise InputError("an image has no order or frame of HEALPix pixels; leave --order and --frame out.")
    units = (one if one is None else temperature_unit(one, where=_UNIT_IS) for one in (layout.unit, unit))
    unit = _either(path, "unit", *units)
    if unit is None:
        raise InputError("the file does not say whether its maps are in K or mK; give unit= (--unit).")
    return replace(layout, unit=unit)


def _with_freqs(path, n_channels, layout, freqs):
    """The `Layout` of a file with its frequencies, which `freqs` are, or a file of them, if it has none."""
    given_from = "the caller"
    if isinstance(freqs, str | os.PathLike):
        freqs, given_from = read_freqs(freqs)
    freqs = None if freqs is None else real_array("freqs", in_mhz(freqs)).astype(float)
    freqs = _either(
        path,
        "list of frequencies",
        layout.freqs,
        freqs,
        same=lambda one, other: one.shape == other.shape and same_freqs(one, other).all(),
        shown=partial(np.array2string, threshold=5, edgeitems=2),
    )
    if freqs is None:
        how = " Names of files state them where each has one number in MHz or GHz, as map_950.5MHz.fits has."
        raise InputError(
            f"{path} does not state its frequencies; give them with freqs= (--freqs FILE), MHz"
            f"{', or name their dataset (--freqs-name)' * (format_of(path) == 'HDF5')}."
            f"{how * bool(layout.names)}"
        )
    if freqs.shape != (n_channels,):
        raise InputError(
            f"there must be one frequency for each of the {n_channels} channels, got {freqs.size}; if the "
            "axes of the array are others, name them as in numpy (--axes ra,dec,freq or pixel,freq)."
        )
    remarks = layout.remarks
    if layout.names:
        if layout.freqs is None:
            check_names(layout.names, freqs)
        ends = (f"{layout.names[n]} ({freqs[n]:.10g} MHz)" for n in (0, -1))
        remarks = (f"The first of its files is {', the last '.join(ends)}.", *remarks)
    parts = getattr(layout.pixels, "parts", ())
    if len(parts) == 1 and parts[0].freqs is None and len(freqs) > 2 and not evenly_spaced(np.sort(freqs)):
        uneven = "the channels are unevenly spaced, which no axis of an image states: results in HDF5 do."
        remarks = (*remarks, uneven)
    return replace(layout, freqs=freqs, freqs_from=layout.freqs_from or given_from, remarks=remarks)


def _either(path, what, stated, given, *, same=operator.eq, shown=str):
    """What the file states or else the caller gives, None where neither does; both must be the same."""
    if stated is not None and given is not None and not same(stated, given):
        raise InputError(
            f"{path}: the file says {shown(stated)}, but the {what} given is {shown(given)}, for all files: "
            "leave it out, correct this file, or write those that do not say it as HDF5 that does."
        )
    return given if stated is None else stated


def read_freqs(path):
    """Frequencies in a .npy or text file, (n,), in MHz, and what states them, in words.

    It has one number a line, the centre of a channel, or the edges of channels that adjoin each other, as of
    CRIME and CoLoRe, whose means are the centres: columns ``lower upper``, ``number lower upper`` with
    numbers from 1, or those and two of redshifts. An InputError for another table.
    """
    numbers = read_numbers(regular_file(path, "file of frequencies"))
    if numbers.ndim == 1 or 1 in numbers.shape:
        return numbers.ravel(), str(path)
    if numbers.ndim == 2 and numbers.shape[1] in (2, 3, 5):
        *first, lower, upper = numbers.T[: min(numbers.shape[1], 3)]
        is_right = not first or np.array_equal(*first, np.arange(1, len(numbers) + 1))
        both = ((lower, upper), (upper, lower))  # edges that two channels share, upwards or downwards
        adjoin = any(same_freqs(end[:-1], start[1:]).all() for start, end in both)
        if is_right and adjoin and (lower > 0).all() and (lower < upper).all():
            return (lower + upper) / 2, f"the edges of channels in {path}"
    raise InputError(
        f"{path} must have one frequency a line, the centre of a channel in MHz, or the edges of "
        "channels that adjoin (lower upper, or number lower upper, or that and redshifts, as of CRIME); "
        f"got a table of shape {numbers.shape}. Write the centres to a file, one a line."
    )
