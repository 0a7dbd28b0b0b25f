"""Cubes in HDF5: a dataset of maps, one of frequencies, and their attributes.

Only data in the file itself are read, and only exact names are recognised. The containers of cora, draco and
caput (radiocosmology) have a fixed structure: `map` with the axes (freq, pol, pixel), of the sphere;
`index_map/freq`, a table with a column `centre`, or plain numbers, both in MHz; and `index_map/pol`, the
names of the polarisations.
"""

import math

import numpy as np
from astropy import units as u

from himap.core.errors import InputError
from himap.cubes import hdf5_access as access
from himap.cubes.axes import pixel_axis
from himap.cubes.fits import pixels_of_headers
from himap.cubes.images import HEADERS
from himap.cubes.layout import Layout, check_cube_room, listed
from himap.maps import sphere
from himap.maps.sphere import sphere_sizes

_FREQUENCIES = {"freq", "freqs", "frequency", "frequencies", "nu", "nus"}
_IN_UNIT = {f"{name}_{unit.lower()}": unit for name in _FREQUENCIES for unit in ("Hz", "kHz", "MHz", "GHz")}
_MAP, _MAP_FREQS, _MAP_POLS, _MAP_AXES = "map", "index_map/freq", "index_map/pol", ["freq", "pol", "pixel"]


def read_hdf5(path, *, maps_name=None, freqs_name=None, axes=None, aside=()):
    """Maps (n_channels, n_pix) and `Layout` of a file; parameters as in `himap.cubes.files.read_file`."""
    with access.opened(path, aside) as file:
        has_index = any(name.startswith("index_map/") for name in {*file.items, *file.elsewhere})
        is_container = has_index and getattr(file.arrays.get(_MAP), "ndim", 0) == 3
        is_container = is_container and maps_name in (None, _MAP) and freqs_name is None
        if (HEADERS in file.items or is_container) and (freqs_name, axes) != (None, None):
            raise InputError(f"{path} states its axes and channels; omit --axes and --freqs-name.")
        if HEADERS in file.items:
            return _read_images(file, maps_name)
        fitting = [name for name, item in file.arrays.items() if item.ndim == 2 and sphere_sizes(item.shape)]
        fitting += [_MAP] * is_container
        item = file.maps(maps_name, fitting, "(n_channels, n_pix) with n_pix = 12 nside^2")
        if is_container:
            part, stated = _container_axes(file, item)
            pixels = 1
        else:
            is_freqs = [n in _frequencies_in(file, freqs_name).values() for n in item.shape]
            if axes is None and sum(is_freqs) == 1:
                axes = "freq,pixel" if is_freqs[0] else "pixel,freq"
            pixels, remarks = pixel_axis(item.shape, axes)
            part, stated = ..., {"remarks": remarks, **_freqs_of(file, freqs_name, item.shape[1 - pixels])}
        check_cube_room(path, item.shape[0] * float(item.shape[-1]), item.dtype.itemsize)
        maps = file.values(item, part, fill=True)
        maps = maps if pixels else maps.T
        layout = Layout.of_sphere(maps, **file.stated(item), **stated)
        file.check_pixels(item, layout.pixels)
        return maps, layout.noted(*file.remarks)


def _read_images(file, name):
    """Maps and `Layout` of images in an open file, as written by `himap.cubes.writing`."""
    headers = [access.plain(text) for text in file.items[HEADERS][...]]
    pixels = pixels_of_headers(file.path, headers)
    n_channels = sum(part.n_channels for part in pixels.parts)
    shape = (n_channels, *pixels.shape)
    fitting = [name for name, item in file.arrays.items() if item.shape == shape]
    item = file.maps(name, fitting, f"{shape}, as in its {HEADERS}")
    check_cube_room(file.path, math.prod(shape), item.dtype.itemsize)
    stated = _freqs_of(file, None, n_channels) | {"remarks": tuple(file.remarks)}
    stated |= {key: file.stated(item)[key] for key in ("unit", "about")}
    return file.values(item).reshape(n_channels, -1), Layout(pixels=pixels, **stated)


