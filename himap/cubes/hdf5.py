"""Cubes in HDF5: a dataset of maps, one of frequencies, and what the attributes of these say.

Only what lies in the file itself is read. Nothing is guessed from a part of a name.
"""

from contextlib import contextmanager

import h5py
import numpy as np
from astropy import units as u

from himap.core.errors import InputError
from himap.cubes import containers
from himap.cubes.layout import Layout, SpherePixels, as_input_error, check_cube_room
from himap.maps.healpix_files import is_nested
from himap.maps.shapes import pixels_last, sphere_sizes

ENDINGS = (".h5", ".hdf5", ".hdf")

_FREQUENCIES = {"freq", "freqs", "frequency", "frequencies", "nu", "nus"}
_IN_UNIT = {f"{name}_{unit.lower()}": unit for name in _FREQUENCIES for unit in ("Hz", "kHz", "MHz", "GHz")}
_MASKS = {"mask", "masks", "flag", "flags"}
_MISSING = ("_FillValue", "missing_value")
_DEEPEST, _MOST = 32, 10_000  # groups in groups, and items: beyond, a file is made to keep readers busy
_LISTED = 20  # datasets in a message


def read_hdf5(path, *, maps_name=None, freqs_name=None, aside=(), held=1):
    """Maps (n_channels, n_pix) and `Layout` of a file; parameters as of `himap.cubes.files.read_maps_of`."""
    with _opened(path, aside) as file:
        fitting = [name for name, item in file.arrays.items() if item.ndim == 2 and sphere_sizes(item.shape)]
        if maps_name in (None, containers.MAPS) and freqs_name is None and containers.is_one(file):
            if maps_name is None and fitting:
                raise InputError(
                    f"{path} is a container with {containers.MAPS}, and has {fitting[0]} too; name the one "
                    "that is meant with --maps."
                )
            name, (freqs, place, remarks) = containers.MAPS, containers.axes(file)
            freqs_from, part = f"{containers.FREQS} of the container", (slice(None), place)
        else:
            name, part, remarks = _name_of_maps(file, maps_name, fitting), ..., ()
        item = file[name]
        shape = (item.shape[0], item.shape[-1])
        check_cube_room(path, np.prod(shape, dtype=float), item.dtype.itemsize, held)
        _check_no_mask(file, item.shape)
        maps = _unpacked(file, name, part)
        if part is ...:
            maps = pixels_last(maps)
            freqs, freqs_from = _freqs_of(file, freqs_name, len(maps))
        layout = Layout(
            pixels=SpherePixels.of(maps, _order(file, item)),
            freqs=freqs,
            freqs_from=freqs_from,
            nearly="" if freqs is not None else _nearly(file, len(maps)),
            unit=_text(item, "unit") or _text(file.file, "unit"),
            remarks=remarks,
        )
        return maps, layout


def read_dataset(path, word, *, held=1):
    """The numbers of the one dataset that is called `word`, in any group.

    Returns
    -------
    (ndarray, ndarray or None, bool or None)
        The numbers, in the shape that they have; frequencies and the order of pixels, as beside maps.

    Raises
    ------
    InputError
        There is none, or several; and as `read_hdf5`.
    """
    with _opened(path) as file:
        names = [name for name in (*file.arrays, *file.masks) if _last(name) == word]
        if len(names) != 1:
            listing = ", ".join(names[:_LISTED]) or file.listing()
            raise InputError(f"{path} must have one dataset called {word}; it has {listing}.")
        item = file[names[0]]
        check_cube_room(path, item.size, item.dtype.itemsize, held)
        values = item[...] if names[0] in file.masks else _unpacked(file, names[0])
        return values, _freqs_of(file, None, min(values.shape, default=0))[0], _order(file, item)


@contextmanager
def _opened(path, aside=()):
    """The `_Datasets` of a file."""
    with as_input_error(path, "HDF5"), h5py.File(path, "r") as file:
        yield _Datasets(path, file, aside)


