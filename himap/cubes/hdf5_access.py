"""HDF5 files that are locked, their datasets by name, packed ones, and attributes as text and numbers."""

from contextlib import contextmanager, suppress

import h5py
import numpy as np

from himap.core.errors import InputError
from himap.core.reading import reading
from himap.cubes.layout import plain_pairs
from himap.maps.frames import frame_of, is_nested

_PACKING = {"_FillValue": 1, "missing_value": None, "scale_factor": 1, "add_offset": 1}
_PACKING |= {"valid_min": 1, "valid_max": 1, "valid_range": 2}  # of netCDF, how many numbers; None for any
_SCALE = ("scale_factor", "add_offset")

UNITS = ("unit", "bunit")
"""Attributes with a unit; the names of others follow."""

LISTED = 20
"""Datasets in a message."""

_ORDERS, _NESTED = ("order", "ordering", "healpix_order", "indexing_scheme"), ("nest", "nested")
_NSIDES, _PIXELS = ("nside", "healpix_nside"), {"pix", "pixel", "pixels", "ipix", "cell", "healpix_index"}
_FRAMES = ("coordsys", "coord", "frame", "coordinate_frame", "coordinate_system")
_SPECTRAL = ("specsys", "spectral_frame")
_STRUCTURE = {"class", "name", "axis", "grid_mapping", "_unsigned", "_netcdf4dimid"}  # of the file alone
_STRUCTURE |= {*UNITS, *_ORDERS, *_NESTED, *_NSIDES, *_FRAMES, *_SPECTRAL, *map(str.lower, _PACKING)}
_MASKS = {"mask", "masks", "flag", "flags"}
_WRITTEN = ["foreground", "residual"]  # the maps of a cleaned cube
_DEEPEST, _MOST = 32, 10_000  # groups in groups, and items: beyond, a file is made to keep readers busy


@contextmanager
def opened(path, aside=()):
    """The `Datasets` of the file called `path`, while it is read."""
    with reading(path, "HDF5"):
        try:
            file = h5py.File(path, "r")
        except OSError as error:
            if "unable to lock file" in str(error) or "already open for write" in str(error):
                raise InputError(
                    f"{path} cannot be locked: it is open for writing in another program, such as a notebook "
                    "(close it there, file.close(); after a program that crashed, h5clear -s makes it "
                    "readable), or its drive has no locks (if no program writes to it, set the environment "
                    "variable HDF5_USE_FILE_LOCKING=FALSE)."
                ) from None
            raise
        with file:
            yield Datasets(path, file, aside)