def read_dataset(path, word):
    """Numbers of the only dataset called `word`, in any group, and attributes for `Layout.of_sphere`.

    Errors as in `read_hdf5`, and if there is no such dataset, or several.
    """
    with access.opened(path) as file:
        names = [name for name in (*file.arrays, *file.masks) if access.last_part(name) == word]
        if len(names) != 1:
            raise InputError(
                f"{path} must have one dataset called {word}; it has {listed(names) or file.listing()}."
            )
        item = file.get(names[0])
        check_cube_room(path, math.prod(item.shape), item.dtype.itemsize)
        values = file.values(item)
        return values, file.stated(item) | _freqs_of(file, None, min(values.shape, default=0))


def _frequencies_in(file, name):
    """{dataset: number} of frequencies, of the dataset called `name`, or for None of all known names."""
    if name is not None:
        items = {name: file.get(name, "--freqs-name")}
    else:
        known = {*_FREQUENCIES, *_IN_UNIT}
        items = {each: item for each, item in file.arrays.items() if access.last_part(each) in known}
    return {each: len(item) for each, item in items.items() if item.ndim == 1}


def _freqs_of(file, name, n_channels):
    """Frequencies in MHz and a description of their source, a dict for a `Layout`."""
    lines, named = _frequencies_in(file, name), {}
    if name is not None and lines.get(name) != n_channels:
        raise InputError(
            f"{file.path} must have a dataset {name} of {n_channels} frequencies; it has {file.listing()}."
        )
    for dataset in (dataset for dataset, n in lines.items() if n == n_channels):
        usual = _IN_UNIT.get(access.last_part(dataset), "MHz")
        unit = str(access.attributes_of(file.arrays[dataset]).get("unit", usual))
        try:
            factor = float(u.Unit(unit).to(u.MHz))
        except (ValueError, TypeError, RecursionError, u.UnitConversionError):
            raise InputError(
                f"frequencies must be in Hz, MHz or GHz, {dataset} in {file.path} has {unit!r}."
            ) from None
        named[dataset] = file.values(file.get(dataset)).astype(float) * factor
    if not named:
        return {}
    first, *others = named
    if any(not np.array_equal(named[first], named[other]) for other in others):
        raise InputError(
            f"{file.path} has several datasets of frequencies: {listed([*named])}. Name one with "
            "--freqs-name."
        )
    return {"freqs": named[first], "freqs_from": f"the dataset {first}"}


def _container_axes(file, maps):
    """Index of Stokes I in the `maps` of a container, and its channels, a dict for a `Layout`."""
    path, (n_channels, n_pols, n_pix) = file.path, maps.shape
    for name in (_MAP_POLS, _MAP_FREQS):
        if name not in file.items:
            raise InputError(f"{path} has {_MAP} (freq, pol, pixel), but no {name} in the same file.")
    axes = [access.plain(name) for name in np.atleast_1d(maps.attrs.get("axis", _MAP_AXES))]
    names, freqs = (file.values(file.get(name)) for name in (_MAP_POLS, _MAP_FREQS))
    names = [str(access.plain(name)) for name in names.ravel()]
    freqs = freqs["centre"] if "centre" in (freqs.dtype.names or ()) else freqs
    is_right = axes == _MAP_AXES and sphere.is_n_pix(n_pix) and len(names) == n_pols
    if not (is_right and freqs.shape == (n_channels,) and freqs.dtype.kind in "fiu"):
        raise InputError(
            f"{path}: a container must have {_MAP} with the axes (freq, pol, pixel) and 12 nside^2 pixels, "
            f"{_MAP_POLS} with the names of its polarisations, and {_MAP_FREQS} with a frequency per channel "
            f"in MHz, or a table with a column centre; got axes {axes} of {maps.shape}, {len(names)} names "
            f"and frequencies {freqs.dtype} {freqs.shape}. Write the intensity as (channels, pixels)."
        )
    if names.count("I") != 1:
        raise InputError(
            f"{_MAP_POLS} in {path} must contain I once, got {', '.join(names)}; write the intensity of each "
            "channel to a dataset of (channels, pixels)."
        )
    others = ", ".join(name for name in names if name != "I")
    stated = {"freqs": freqs.astype(float), "freqs_from": f"{_MAP_FREQS} of the container"}
    stated["remarks"] = (f"The polarisations {others} are ignored.",) if others else ()
    return (slice(None), names.index("I")), stated