class _Datasets:
    """The datasets in an open file, by name; what lies in other files is known, but not read.

    Attributes
    ----------
    items
        {name: dataset}, of all.
    arrays, masks
        Those of real numbers, and those that are called masks, whatever is in them; without what is `aside`.
    elsewhere
        Names of links to other files.
    """

    def __init__(self, path, file, aside):
        self.path, self.file, self.items, self.elsewhere, self._n = path, file, {}, set(), 0
        self._add("", file)
        file.visititems(self._add)  # each item once, whatever links lead to it
        known = {name: item for name, item in self.items.items() if _last(name) not in aside}
        self.masks = {name: item for name, item in known.items() if _last(name) in _MASKS}
        self.arrays = {n: item for n, item in known.items() if n not in self.masks and _is_numeric(item)}

    def _add(self, name, item):
        self._n += 1
        if name.count("/") > _DEEPEST or self._n > _MOST:
            raise InputError(
                f"{self.path} has groups more than {_DEEPEST} deep, or more than {_MOST} groups and "
                "datasets; write the cube to a file of its own."
            )
        if isinstance(item, h5py.Group):
            links = {f"{name}/{key}".lstrip("/"): item.get(key, getlink=True) for key in item}
            self.elsewhere |= {key for key, link in links.items() if isinstance(link, h5py.ExternalLink)}
        elif isinstance(item, h5py.Dataset):
            self.items[name] = item

    def named(self, name, option):
        """The dataset called `name`, which `option` of the command gave."""
        if name in self.elsewhere:
            raise InputError(f"{name} in {self.path} is a link to another file; name that file instead.")
        if name not in self.arrays:
            raise InputError(
                f"{self.path} has no dataset {name}; it has {self.listing()}. Name one of these ({option})."
            )
        return self[name]

    def __getitem__(self, name):
        """The dataset called `name`, if its numbers are in this file."""
        item = self.items[name]
        if item.is_virtual or item.external:
            raise InputError(
                f"the numbers of {name} in {self.path} are in another file; write them into one (h5repack)."
            )
        return item

    def listing(self):
        """What there is, for messages."""
        texts = [f"{name} {item.shape}" for name, item in self.arrays.items()]
        texts += [f"{name} in another file" for name in sorted(self.elsewhere)]
        more = [f"and {len(texts) - _LISTED} more"] if len(texts) > _LISTED else []
        return "; ".join(texts[:_LISTED] + more) or "no arrays of numbers"


def _is_numeric(item):
    try:
        return item.dtype.kind in "fiu" and item.shape is not None
    except TypeError:  # a type that numpy does not have
        return False


def _last(name):
    return name.rpartition("/")[2].lower()


def _text(item, *names):
    """The text of the attribute of one of these names, with an s or without, or None.

    Raises
    ------
    InputError
        Several are there, and say different things.
    """
    texts = {
        name: _decoded(value) if isinstance(value, bytes) else str(value)
        for name, value in item.attrs.items()
        if name.lower().removesuffix("s") in names
    }
    if len(set(texts.values())) > 1:
        both = ", ".join(f"{name} = {text!r}" for name, text in texts.items())
        raise InputError(f"attributes of {item.name} say different things: {both}. Delete what is wrong.")
    return next(iter(texts.values()), None)


def _decoded(value):
    try:
        return value.decode()
    except UnicodeDecodeError:
        return value.decode("latin-1")


def _order(file, item):
    """Whether the pixels of a dataset are in NESTED order, None where nothing says it."""
    return is_nested(_text(item, "order", "ordering") or _text(file.file, "order", "ordering"))


def _name_of_maps(file, name, fitting):
    """Which dataset has the maps: the one that is named, or the only one of `fitting`."""
    if name is not None:
        shape = file.named(name, "--maps").shape
        if len(shape) != 2 or not sphere_sizes(shape):
            raise InputError(
                f"{name} in {file.path} must be (n_channels, n_pix) with n_pix = 12 nside^2, got {shape}."
            )
        return name
    if len(fitting) != 1:
        listing = f"it has {file.listing()}"
        if fitting:
            more = ", ..." if len(fitting) > _LISTED else ""
            listing = f"{len(fitting)} are: {', '.join(fitting[:_LISTED])}{more}"
        raise InputError(
            f"{file.path}: one dataset must be (n_channels, n_pix) with n_pix = 12 nside^2, but {listing}. "
            "Name it with --maps."
        )
    return fitting[0]


