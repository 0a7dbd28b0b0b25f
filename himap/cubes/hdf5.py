"""Cubes in HDF5: a dataset of maps, one of frequencies, and what the attributes of these say.

Only what lies in the file itself is read. Nothing is guessed from a part of a name.
"""

from contextlib import contextmanager

import h5py
import numpy as np
from astropy import units as u

from himap.cubes import containers
from himap.cubes.hdf5_attributes import text_of
from himap.cubes.raw import RawCube, as_input_error, check_cube_room
from himap.errors import InputError
from himap.maps.healpix_files import is_nested
from himap.maps.shapes import pixels_last, sphere_sizes

__all__ = ["ENDINGS", "dataset_of_file", "maps_of_file"]

ENDINGS = (".h5", ".hdf5", ".hdf")

_FREQUENCIES = {"freq", "freqs", "frequency", "frequencies", "nu", "nus"}
_IN_UNIT = {f"{name}_{unit}": unit for name in _FREQUENCIES for unit in ("hz", "khz", "mhz", "ghz")}
_UNITS = {"hz": "Hz", "khz": "kHz", "mhz": "MHz", "ghz": "GHz"}
_MASKS = {"mask", "masks", "flag", "flags"}
_MISSING = ("_FillValue", "missing_value")
_DEEPEST, _MOST = 32, 10_000  # groups in groups, and items: beyond, a file is made to keep readers busy
_LISTED = 20  # datasets in a message


def maps_of_file(path, *, maps_name=None, freqs_name=None, held=1, aside=()):
    """The `RawCube` of an HDF5 file; parameters and errors as of `himap.cubes.files.read_raw`."""
    with _opened(path) as contents:
        contents.leave(aside)
        return _raw(contents, maps_name, freqs_name, held)


def dataset_of_file(path, word, *, held=1):
    """A `RawCube` with the numbers of the one dataset that is called `word`, in any group, as `maps`.

    Their shape is that in the file. Frequencies and the order of pixels are told as beside maps.

    Raises
    ------
    InputError
        There is none, or several; and as `maps_of_file`.
    """
    with _opened(path) as contents:
        names = [name for name in (*contents.arrays, *contents.masks) if _last(name) == word]
        if len(names) != 1:
            listing = contents.listing() if not names else ", ".join(names[:_LISTED])
            raise InputError(f"{path} must have one dataset called {word}; it has {listing}.")
        item = contents.own(names[0])
        check_cube_room(path, item.size, item.dtype.itemsize, held)
        values = item[...] if names[0] in contents.masks else _unpacked(contents, names[0])
        freqs, _ = _the_freqs(contents, None, min(values.shape, default=0))
        return RawCube(maps=values, freqs=freqs, nested=_order(contents, item))


@contextmanager
def _opened(path):
    """The `_Contents` of a file."""
    with as_input_error(path, "HDF5"), h5py.File(path, "r") as file:
        yield _Contents(path, file)


class _Contents:
    """The datasets of numbers in an open file, by name; what lies in other files is known, but not read.

    Attributes
    ----------
    arrays
        {name: dataset}, of real numbers.
    others
        {name: dataset}, of tables and words.
    masks
        {name: dataset} of those that are called so, whatever is in them.
    elsewhere
        Names of links to other files.
    """

    def __init__(self, path, file):
        self.path, self.file, self.elsewhere = path, file, set()
        self.arrays, self.others, self.masks = {}, {}, {}
        seen, waiting = {h5py.h5o.get_info(file.id).addr}, [("", 0, file)]
        while waiting:
            prefix, depth, group = waiting.pop()
            if depth > _DEEPEST or len(seen) + len(group) > _MOST:
                raise InputError(
                    f"{path} has groups more than {_DEEPEST} deep, or more than {_MOST} groups and datasets; "
                    "write the cube to a file of its own."
                )
            inner = []
            for key in group:
                name, link = f"{prefix}{key}", group.get(key, getlink=True)
                if isinstance(link, h5py.ExternalLink):
                    self.elsewhere.add(name)
                if not isinstance(link, h5py.HardLink):
                    continue
                item = group[key]
                address = h5py.h5o.get_info(item.id).addr
                if address in seen:
                    continue
                seen.add(address)
                if isinstance(item, h5py.Group):
                    inner.append((f"{name}/", depth + 1, item))
                elif isinstance(item, h5py.Dataset) and key.lower() in _MASKS:
                    self.masks[name] = item
                elif _is_numeric(item):
                    self.arrays[name] = item
                elif isinstance(item, h5py.Dataset):
                    self.others[name] = item
            waiting += reversed(inner)

    def dataset(self, name, option):
        """The dataset called `name`, which `option` of the command gave."""
        if name in self.elsewhere:
            raise InputError(f"{name} in {self.path} is a link to another file; name that file instead.")
        if name not in self.arrays:
            raise InputError(
                f"{self.path} has no dataset {name}; it has {self.listing()}. Name one of these ({option})."
            )
        return self.own(name)

    def own(self, name):
        """The dataset called `name`, if its numbers are in this file."""
        item = next(group[name] for group in (self.arrays, self.masks, self.others) if name in group)
        if item.is_virtual or item.external:
            raise InputError(
                f"the numbers of {name} in {self.path} are in another file; write them into one (h5repack)."
            )
        return item

    def leave(self, words):
        """Forget the datasets that are called one of these."""
        for found in (self.arrays, self.masks):
            for name in [name for name in found if _last(name) in words]:
                del found[name]

    def listing(self):
        """What there is, for messages."""
        texts = [f"{name} {item.shape}" for name, item in self.arrays.items()]
        texts += [f"{name} in another file" for name in sorted(self.elsewhere)]
        more = [f"and {len(texts) - _LISTED} more"] if len(texts) > _LISTED else []
        return "; ".join(texts[:_LISTED] + more) or "no arrays of numbers"


