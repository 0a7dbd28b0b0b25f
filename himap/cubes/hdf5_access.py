"""Access to HDF5 files: locks, datasets by name, packed datasets, and attributes as text and numbers."""

from contextlib import contextmanager, suppress

import h5py
import numpy as np

from himap.core.errors import InputError
from himap.core.reading import reading
from himap.cubes.layout import listed, plain_pairs
from himap.maps.frames import frame_of, is_nested

_PACKING = {"_FillValue": 1, "missing_value": None, "scale_factor": 1, "add_offset": 1}
_PACKING |= {"valid_min": 1, "valid_max": 1, "valid_range": 2}  # of netCDF: number of values; None for any
_SCALE = ("scale_factor", "add_offset")

_NAMES = {  # of attributes, in lower case and also with an s, and their meaning
    **dict.fromkeys(("unit", "bunit"), "unit"),
    **dict.fromkeys(("order", "ordering", "healpix_order", "indexing_scheme"), "order"),
    **dict.fromkeys(("nest", "nested"), "nested"),
    **dict.fromkeys(("nside", "healpix_nside"), "nside"),
    **dict.fromkeys(("coordsys", "coord", "frame", "coordinate_frame", "coordinate_system"), "frame"),
    **dict.fromkeys(("specsys", "spectral_frame"), "SPECSYS"),
    "equinox": "equinox",
}
_PIXELS = {"pix", "pixel", "pixels", "ipix", "cell", "healpix_index"}
_STRUCTURE = {"class", "name", "axis", "grid_mapping", "_unsigned", "_netcdf4dimid"}  # of the file only
_STRUCTURE |= {*_NAMES.values(), *map(str.lower, _PACKING)}
_MASKS = {"mask", "masks", "flag", "flags"}
_WRITTEN = {"foreground", "residual"}  # the maps of a cleaned cube
_DEEPEST, _MOST = 32, 10_000  # nested groups, and items: limits against malicious files


def meaning_of(name):
    """Meaning of an attribute of this name for the maps of a file, a value of `_NAMES`, or None."""
    return _NAMES.get(name.lower(), _NAMES.get(name.lower().removesuffix("s")))


@contextmanager
def opened(path, aside=()):
    """Context manager: the `Datasets` of the file called `path`."""
    with reading(path, "HDF5"):
        try:
            file = h5py.File(path, "r")
        except OSError as error:
            if "unable to lock file" in str(error) or "already open for write" in str(error):
                raise InputError(
                    f"{path} cannot be locked: it is open for writing in another program (close it there, "
                    "with file.close(); if that crashed, h5clear -s makes the file readable), or its drive "
                    "has no locks (if no program writes to it, set HDF5_USE_FILE_LOCKING=FALSE)."
                ) from None
            raise
        with file:
            yield Datasets(path, file, aside)


