"""Cubes in HDF5: a dataset of maps, one of frequencies, and what the attributes of these say.

Only what lies in the file itself is read. Nothing is guessed from a part of a name. The containers of cora,
draco and caput (radiocosmology) have one exact structure: `map` with the axes (freq, pol, pixel), of the
sphere; `index_map/freq`, a table with a column `centre`, or plain numbers, both in MHz; and `index_map/pol`,
the names of the polarisations.
"""

from contextlib import contextmanager
from dataclasses import replace

import h5py
import numpy as np
from astropy import units as u

from himap.core.errors import InputError
from himap.cubes import hdf5_access as access
from himap.cubes.axes import pixels_by_axes
from himap.cubes.image_files import parts_of_headers
from himap.cubes.images import HEADERS, ImagePixels
from himap.cubes.layout import Layout, as_input_error, check_cube_room, plain_pairs
from himap.maps import sphere
from himap.maps.frames import FRAMES, frame_of, is_nested
from himap.maps.sphere import sphere_sizes

_FREQUENCIES = {"freq", "freqs", "frequency", "frequencies", "nu", "nus"}
_IN_UNIT = {f"{name}_{unit.lower()}": unit for name in _FREQUENCIES for unit in ("Hz", "kHz", "MHz", "GHz")}
_MASKS = {"mask", "masks", "flag", "flags"}
_MAP, _MAP_FREQS, _MAP_POLS = "map", "index_map/freq", "index_map/pol"  # of a container
_MAP_AXES = ["freq", "pol", "pixel"]
_UNITS, _ORDERS, _SPECTRAL = ("unit",), ("order", "ordering"), ("specsys", "spectral_frame")
_FRAMES = ("coordsys", "coord", "frame", "coordinate_frame", "coordinate_system")
_STRUCTURE = {"class", "name", "axis", "_unsigned", "_netcdf4dimid"}  # attributes that are of the file alone
_STRUCTURE |= {name.lower() for name in (*_UNITS, *_ORDERS, *_FRAMES, *_SPECTRAL, *access.PACKING)}
_WRITTEN = ["foreground", "residual"]  # the maps of a cleaned cube
_DEEPEST, _MOST = 32, 10_000  # groups in groups, and items: beyond, a file is made to keep readers busy
_LISTED = 20  # datasets in a message


def read_hdf5(path, *, maps_name=None, freqs_name=None, axes=None, aside=(), held=1):
    """Maps (n_channels, n_pix) and `Layout` of a file; parameters as of `himap.cubes.files.read_file`."""
    with _opened(path, aside) as file:
        if HEADERS in file.items:
            return _read_images(file, maps_name, held)
        fitting = [name for name, item in file.arrays.items() if item.ndim == 2 and sphere_sizes(item.shape)]
        container = maps_name in (None, _MAP) and freqs_name is None and file.is_container
        if container and maps_name is None and fitting:
            raise InputError(
                f"{path} is a container with {_MAP}, and has {fitting[0]} too; name the one that is meant "
                "with --maps."
            )
        if container and axes is not None:
            raise InputError(f"{path} is a container, whose axes are known; leave them (--axes) out.")
        name = _MAP if container else maps_name or file.only_one(fitting)
        item, part = file.get(name, "--maps"), ...
        if container:
            part, stated = _container_axes(file, item)
        elif item.ndim != 2 or not sphere_sizes(item.shape):
            raise InputError(
                f"{name} in {path} must be (n_channels, n_pix) with n_pix = 12 nside^2, got {item.shape}."
            )
        check_cube_room(path, item.shape[0] * float(item.shape[-1]), item.dtype.itemsize, held)
        file.check_no_mask(item.shape)
        maps = file.values(name, part)
        if not container:
            maps, remarks = pixels_by_axes(maps, axes)
            stated = {"remarks": remarks, **_freqs_of(file, freqs_name, len(maps))}
        stated |= {"unit": file.text(*_UNITS, of=item), "about": file.about(item)}
        layout = Layout.of_sphere(maps, file.is_nested(item), frame=file.frame(item), **stated)
        return maps, replace(layout, remarks=(*layout.remarks, *file.remarks))