def _is_numeric(item):
    try:
        return isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu" and item.shape is not None
    except TypeError:  # a type that numpy does not have
        return False


def _raw(contents, maps_name, freqs_name, held):
    if maps_name in (None, containers.MAPS) and freqs_name is None and containers.is_one(contents):
        if maps_name is None and _fitting(contents):
            raise InputError(
                f"{contents.path} is a container with {containers.MAPS}, and has {_fitting(contents)[0]} "
                "too; name the one that is meant with --maps."
            )
        return _of_container(contents, held)
    name = _the_maps(contents, maps_name)
    maps = contents.own(name)
    check_cube_room(contents.path, maps.size, maps.dtype.itemsize, held)
    _check_no_mask(contents, maps.shape)
    values = pixels_last(_unpacked(contents, name))
    freqs, freqs_from = _the_freqs(contents, freqs_name, len(values))
    return RawCube(
        maps=values,
        freqs=freqs,
        freqs_from=freqs_from,
        nearly="" if freqs is not None else _nearly(contents, len(values)),
        unit=text_of(maps, "unit") or text_of(contents.file, "unit"),
        nested=_order(contents, maps),
    )


def _order(contents, item):
    """Whether the pixels of a dataset are in NESTED order, None where nothing says it."""
    return is_nested(text_of(item, "order", "ordering") or text_of(contents.file, "order", "ordering"))


def _of_container(contents, held):
    """The `RawCube` of a container of cora or draco: Stokes I of its maps."""
    freqs, place, remarks = containers.axes(contents)
    maps = contents.own(containers.MAPS)
    n_channels, _, n_pix = maps.shape
    check_cube_room(contents.path, n_channels * n_pix, maps.dtype.itemsize, held)
    _check_no_mask(contents, maps.shape)
    return RawCube(
        maps=_unpacked(contents, containers.MAPS, (slice(None), place)),
        freqs=freqs,
        freqs_from=f"{containers.FREQS} of the container",
        unit=text_of(maps, "unit") or text_of(contents.file, "unit"),
        nested=_order(contents, maps),
        remarks=remarks,
    )


def _the_maps(contents, name):
    path = contents.path
    if name is not None:
        shape = contents.dataset(name, "--maps").shape
        if len(shape) != 2 or not sphere_sizes(shape):
            raise InputError(
                f"{name} in {path} must be (n_channels, n_pix) with n_pix = 12 nside^2, got {shape}."
            )
        return name
    fitting = _fitting(contents)
    if len(fitting) != 1:
        listing = f"it has {contents.listing()}"
        if fitting:
            more = ", ..." if len(fitting) > _LISTED else ""
            listing = f"{len(fitting)} are: {', '.join(fitting[:_LISTED])}{more}"
        raise InputError(
            f"{path}: one dataset must be (n_channels, n_pix) with n_pix = 12 nside^2, but {listing}. "
            "Name it with --maps."
        )
    return fitting[0]


def _fitting(contents):
    """Names of the datasets that can be channels of a sphere."""
    return [name for name, item in contents.arrays.items() if item.ndim == 2 and sphere_sizes(item.shape)]


