"""Read cubes of channel maps from HDF5, FITS and .npy. No input file can execute code."""

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
    """Read a `Cube` from a file; see `himap.cubes.files.read_file` for the formats.

    Parameters
    ----------
    path
        File, or folder of files.
    freqs
        Channel centres in MHz, in the order of the channels in the file: an array, or the path of a file with
        one number per line or of a table of edges (`himap.cubes.files.read_freqs`); for files that do not
        state frequencies.
    unit
        "K", "mK" or "uK", if the file does not state it.
    order
        "RING" or "NESTED", if the file does not state it; default RING.
    frame
        Of the coordinates, "G", "C" or "E", if the file does not state it.
    maps_name, freqs_name
        Datasets of an HDF5 file.
    axes
        Axes of the array in numpy order, if not stated or not as stated by the file: "ra,dec,freq" for images
        whose array was not transposed to match its header; "pixel,freq" for maps.
    weights
        Hits or inverse variances, of which only ratios matter, 0 where not observed: of pixels, (n_pix,), or
        of voxels, (n_channels, n_pix), in the order of the file; or the path of such an array in .npy, of
        HEALPix maps in FITS, in any pixel order, or of HDF5 with a dataset ``weights``.
    flags
        True (or 1) for bad voxels or pixels: like `weights`, with the dataset called ``flags``.
    scattered
        Whether missing voxels of the file (NaN) are flags, for methods with weights, if more than 1 % of the
        pixels are missing in some channels and observed in others.
    rotate
        Whether weights and flags in another frame are rotated to that of the maps; otherwise refused.

    Raises
    ------
    InputError
        Missing or contradictory information, and how to provide it.

    Notes
    -----
    With weights or flags, pixels missing in some channels are kept, and the method fills or ignores missing
    voxels. Without, only pixels observed in all channels are kept.
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
    """Read a truth or mock of `cube`, a `Cube`: options as in `read_cube`, for what its file does not state.

    Channels that the file of `cube` has but `cube` has not are removed. Full-sky maps in another frame are
    rotated if `rotate` allows it.
    """
    with reading(path):
        found, ways = None, [{}, {"maps_name": maps_name, "freqs_name": freqs_name, "axes": axes}]
        if axes is not None and format_of(path) != "HDF5":
            # Shapes rarely identify the axes: given axes take precedence.
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
    """Maps and `Layout` of an image cube whose header has the channels and image of a `Cube`, or None.

    Also None if the header of the `Cube` has no frequency axis: given axes then correct both.
    """
    if cube is not None and not cube.layout.freqs_from.startswith("the axis FREQ"):
        with suppress(InputError):
            maps, layout = read_file(path)
            if layout.freqs is not None and layout.pixels.same(cube.layout.pixels):
                near = same_freqs(layout.freqs[:, None], cube.freqs).any(axis=0)
                return (maps, layout) if near.all() else None
    return None


def read_file(path, *, maps_name=None, freqs_name=None, axes=None, aside=()):
    """Maps and `Layout` of an HDF5, FITS or .npy file, with any file name, or of a folder of FITS files.

    FITS contains HEALPix maps in a table, or an image cube with world coordinates; in a folder each file may
    have a range of its channels. Options as in `read_cube`; `aside` are HDF5 datasets that are neither maps
    nor masks, by the last part of their names. Maps are (n_channels, n_pix) in the order, unit and
    pixelisation of the file, with NaN for missing pixels.

    Raises
    ------
    InputError
        No such file, an unsupported format, a file without a unique cube, or a cube that is too large.
    """
    is_folder = isinstance(path, str | os.PathLike) and os.path.isdir(path)
    path = Path(path) if is_folder else regular_file(path)
    form = "FITS" if is_folder else format_of(path)
    if form == "HDF5":
        return hdf5.read_hdf5(path, maps_name=maps_name, freqs_name=freqs_name, axes=axes, aside=aside)
    if form is None:
        raise InputError(
            f"{path}: a cube is HDF5, FITS or .npy, or a folder of FITS files, one per channel; its first "
            "bytes and name match none of them (unpack archives; write netCDF as netCDF-4)."
        )
    if (maps_name, freqs_name) != (None, None):
        raise InputError(f"names of datasets (--maps, --freqs-name) are for HDF5 files; {path} is not one.")
    return read_npy(path, axes) if form == "npy" else fits.read_fits(path, axes)


def read_npy(path, axes=None):
    """Maps and `Layout` of an array of HEALPix maps, without other information."""
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
    """Complete the `Layout` of a file with the frequencies, unit, order and frame given by the caller."""
    layout = _with_freqs(path, n_channels, layout, freqs)
    if layout.pixels.whole_sky:
        nested = is_nested(None if order is None else str(order), "order")
        shown = {True: "NESTED", False: "RING"}.get
        nested = _either(path, "order", layout.pixels.nested, nested, shown=shown)
        frame = frame_of(frame, name="the frame of coordinates (--frame)")
        frame = _either(path, "frame", layout.pixels.frame, frame)
        if nested is None:
            layout = layout.noted(
                "the file does not state the pixel order: assumed to be RING (--order to change it)."
            )
        layout = replace(layout, pixels=replace(layout.pixels, nested=bool(nested), frame=frame))
    elif "jy" in (layout.unit or "").lower():
        raise InputError(
            f"{path} is in {layout.unit}, and a cube must be in K, mK or uK: convert every channel with "
            "astropy, (values * u.Jy / u.beam).to(u.K, u.brightness_temperature(freq, beam_area=...)), or "
            "without beam_area for MJy/sr, and write BUNIT = 'K'."
        )
    elif (order, frame) != (None, None):
        raise InputError("an image has no HEALPix order or frame; omit --order and --frame.")
    units = (one if one is None else temperature_unit(one, where=_UNIT_IS) for one in (layout.unit, unit))
    unit = _either(path, "unit", *units)
    if unit is None:
        raise InputError("the file does not state whether its maps are in K or mK; give unit= (--unit).")
    return replace(layout, unit=unit)


def _with_freqs(path, n_channels, layout, freqs):
    """Complete the `Layout` of a file with frequencies: its own, `freqs`, or those in the file `freqs`."""
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
        how = (
            " Names of files or columns state them if each has one number in MHz or GHz, as map_950.5MHz has."
        )
        raise InputError(
            f"{path} does not state its frequencies; give them with freqs= (--freqs FILE), MHz"
            f"{', or name their dataset (--freqs-name)' * (format_of(path) == 'HDF5')}."
            f"{how * (bool(layout.names) or format_of(path) == 'FITS')}"
        )
    if freqs.shape != (n_channels,):
        raise InputError(
            f"expected one frequency for each of the {n_channels} channels, got {freqs.size}; if the axes of "
            "the array differ, name them in numpy order (--axes ra,dec,freq or pixel,freq)."
        )
    remarks = layout.remarks
    if layout.names:
        if layout.freqs is None:
            check_names(layout.names, freqs)
        ends = (f"{layout.names[n]} ({freqs[n]:.10g} MHz)" for n in (0, -1))
        remarks = (f"The first of its files is {', the last '.join(ends)}.", *remarks)
    parts = getattr(layout.pixels, "parts", ())
    if len(parts) == 1 and parts[0].freqs is None and len(freqs) > 2 and not evenly_spaced(np.sort(freqs)):
        uneven = "the channels are unevenly spaced, which an image axis cannot state: write results as HDF5."
        remarks = (*remarks, uneven)
    return replace(layout, freqs=freqs, freqs_from=layout.freqs_from or given_from, remarks=remarks)


def _either(path, what, stated, given, *, same=operator.eq, shown=str):
    """The value stated by the file or given by the caller, None if neither; both must agree."""
    if stated is not None and given is not None and not same(stated, given):
        raise InputError(
            f"{path}: the file states {shown(stated)}, but the {what} given is {shown(given)}, for all "
            "files: omit it, correct this file, or write the files that do not state it as HDF5 that does."
        )
    return given if stated is None else stated


def read_freqs(path):
    """Read frequencies from a .npy or text file, (n,), in MHz; also returns a description of their source.

    The file has one number per line, the centre of a channel, or the edges of adjacent channels, as in CRIME
    and CoLoRe, whose means are the centres: columns ``lower upper``, ``number lower upper`` with numbers from
    1, or those and two redshifts. InputError for other tables.
    """
    numbers = read_numbers(regular_file(path, "file of frequencies"))
    if numbers.ndim == 1 or 1 in numbers.shape:
        return numbers.ravel(), str(path)
    if numbers.ndim == 2 and numbers.shape[1] in (2, 3, 5):
        *first, lower, upper = numbers.T[: min(numbers.shape[1], 3)]
        is_right = not first or np.array_equal(*first, np.arange(1, len(numbers) + 1))
        both = ((lower, upper), (upper, lower))  # shared edges, ascending or descending
        adjoin = any(same_freqs(end[:-1], start[1:]).all() for start, end in both)
        if is_right and adjoin and (lower > 0).all() and (lower < upper).all():
            return (lower + upper) / 2, f"the edges of channels in {path}"
    raise InputError(
        f"{path} must have one frequency per line, the centre of a channel in MHz, or the edges of adjacent "
        "channels (lower upper, or number lower upper, or that and redshifts, as in CRIME); got a table of "
        f"shape {numbers.shape}. Write the centres to a file, one per line."
    )