def _read_images(file, name, held):
    """The maps and `Layout` of images, as `himap.cubes.writing` writes them, in an open file."""
    path, headers = file.path, file.items[HEADERS][...]
    pixels = ImagePixels(parts=parts_of_headers(path, [access.decoded(text) for text in headers]))
    n_channels = sum(part.n_channels for part in pixels.parts)
    if any(part.freqs is None for part in pixels.parts):  # uneven ones, which no axis states
        stated = _freqs_of(file, None, n_channels)
    else:
        freqs = np.concatenate([part.freqs for part in pixels.parts])
        stated = {"freqs": freqs, "freqs_from": f"the dataset {HEADERS}"}
    shape = (n_channels, *pixels.shape)
    name = name or file.only_one([name for name, item in file.arrays.items() if item.shape == shape])
    item = file.get(name, "--maps")
    if item.shape != shape:
        raise InputError(f"{name} in {path} must have the shape of its {HEADERS}, {shape}, got {item.shape}.")
    check_cube_room(path, item.size, item.dtype.itemsize, held)
    stated |= {"unit": file.text(*_UNITS, of=item), "about": file.about(item), "remarks": tuple(file.remarks)}
    return file.values(name).reshape(n_channels, -1), Layout(pixels=pixels, **stated)


def read_dataset(path, word, *, held=1):
    """The numbers of the one dataset that is called `word`, in any group, in the shape that they have.

    With them, as beside maps, frequencies, whether pixels are NESTED, their frame and SPECSYS, None where not
    stated. Raises an InputError where there is none, or several, and as `read_hdf5`.
    """
    with _opened(path) as file:
        names = [name for name in (*file.arrays, *file.masks) if _last(name) == word]
        if len(names) != 1:
            listing = ", ".join(names[:_LISTED]) or file.listing()
            raise InputError(f"{path} must have one dataset called {word}; it has {listing}.")
        item = file.get(names[0])
        check_cube_room(path, item.size, item.dtype.itemsize, held)
        values = access.read_stored(item, path) if names[0] in file.masks else file.values(names[0])
        freqs = _freqs_of(file, None, min(values.shape, default=0)).get("freqs")
        return values, freqs, file.is_nested(item), file.frame(item), file.about(item).get("SPECSYS")


def frames_in_hdf5(path):
    """The frame and SPECSYS that all arrays of two axes or more in a file state, as `files.frames_in`."""
    with _opened(path) as file:
        items = [item for item in file.arrays.values() if item.ndim > 1]
        stated = [{*map(file.frame, items)}, {file.about(item).get("SPECSYS") for item in items}]
    return tuple(one.pop() if len(one) == 1 else None for one in stated)


@contextmanager
def _opened(path, aside=()):
    """The `_Datasets` of the file called `path`, while it is read."""
    with as_input_error(path, "HDF5"), access.open_hdf5(path) as file:
        yield _Datasets(path, file, aside)