def _check_no_mask(file, shape):
    """Refuse a mask beside the maps: whether its 1 means kept or masked only its author knows."""
    ends = (shape[0], shape[-1])
    alike = {shape, shape[::-1], ends, ends[::-1], *((n,) for n in sphere_sizes(ends))}
    for name, item in file.masks.items():
        if item.shape in alike:
            raise InputError(
                f"{file.path} has a mask, {name}, and does not say whether 1 means kept or masked: make "
                "the pixels that are not to be seen NaN in the maps, or write it as a FITS map of 1 where "
                f"kept for --mask, and delete the dataset (del file[{name!r}])."
            )


def _unpacked(file, name, part=...):
    """The numbers of (a part of) a dataset by the conventions of netCDF: NaN where missing, scaled, with an
    offset."""
    item = file[name]
    *missing, scale, offset = (
        _number(file, item, name, key) for key in (*_MISSING, "scale_factor", "add_offset")
    )
    if scale is not None and not (np.isfinite(scale) and scale):
        raise InputError(f"scale_factor of {name} in {file.path} must be a number other than 0, got {scale}.")
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


def _number(file, item, name, key):
    """The attribute `key` of a dataset, one number, or None where there is none."""
    if key not in item.attrs:
        return None
    try:
        value = np.asarray(item.attrs[key])
    except TypeError:
        value = np.empty(0)
    if value.size != 1 or value.dtype.kind not in "fiu":
        raise InputError(f"{key} of {name} in {file.path} must be one number, got {item.attrs[key]!r}.")
    return value.ravel()[0]


def _freqs_of(file, name, n_channels):
    """(frequencies in MHz, where they are from in words), (None, None) where no dataset states them."""
    if name is not None:
        if file.named(name, "--freqs-name").shape != (n_channels,):
            raise InputError(
                f"{file.path} must have a dataset {name} of {n_channels} frequencies; it has "
                f"{file.listing()}."
            )
        return _in_mhz(file, name), f"the dataset {name}"
    named = [
        dataset
        for dataset, item in file.arrays.items()
        if item.shape == (n_channels,) and _last(dataset) in {*_FREQUENCIES, *_IN_UNIT}
    ]
    values = [_in_mhz(file, dataset) for dataset in named]
    if any(not np.array_equal(values[0], others) for others in values[1:]):
        raise InputError(
            f"{file.path} has several datasets of frequencies: {', '.join(named[:_LISTED])}. Name the "
            "right one with --freqs-name."
        )
    return (values[0], f"the dataset {named[0]}") if named else (None, None)


def _nearly(file, n_channels):
    """A sentence on frequencies that are there, but not for these channels; empty where there are none."""
    for dataset, item in file.arrays.items():
        if _last(dataset) in _FREQUENCIES and len(item.shape) == 1:
            return (
                f"It has {n_channels} channels, and {item.shape[0]} frequencies in the dataset {dataset}: "
                "there must be one for each channel."
            )
    return ""


def _in_mhz(file, name):
    """Frequencies in MHz, by their unit; without one they are taken to be that."""
    stated, named = _text(file.arrays[name], "unit"), _IN_UNIT.get(_last(name))
    try:
        factor = float(u.Unit(stated or named or "MHz").to(u.MHz))
    except (ValueError, TypeError, RecursionError, u.UnitConversionError):
        raise InputError(
            f"frequencies must be in Hz, MHz or GHz, {name} in {file.path} says {stated!r}."
        ) from None
    if stated and named and not np.isclose(factor, u.Unit(named).to(u.MHz)):
        raise InputError(
            f"the dataset {name} in {file.path} says {stated!r}, which is not the unit of its name."
        )
    return _unpacked(file, name).astype(float) * factor