def _last(name):
    return name.rpartition("/")[2].lower()


def _check_no_mask(contents, shape):
    """Refuse a mask beside the maps: whether its 1 means kept or masked only its author knows."""
    ends = (shape[0], shape[-1])
    alike = {shape, shape[::-1], ends, ends[::-1], *((n,) for n in sphere_sizes(ends))}
    for name, item in contents.masks.items():
        if item.shape in alike:
            raise InputError(
                f"{contents.path} has a mask, {name}, and does not say whether 1 means kept or masked: make "
                "the pixels that are not to be seen NaN in the maps, or write it as a FITS map of 1 where "
                f"kept for --mask, and delete the dataset (del file[{name!r}])."
            )


def _unpacked(contents, name, part=...):
    """The numbers of (a part of) a dataset by the conventions of netCDF: NaN where missing, scaled, with an
    offset."""
    item = contents.own(name)
    missing = [_number(contents, item, name, key) for key in _MISSING]
    scale, offset = (_number(contents, item, name, key) for key in ("scale_factor", "add_offset"))
    if scale is not None and not (np.isfinite(scale) and scale):
        raise InputError(
            f"scale_factor of {name} in {contents.path} must be a number other than 0, got {scale}."
        )
    missing = [value for value in missing if value is not None]
    stored = item[part]
    if not missing and scale is None and offset is None:
        return stored
    values = stored.astype(np.result_type(stored.dtype, np.float32))
    for value in missing:
        values[stored == (stored.dtype.type(value) if stored.dtype.kind == "f" else value)] = np.nan
    values *= values.dtype.type(1 if scale is None else scale)
    values += values.dtype.type(0 if offset is None else offset)
    return values


def _number(contents, item, name, key):
    """The attribute `key` of a dataset, one number, or None where there is none."""
    if key not in item.attrs:
        return None
    try:
        value = np.asarray(item.attrs[key])
    except TypeError:
        value = np.empty(0)
    if value.size != 1 or value.dtype.kind not in "fiu":
        raise InputError(f"{key} of {name} in {contents.path} must be one number, got {item.attrs[key]!r}.")
    return value.ravel()[0]


def _the_freqs(contents, name, n_channels):
    """(frequencies in MHz, where they are from in words), (None, None) where no dataset tells them."""
    if name is not None:
        if contents.dataset(name, "--freqs-name").shape != (n_channels,):
            raise InputError(
                f"{contents.path} must have a dataset {name} of {n_channels} frequencies; it has "
                f"{contents.listing()}."
            )
        return _in_mhz(contents, name), f"the dataset {name}"
    named = [
        dataset
        for dataset, item in contents.arrays.items()
        if item.shape == (n_channels,) and (_last(dataset) in _FREQUENCIES or _last(dataset) in _IN_UNIT)
    ]
    if not named:
        return None, None
    values = [_in_mhz(contents, dataset) for dataset in named]
    if any(not np.array_equal(values[0], others) for others in values[1:]):
        raise InputError(
            f"{contents.path} has several datasets of frequencies: {', '.join(named[:_LISTED])}. Name the "
            "right one with --freqs-name."
        )
    return values[0], f"the dataset {named[0]}"


def _nearly(contents, n_channels):
    """A sentence on frequencies that are there, but not for these channels; empty where there are none."""
    for dataset, item in contents.arrays.items():
        if _last(dataset) in _FREQUENCIES and len(item.shape) == 1:
            return (
                f"It has {n_channels} channels, and {item.shape[0]} frequencies in the dataset {dataset}: "
                "there must be one for each channel."
            )
    return ""


def _in_mhz(contents, name):
    """Frequencies in MHz, by their unit; without one they are taken to be that."""
    item = contents.arrays[name]
    told, named = text_of(item, "unit"), _UNITS.get(_IN_UNIT.get(_last(name)))
    try:
        factor = float(u.Unit(told or named or "MHz").to(u.MHz))
    except (ValueError, TypeError, RecursionError, u.UnitConversionError):
        raise InputError(
            f"frequencies must be in Hz, MHz or GHz, {name} in {contents.path} says {told!r}."
        ) from None
    if told and named and not np.isclose(factor, u.Unit(named).to(u.MHz)):
        raise InputError(
            f"the dataset {name} in {contents.path} says {told!r}, which is not the unit of its name."
        )
    return _unpacked(contents, name).astype(float) * factor