class _Datasets:
    """The datasets in an open file, by name; what lies in other files is known, but not read.

    Attributes
    ----------
    items
        {name: dataset}, of all.
    arrays, masks
        Those of real numbers, and those that are called masks, whatever is in them; without what is `aside`.
    complex
        Those of complex numbers, which are no maps.
    elsewhere
        Names of links to other files.
    remarks
        What was chosen, for the user to read.
    """

    def __init__(self, path, file, aside):
        self.path, self.file, self.items, self.elsewhere, self._n = path, file, {}, set(), 0
        self.remarks = []
        self._add("", file)
        file.visititems(self._add)  # each item once, whatever links lead to it
        known = {name: item for name, item in self.items.items() if _last(name) not in aside}
        self.masks = {name: item for name, item in known.items() if _last(name) in _MASKS}
        known = {name: item for name, item in known.items() if name not in self.masks}
        self.arrays = {name: item for name, item in known.items() if access.has_kind(item, "fiu")}
        self.complex = {name: item for name, item in known.items() if access.has_kind(item, "c")}

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

    @property
    def is_container(self):
        """Whether it is a container of maps: `map` of three axes beside an `index_map`."""
        has_index = any(name.startswith("index_map/") for name in {*self.items, *self.elsewhere})
        return has_index and _MAP in self.arrays and self.arrays[_MAP].ndim == 3

    def get(self, name, option=None):
        """The dataset called `name`, if its numbers are in this file; `option` of the command may give it."""
        if option is not None and name in self.elsewhere:
            raise InputError(f"{name} in {self.path} is a link to another file; name that file instead.")
        if option is not None and name in self.complex:
            raise InputError(
                f"{name} in {self.path} has complex numbers, and maps are real: if its real part is the sky, "
                f"write that, file[{name!r}][...].real, to a dataset of its own."
            )
        if option is not None and name not in self.arrays:
            raise InputError(
                f"{self.path} has no dataset {name}; it has {self.listing()}. Name one of these ({option})."
            )
        item = self.items[name]
        if item.is_virtual or item.external:
            raise InputError(
                f"the numbers of {name} in {self.path} are in another file; write them into one (h5repack)."
            )
        return item

    def only_one(self, fitting):
        """The only name of `fitting`; of a cleaned cube, the residual."""
        if "himap" in self.file.attrs and {*_WRITTEN} <= {*fitting}:  # and mixing, of 12 nside^2 channels
            self.remarks.append("the residual of a cleaned cube is read, and not its foreground (--maps).")
            return _WRITTEN[1]
        if len(fitting) == 1:
            return fitting[0]
        cubes = [name for name, item in self.complex.items() if item.ndim == 2 and sphere_sizes(item.shape)]
        if not fitting and len(cubes) == 1:
            self.get(cubes[0], "--maps")  # which says what to do
        more = ", ..." if len(fitting) > _LISTED else ""
        listing = f"{len(fitting)} are: {', '.join(fitting[:_LISTED])}{more}"
        raise InputError(
            f"{self.path}: one dataset must be (n_channels, n_pix) with n_pix = 12 nside^2, but "
            f"{listing if fitting else f'it has {self.listing()}'}. Name it with --maps."
        )

    def listing(self):
        """What there is, for messages."""
        texts = [f"{name} {item.shape}" for name, item in self.arrays.items()]
        texts += [f"{name} {item.shape} of complex numbers" for name, item in self.complex.items()]
        texts += [f"{name} in another file" for name in sorted(self.elsewhere)]
        more = [f"and {len(texts) - _LISTED} more"] if len(texts) > _LISTED else []
        return "; ".join(texts[:_LISTED] + more) or "no arrays of numbers"

    def check_no_mask(self, shape):
        """Refuse a mask beside the maps: whether its 1 means kept or masked only its author knows."""
        ends = (shape[0], shape[-1])
        alike = {shape, shape[::-1], ends, ends[::-1], *((n,) for n in sphere_sizes(ends))}
        for name in (name for name, item in self.masks.items() if item.shape in alike):
            raise InputError(
                f"{self.path} has a mask, {name}, and does not say whether 1 means kept or masked: make "
                "the pixels that are not to be seen NaN in the maps, or write it as a FITS map of 1 where "
                f"kept for --mask, and delete the dataset (del file[{name!r}])."
            )

    def text(self, *names, of):
        """The text of the attribute of one of these names, of a dataset, a group it is in or the file."""
        return next(filter(None, (access.text_of(place, *names) for place in self._places(of))), None)

    def _places(self, item):
        """A dataset and the groups it is in, the file last."""
        parents = item.name.split("/")[1:-1]
        return [item, *(self.file["/".join(parents[:n])] for n in range(len(parents), 0, -1)), self.file]

    def frame(self, item):
        """That of the coordinates of a dataset, as of `himap.maps.frames.frame_of`."""
        loose = frame_of(self.text("coordinate", of=item))  # netCDF lists other datasets there
        return frame_of(self.text(*_FRAMES, of=item)) or (loose if loose in FRAMES else None)

    def about(self, item):
        """What else attributes say, for `Layout.about`; what is closer to the dataset counts."""
        pairs = {}
        for place in reversed(self._places(item)):
            pairs |= {name: access.plain_value(place, name) for name in place.attrs}
        frame = self.text(*_SPECTRAL, of=item)
        return plain_pairs(pairs, _STRUCTURE) | ({"SPECSYS": frame} if frame else {})

    def is_nested(self, item):
        """Whether the pixels of a dataset are in NESTED order, None where nothing says it."""
        return is_nested(self.text("order", "ordering", of=item))

    def values(self, name, part=...):
        """The numbers of (a part of) a dataset by the conventions of netCDF: NaN where missing, scaled, with
        an offset."""
        item = self.get(name)
        unsigned = str(self.text("_unsigned", of=item)).lower() == "true"
        return access.unpacked(
            item, f"{name} in {self.path}", access.read_stored(item, self.path, part), unsigned=unsigned
        )