class Datasets:
    """The datasets in an open file, by name; data in external files are listed but not read.

    Attributes
    ----------
    items
        {name: dataset}, all datasets.
    arrays, masks
        Numeric datasets, and those called masks, whatever they contain; without those `aside`.
    elsewhere
        Names of links to other files.
    remarks
        Choices that were made, for the user.
    """

    def __init__(self, path, file, aside):
        self.path, self.file, self.aside, self._n = path, file, aside, 0
        self.items, self.arrays, self.masks, self.elsewhere, self.remarks = {}, {}, {}, set(), []
        self._add("", file)
        file.visititems(self._add)  # visits each item once, despite links

    def _add(self, name, item):
        self._n += 1
        if name.count("/") > _DEEPEST or self._n > _MOST:
            raise InputError(
                f"{self.path} has more than {_MOST} groups and datasets, or more than {_DEEPEST} nested "
                "groups; write the cube to a separate file."
            )
        if isinstance(item, h5py.Group):
            links = {f"{name}/{key}".lstrip("/"): item.get(key, getlink=True) for key in item}
            self.elsewhere |= {key for key, link in links.items() if isinstance(link, h5py.ExternalLink)}
        elif isinstance(item, h5py.Dataset):
            self.items[name] = item
            if last_part(name) in _MASKS - {*self.aside}:
                self.masks[name] = item
            elif last_part(name) not in self.aside:
                with suppress(TypeError):  # a type unknown to numpy
                    if item.dtype.kind in "fiuc" and item.shape is not None:
                        self.arrays[name] = item

    def get(self, name, option=None):
        """The dataset called `name`, if its data are in this file; `option` is where the name was given."""
        if option is not None and name not in self.arrays:
            raise InputError(
                f"{self.path} has no dataset {name} in the file itself; it has {self.listing()}. Name one of "
                f"these ({option}), or the file that contains it."
            )
        item = self.items[name]
        if item.is_virtual or item.external:
            raise InputError(
                f"the data of {name} in {self.path} are in another file; write them into one (h5repack)."
            )
        if item.dtype.kind == "c":
            raise InputError(
                f"{name} in {self.path} has complex numbers, and maps are real: if its real part is the sky, "
                f"write that, file[{name!r}][...].real, to a separate dataset."
            )
        return item

    def maps(self, name, fitting, shape):
        """The dataset called `name` or, for None, the only one of `fitting`; the residual of a cleaned cube.

        `fitting` have the shape of a cube, `shape` in words.
        """
        if name is not None:
            self.get(name, "--maps")
            chosen = [each for each in fitting if each == name]
        elif "himap" in self.file.attrs and {*fitting} >= _WRITTEN:  # and mixing, of 12 nside^2 channels
            self.remarks.append("the residual of a cleaned cube is read, not its foreground (--maps).")
            chosen = ["residual"]
        else:
            chosen = fitting
        if len(chosen) == 1:
            return self.get(chosen[0])
        wanted = f"{self.path}: {name or 'one dataset'} must be {shape}, but"
        if fitting:
            are = f"{'only ' * (name is not None)}{len(fitting)} {'is' if len(fitting) == 1 else 'are'}"
            raise InputError(f"{wanted} {are}: {listed(fitting)}. Name it with --maps.")
        raise InputError(
            f"{wanted} the file has {self.listing()}: write the maps in this shape to a dataset of their own "
            "(of Stokes parameters I alone, and without axes of length 1)."
        )

    def listing(self):
        """Description of the contents, for messages."""
        texts = [f"{name} {item.shape}" for name, item in self.arrays.items()]
        texts += [f"{name} in another file" for name in sorted(self.elsewhere)]
        return listed(texts, "; ") or "no arrays of numbers"

    def check_pixels(self, item, pixels):
        """Refuse a mask next to maps, and nside or order that differ from those of their `pixels`."""
        for name in (name for name, one in self.masks.items() if pixels.shape[0] in (one.shape or ())):
            raise InputError(
                f"{self.path} has a mask, {name}, and does not state whether 1 means kept or masked: set "
                "masked pixels to NaN in the maps, or write it as a FITS map of 1 where kept for --mask, and "
                f"delete the dataset (del file[{name!r}])."
            )
        nside = self.attributes(item).get("nside", pixels.nside)
        if str(nside) not in (f"{pixels.nside}", f"{pixels.nside}.0"):
            raise InputError(f"{self.path} states nside {nside}, but {item.name[1:]} has {pixels}.")
        for name, one in self.arrays.items():
            numbers = one.shape == pixels.shape and last_part(name) in _PIXELS
            if numbers and (self.values(self.get(name)) != np.arange(*pixels.shape)).any():
                raise InputError(
                    f"{self.path} has its own pixel order, {name}: write the maps in the order of all pixels "
                    "from 0 on, and delete that dataset."
                )

    def attributes(self, item):
        """The `attributes_of` a dataset, its grid mapping in netCDF, its groups and the file."""
        said, place, mapping = attributes_of(item), item, plain(item.attrs.get("grid_mapping"))
        while place.name != "/":
            place = place.parent
            named = self.items.get(f"{place.name}/{mapping}".lstrip("/"))
            for one in filter(None, (named, place)):
                said = attributes_of(one) | said
        return said

    def stated(self, item):
        """Values stated by attributes of a dataset and around it, for `Layout.of_sphere`, a dict."""
        said = self.attributes(item)
        texts = {what: str(said[what]) for what in _NAMES.values() if what in said}
        about = plain_pairs(said | texts, _STRUCTURE)
        name = f"the frame of coordinates (an attribute of {self.path})"
        frame = frame_of(texts.get("frame"), texts.get("equinox"), name)
        order, nested = texts.get("order"), texts.get("nested")
        words = {"True": "NESTED", "1": "NESTED", "False": "RING", "0": "RING"}
        orders = {is_nested(word) for word in (order, words.get(nested, nested)) if word is not None}
        if len(orders) > 1:
            raise InputError(f"{self.path} states two pixel orders, {order} and {nested}; delete one.")
        return {"unit": texts.get("unit"), "about": about, "nested": next(iter(orders), None), "frame": frame}

    def values(self, item, part=..., *, fill=False):
        """(Part of) a dataset by the conventions of netCDF: NaN where missing, with scale and offset.

        With `fill`, the value of unwritten chunks is treated as missing, unless it is 0.
        """
        try:
            stored = item[part]
        except OSError as error:
            raise InputError(
                f"{item.name[1:]} in {self.path} cannot be read ({error}): it is damaged, or compressed with "
                "a filter that is not installed here. Set HDF5_PLUGIN_PATH to its folder (for the package "
                "hdf5plugin, hdf5plugin.PLUGIN_PATH), or compress with gzip instead (h5repack -f GZIP=4)."
            ) from None
        numbers = {key: np.ravel(item.attrs[key]) for key in _PACKING if key in item.attrs}
        for key, given in numbers.items():
            n_right = _PACKING[key] or given.size
            is_right = given.dtype.kind in "fiu" and given.size == n_right
            if not is_right or (key in _SCALE and not np.isfinite(given).all()):
                raise InputError(
                    f"{key} of {item.name[1:]} in {self.path} must be {n_right} numbers, finite if they "
                    f"scale maps; got {item.attrs[key]!r}."
                )
        defined = item.id.get_create_plist().fill_value_defined()
        if fill and defined == h5py.h5d.FILL_VALUE_USER_DEFINED and item.fillvalue:
            numbers.setdefault("_FillValue", np.ravel(item.fillvalue))
        stored, numbers = self._with_sign(item, stored, numbers)
        if not numbers:
            return stored
        values = stored.astype(np.result_type(stored.dtype, np.float32))
        for value in (*numbers.get("_FillValue", ()), *numbers.get("missing_value", ())):
            values[stored == (stored.dtype.type(value) if stored.dtype.kind == "f" else value)] = np.nan
        low, high = numbers.get("valid_range", (-np.inf, np.inf))
        values[stored < max(low, *numbers.get("valid_min", [low]))] = np.nan
        values[stored > min(high, *numbers.get("valid_max", [high]))] = np.nan
        values *= values.dtype.type(numbers.get("scale_factor", [1])[0])
        values += values.dtype.type(numbers.get("add_offset", [0])[0])
        return values

    def _with_sign(self, item, stored, numbers):
        """Integers, and the numbers that mark some of them, with or without sign as `_Unsigned` says."""
        kinds = {"true": "iu", "false": "ui"}.get(str(plain(item.attrs.get("_Unsigned"))).lower())
        if kinds is None or stored.dtype.kind != kinds[0]:
            return stored, numbers
        stored, marks = stored.view(stored.dtype.str.replace(*kinds)), {*numbers} - {*_SCALE}
        for key in marks:
            if numbers[key].dtype.kind == "f":
                raise InputError(
                    f"{key} of {item.name[1:]} in {self.path} must be an integer, as its maps with _Unsigned "
                    f"are; got {item.attrs[key]!r}."
                )
        return stored, numbers | {key: numbers[key].astype(stored.dtype) for key in marks}


def last_part(name):
    """The name of a dataset without its groups, in lower case."""
    return name.rpartition("/")[2].lower()


def attributes_of(place):
    """{meaning: value} of the attributes of a dataset or group, by `meaning_of` or else their names.

    InputError if several with the same meaning differ.
    """
    said, spelled = {}, {}
    for name in place.attrs:
        what = meaning_of(name) or name
        with suppress(TypeError, OSError):  # a type unknown to numpy
            value = plain(place.attrs[name])
            if str(said.get(what, value)) != str(value):
                both = f"{spelled[what]} = {str(said[what])!r}, {name} = {str(value)!r}"
                raise InputError(
                    f"attributes of {place.name} contradict each other: {both}. Delete the wrong one."
                )
            if str(value):
                said[what], spelled[what] = value, name
    return said


def plain(value):
    """A value, or that of an array of size one, as a Python object; bytes become text (UTF-8 or Latin-1)."""
    value = value.item() if getattr(value, "size", None) == 1 else value
    try:
        return value.decode() if isinstance(value, bytes) else value
    except UnicodeDecodeError:
        return value.decode("latin-1")