class Datasets:
    """The datasets in an open file, by name; what lies in other files is known, but not read.

    Attributes
    ----------
    items
        {name: dataset}, of all.
    arrays, masks
        Those of numbers, and those that are called masks, whatever is in them; without what is `aside`.
    elsewhere
        Names of links to other files.
    remarks
        What was chosen, for the user to read.
    """

    def __init__(self, path, file, aside):
        self.path, self.file, self.aside, self._n = path, file, aside, 0
        self.items, self.arrays, self.masks, self.elsewhere, self.remarks = {}, {}, {}, set(), []
        self._add("", file)
        file.visititems(self._add)  # each item once, whatever links lead to it

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
            if last_part(name) in _MASKS - {*self.aside}:
                self.masks[name] = item
            elif last_part(name) not in self.aside:
                with suppress(TypeError):  # a type that numpy does not have
                    if item.dtype.kind in "fiuc" and item.shape is not None:
                        self.arrays[name] = item

    def get(self, name, option=None):
        """The dataset called `name`, if its numbers are in this file; `option` of the command may give it."""
        if option is not None and name not in self.arrays:
            raise InputError(
                f"{self.path} has no dataset {name} of its own; it has {self.listing()}. Name one of these "
                f"({option}), or the file that it is in."
            )
        item = self.items[name]
        if item.is_virtual or item.external:
            raise InputError(
                f"the numbers of {name} in {self.path} are in another file; write them into one (h5repack)."
            )
        if item.dtype.kind == "c":
            raise InputError(
                f"{name} in {self.path} has complex numbers, and maps are real: if its real part is the sky, "
                f"write that, file[{name!r}][...].real, to a dataset of its own."
            )
        return item

    def maps(self, name, fitting, shape):
        """The dataset called `name` or, for None, the only one of `fitting`; of a cleaned cube, the residual.

        All that are `fitting` have the `shape`, a text, of a cube.
        """
        if name is not None:
            self.get(name, "--maps")
            fitting = [each for each in fitting if each == name]
        elif "himap" in self.file.attrs and {*_WRITTEN} <= {*fitting}:  # and mixing, of 12 nside^2 channels
            self.remarks.append("the residual of a cleaned cube is read, and not its foreground (--maps).")
            fitting = _WRITTEN[1:]
        if len(fitting) == 1:
            return self.get(fitting[0])
        more = ", ..." if len(fitting) > LISTED else ""
        listing = f"{len(fitting)} are: {', '.join(fitting[:LISTED])}{more}"
        raise InputError(
            f"{self.path}: one dataset must be {shape}, but "
            f"{listing if fitting else f'it has {self.listing()}'}. Name it with --maps."
        )

    def listing(self):
        """What there is, for messages."""
        texts = [f"{name} {item.shape}" for name, item in self.arrays.items()]
        texts += [f"{name} in another file" for name in sorted(self.elsewhere)]
        more = [f"and {len(texts) - LISTED} more"] if len(texts) > LISTED else []
        return "; ".join(texts[:LISTED] + more) or "no arrays of numbers"

    def check_pixels(self, item, pixels):
        """Refuse a mask next to maps, another nside than that of their `pixels`, and pixels in another order.

        Whether the 1 of a mask means kept or masked only its author knows.
        """
        for name in (name for name, one in self.masks.items() if pixels.shape[0] in (one.shape or ())):
            raise InputError(
                f"{self.path} has a mask, {name}, and does not say whether 1 means kept or masked: make "
                "the pixels that are not to be seen NaN in the maps, or write it as a FITS map of 1 where "
                f"kept for --mask, and delete the dataset (del file[{name!r}])."
            )
        nside = self.text(*_NSIDES, of=item)
        if nside not in (None, f"{pixels.nside}", f"{pixels.nside}.0"):
            raise InputError(f"{self.path} says nside {nside}, and {item.name[1:]} has {pixels}.")
        for name, one in self.arrays.items():
            numbers = one.shape == pixels.shape and last_part(name) in _PIXELS
            if numbers and (self.values(self.get(name)) != np.arange(*pixels.shape)).any():
                raise InputError(
                    f"{self.path} has pixels in an order of its own, {name}: write the maps in that of all "
                    "pixels from 0 on, and delete that dataset."
                )

    def text(self, *names, of):
        """The text of the attribute of one of these names, of a dataset, a group it is in or the file."""
        return next(filter(None, (text_of(place, *names) for place in self._places(of))), None)

    def _places(self, item):
        """A dataset, what netCDF names as its grid mapping, and the groups it is in, the file last."""
        parents = item.name.split("/")[1:-1]
        groups = ["/".join(parents[:n]) for n in range(len(parents), 0, -1)]
        mapping = text_of(item, "grid_mapping")
        named = [self.items.get(f"{group}/{mapping}".strip("/")) for group in (*groups, "")]
        return [item, *filter(None, named), *(self.file[group] for group in groups), self.file]

    def stated(self, item):
        """What the attributes of a dataset, and around it, say of it, for `Layout.of_sphere`, a dict."""
        pairs = {}
        for place in reversed(self._places(item)):  # what is closer to the dataset counts
            for name in place.attrs:
                with suppress(TypeError, OSError):  # a type that numpy does not have
                    pairs[name] = _plain(place.attrs[name])
        about, spectral_frame = plain_pairs(pairs, _STRUCTURE), self.text(*_SPECTRAL, of=item)
        about |= {"SPECSYS": spectral_frame} if spectral_frame else {}
        name = f"the frame of coordinates (an attribute of {self.path})"
        frame = frame_of(self.text(*_FRAMES, of=item), self.text("equinox", "EQUINOX", of=item), name)
        order, nested = self.text(*_ORDERS, of=item), self.text(*_NESTED, of=item)
        words = {"True": "NESTED", "1": "NESTED", "False": "RING", "0": "RING"}
        orders = {is_nested(word) for word in (order, words.get(nested, nested)) if word is not None}
        if len(orders) > 1:
            raise InputError(f"{self.path} says two orders of pixels, {order} and {nested}; delete one.")
        nested = next(iter(orders), None)
        return {"unit": self.text(*UNITS, of=item), "about": about, "nested": nested, "frame": frame}

    def values(self, item, part=..., *, fill=False):
        """(A part of) a dataset by the conventions of netCDF: NaN where missing, scaled, with an offset.

        With `fill` the value of chunks that were never written is one that is missing, unless it is 0.
        """
        try:
            stored = item[part]
        except OSError as error:
            raise InputError(
                f"{item.name[1:]} in {self.path} cannot be read ({error}). If it is compressed with a filter "
                "that is not installed here, point HDF5_PLUGIN_PATH at it (that of the package hdf5plugin is "
                "hdf5plugin.PLUGIN_PATH), or write the file again with gzip where the filter is "
                "(h5repack -f GZIP=4); if not, the file is damaged."
            ) from None
        numbers = {key: np.ravel(item.attrs[key]) for key in _PACKING if key in item.attrs}
        for key, given in numbers.items():
            n_right = _PACKING[key] or given.size
            is_right = given.dtype.kind in "fiu" and given.size == n_right
            if not is_right or (key in _SCALE and not np.isfinite(given).all()):
                raise InputError(
                    f"{key} of {item.name[1:]} in {self.path} must be numbers, {n_right}, and finite if "
                    f"maps are scaled by it; got {item.attrs[key]!r}."
                )
        defined = item.id.get_create_plist().fill_value_defined()
        if fill and defined == h5py.h5d.FILL_VALUE_USER_DEFINED and item.fillvalue:
            numbers.setdefault("_FillValue", np.ravel(item.fillvalue))
        if str(self.text("_unsigned", of=item)).lower() == "true" and stored.dtype.kind == "i":
            stored = stored.view(f"{stored.dtype.byteorder}u{stored.dtype.itemsize}")
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


def last_part(name):
    """The name of a dataset without its groups, in small letters."""
    return name.rpartition("/")[2].lower()


def text_of(item, *names):
    """The text of the attribute of one of these names, with an s or without, or None.

    Raises
    ------
    InputError
        Several are there, and say different things.
    """
    texts = {
        name: decoded(item.attrs[name])
        for name in item.attrs
        if {name.lower(), name.lower().removesuffix("s")} & {*names}
    }
    if len(set(texts.values())) > 1:
        both = ", ".join(f"{name} = {text!r}" for name, text in texts.items())
        raise InputError(f"attributes of {item.name} say different things: {both}. Delete what is wrong.")
    return next(iter(texts.values()), None)


def decoded(value):
    """A value, or an array of one, as text."""
    return str(_plain(value))


def _plain(value):
    """A value, or that of an array of one, as Python has it; bytes as text, by UTF-8 or else Latin-1."""
    value = value.item() if getattr(value, "size", None) == 1 else value
    try:
        return value.decode() if isinstance(value, bytes) else value
    except UnicodeDecodeError:
        return value.decode("latin-1")