def _last(name):
    return name.rpartition("/")[2].lower()


def _freqs_of(file, name, n_channels):
    """What a `Layout` has of frequencies, in MHz: those and what states them, or what nearly does, a dict."""
    lines = {dataset: len(item) for dataset, item in file.arrays.items() if item.ndim == 1}
    if name is not None:
        if file.get(name, "--freqs-name").shape != (n_channels,):
            raise InputError(
                f"{file.path} must have a dataset {name} of {n_channels} frequencies; it has "
                f"{file.listing()}."
            )
        lines = {name: n_channels}
    else:
        lines = {dataset: n for dataset, n in lines.items() if _last(dataset) in {*_FREQUENCIES, *_IN_UNIT}}
    named = {dataset: _in_mhz(file, dataset) for dataset, n in lines.items() if n == n_channels}
    if named:
        first, *others = named
        if any(not np.array_equal(named[first], named[other]) for other in others):
            raise InputError(
                f"{file.path} has several datasets of frequencies: {', '.join([*named][:_LISTED])}. Name the "
                "right one with --freqs-name."
            )
        return {"freqs": named[first], "freqs_from": f"the dataset {first}"}
    for dataset, n in lines.items():
        text = f"It has {n_channels} channels, and {n} frequencies in the dataset {dataset}"
        return {"nearly": f"{text}: there must be one for each channel."}
    for item in (*file.arrays.values(), file.file):
        for key in item.attrs:
            if key.lower() in {*_FREQUENCIES, *_IN_UNIT} and np.size(item.attrs[key]) == n_channels:
                return {"nearly": f"It has an attribute {key} of that many numbers: write it as a dataset."}
    return {}


def _in_mhz(file, name):
    """Frequencies in MHz, by their unit; without one they are taken to be that."""
    stated, named = access.text_of(file.arrays[name], "unit"), _IN_UNIT.get(_last(name))
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
    return file.values(name).astype(float) * factor


def _container_axes(file, maps):
    """Which part of the `maps` of a container is Stokes I, and what its `Layout` has of channels, a dict."""
    path, (n_channels, n_pols, n_pix) = file.path, maps.shape
    axes = [access.decoded(name) for name in np.atleast_1d(maps.attrs.get("axis", _MAP_AXES))]
    if axes != _MAP_AXES or not sphere.is_n_pix(n_pix):
        raise InputError(
            f"{_MAP} in {path} must have the axes (freq, pol, pixel) and 12 nside^2 pixels, got {axes} and "
            f"{maps.shape}."
        )
    for name, length in ((_MAP_POLS, n_pols), (_MAP_FREQS, n_channels)):
        if name not in file.items:
            raise InputError(f"{path} has {_MAP} (freq, pol, pixel), but no {name} in its own file.")
        if file.get(name).shape != (length,):
            raise InputError(f"{name} in {path} must have {length} entries, got {file.get(name).shape}.")
    pols, table = file.items[_MAP_POLS], file.items[_MAP_FREQS]
    if not h5py.check_string_dtype(pols.dtype):
        raise InputError(f"{_MAP_POLS} in {path} must be names of polarisations, got {pols.dtype}.")
    names = [access.decoded(name) for name in access.read_stored(pols, path)]
    if names.count("I") != 1:
        raise InputError(
            f"{_MAP_POLS} in {path} must have I once, got {', '.join(names)}; write the intensity of "
            "each channel to a dataset of (channels, pixels)."
        )
    freqs = access.read_stored(table, path)
    freqs = freqs["centre"] if "centre" in (table.dtype.names or ()) else freqs
    if freqs.dtype.kind not in "fiu":
        raise InputError(
            f"{_MAP_FREQS} in {path} must be numbers, or a table with a column centre, in MHz; got "
            f"{table.dtype}."
        )
    others = ", ".join(name for name in names if name != "I")
    stated = {"freqs": freqs.astype(float), "freqs_from": f"{_MAP_FREQS} of the container"}
    stated["remarks"] = (f"Of the polarisations {others} are left out.",) if others else ()
    return (slice(None), names.index("I")), stated
