"""HDF5 files that are locked, their datasets by name, packed ones, and attributes as text and numbers."""

import re
from contextlib import contextmanager, suppress

import h5py
import numpy as np

from himap.core.errors import InputError
from himap.core.reading import reading
from himap.cubes.layout import plain_pairs
from himap.maps.frames import frame_of, is_nested
from himap.maps.sphere import sphere_sizes

_MISSING, _SCALE, _LIMITS = (  # of netCDF
    ("_FillValue", "missing_value"),
    ("scale_factor", "add_offset"),
    ("valid_min", "valid_max", "valid_range"),
)
_PACKING = dict.fromkeys((*_MISSING, *_SCALE, *_LIMITS), "a number")  # and what each must be
_PACKING |= {"valid_range": "two numbers", "scale_factor": "a finite number other than 0"}
_PACKING |= {"add_offset": "a finite number"}

UNITS = ("unit", "bunit")
"""Attributes with a unit; the names of others follow."""

MAP = "map"
"""The dataset of maps in a container."""

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

_FILTERS = {32001: "blosc", 32004: "lz4", 32008: "bitshuffle", 32013: "zfp", 32015: "zstd", 32026: "blosc2"}
_HELD_ELSEWHERE = (11, 13, 35)  # errno of a file that another process locks; others: the drive has no locks


@contextmanager
def opened(path, aside=()):
    """The `Datasets` of the file called `path`, while it is read."""
    with reading(path, "HDF5"):
        try:
            file = h5py.File(path, "r")
        except OSError as error:
            number = re.search(r"unable to lock file, errno = (\d+)", str(error))
            if number is not None and int(number[1]) not in _HELD_ELSEWHERE:
                raise InputError(
                    f"{path} cannot be locked: its drive has no locks. If no program writes to it, set the "
                    "environment variable HDF5_USE_FILE_LOCKING=FALSE and try again."
                ) from None
            if number is not None or "already open for write" in str(error):
                raise InputError(
                    f"{path} is open for writing in another program, such as a notebook: close it there "
                    "(file.close()). After a program that crashed, h5clear -s makes it readable."
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
        known = {name: item for name, item in self.items.items() if last_part(name) not in aside}
        self.masks = {name: item for name, item in known.items() if last_part(name) in _MASKS}
        known = {name: item for name, item in known.items() if name not in self.masks}
        self.arrays = {name: item for name, item in known.items() if _has_kind(item, "fiu")}
        self.complex = {name: item for name, item in known.items() if _has_kind(item, "c")}

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
        return has_index and MAP in self.arrays and self.arrays[MAP].ndim == 3

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
        cubes = [name for name, item in self.complex.items() if item.ndim == 2 and sphere_sizes(item.shape)]
        if len(fitting or cubes) == 1:
            return (fitting or cubes)[0]  # of complex numbers `get` says what to do
        more = ", ..." if len(fitting) > LISTED else ""
        listing = f"{len(fitting)} are: {', '.join(fitting[:LISTED])}{more}"
        raise InputError(
            f"{self.path}: one dataset must be (n_channels, n_pix) with n_pix = 12 nside^2, but "
            f"{listing if fitting else f'it has {self.listing()}'}. Name it with --maps."
        )

    def listing(self):
        """What there is, for messages."""
        texts = [f"{name} {item.shape}" for name, item in self.arrays.items()]
        texts += [f"{name} {item.shape} of complex numbers" for name, item in self.complex.items()]
        texts += [f"{name} in another file" for name in sorted(self.elsewhere)]
        more = [f"and {len(texts) - LISTED} more"] if len(texts) > LISTED else []
        return "; ".join(texts[:LISTED] + more) or "no arrays of numbers"

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

    def check_pixels(self, item, pixels):
        """Refuse another nside beside a dataset of maps than theirs, and pixels in an order of their own."""
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
            pairs |= {name: _plain_value(place, name) for name in place.attrs}
        spectral_frame = self.text(*_SPECTRAL, of=item)
        about = plain_pairs(pairs, _STRUCTURE) | ({"SPECSYS": spectral_frame} if spectral_frame else {})
        stated = {"unit": self.text(*UNITS, of=item), "about": about}
        return stated | {"nested": self._is_nested(item), "frame": self._frame(item)}

    def _frame(self, item):
        name = f"the frame of coordinates (an attribute of {self.path})"
        stated = frame_of(self.text(*_FRAMES, of=item), name=name)
        with suppress(InputError):  # netCDF lists other datasets there
            return stated or frame_of(self.text("coordinate", of=item))
        return None

    def _is_nested(self, item):
        order, nested = self.text(*_ORDERS, of=item), self.text(*_NESTED, of=item)
        words = {"True": "NESTED", "1": "NESTED", "False": "RING", "0": "RING"}
        stated = {is_nested(word) for word in (order, words.get(nested, nested)) if word is not None}
        if len(stated) > 1:
            raise InputError(f"{self.path} says two orders of pixels, {order} and {nested}; delete one.")
        return next(iter(stated), None)

    def values(self, item, part=...):
        """(A part of) a dataset by the conventions of netCDF: NaN where missing, scaled, with an offset."""
        unsigned = str(self.text("_unsigned", of=item)).lower() == "true"
        return _unpacked(item, self.path, read_stored(item, self.path, part), unsigned)


def last_part(name):
    """The name of a dataset without its groups, in small letters."""
    return name.rpartition("/")[2].lower()


def read_stored(item, path, part=...):
    """(A part of) a dataset as it is stored; InputError where a filter it needs is not installed."""
    try:
        return item[part]
    except OSError:
        how = item.id.get_create_plist()
        filters = [how.get_filter(n) for n in range(how.get_nfilters())]
        missing = [
            _FILTERS.get(number, name.decode(errors="replace") or f"number {number}")
            for number, _, _, name in filters
            if not h5py.h5z.filter_avail(number)
        ]
        if not missing:
            raise
        raise InputError(
            f"{item.name[1:]} in {path} is compressed with a filter that is not installed here, "
            f"{', '.join(missing)}: point HDF5_PLUGIN_PATH at it (that of the package hdf5plugin is "
            "hdf5plugin.PLUGIN_PATH), or write the file again with gzip where the filter is "
            "(h5repack -f GZIP=4)."
        ) from None


def _unpacked(item, path, stored, unsigned):
    """The numbers `stored` of a dataset; `unsigned` says whether its integers are, though not by type."""
    numbers = {}
    for key, right in _PACKING.items():
        numbers[key] = np.ravel(item.attrs[key]) if key in item.attrs else np.empty(0)
        n_right = {"valid_range": 2, "missing_value": max(1, numbers[key].size)}.get(key, 1)
        if key in item.attrs and (
            numbers[key].dtype.kind not in "fiu"
            or numbers[key].size != n_right
            or (key in _SCALE and not np.isfinite(numbers[key]).all())
            or (key == "scale_factor" and not numbers[key].all())
        ):
            raise InputError(f"{key} of {item.name[1:]} in {path} must be {right}, got {item.attrs[key]!r}.")
    if unsigned and stored.dtype.kind == "i":
        stored = stored.view(f"{stored.dtype.byteorder}u{stored.dtype.itemsize}")
    if not any(values.size for values in numbers.values()):
        return stored
    values = stored.astype(np.result_type(stored.dtype, np.float32))
    for value in (value for key in _MISSING for value in numbers[key]):
        values[stored == (stored.dtype.type(value) if stored.dtype.kind == "f" else value)] = np.nan
    for low in (*numbers["valid_range"][:1], *numbers["valid_min"]):
        values[stored < low] = np.nan
    for high in (*numbers["valid_range"][1:], *numbers["valid_max"]):
        values[stored > high] = np.nan
    for scale in numbers["scale_factor"]:
        values *= values.dtype.type(scale)
    for offset in numbers["add_offset"]:
        values += values.dtype.type(offset)
    return values


def _has_kind(item, kinds):
    """Whether a dataset has numbers of one of these kinds, letters as of numpy."""
    try:
        return item.dtype.kind in kinds and item.shape is not None
    except TypeError:  # a type that numpy does not have
        return False


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
    """A value, or an array of one, as text, of bytes by UTF-8 or else Latin-1."""
    value = value.item() if isinstance(value, np.ndarray) and value.size == 1 else value
    try:
        return value.decode() if isinstance(value, bytes) else str(value)
    except UnicodeDecodeError:
        return value.decode("latin-1")


def _plain_value(item, name):
    """An attribute as text or a number, None if it is something else."""
    try:
        value = item.attrs[name]
    except (TypeError, OSError):  # a type that numpy does not have
        return None
    if isinstance(value, str | bytes):
        return decoded(value)
    return value.item() if isinstance(value, np.generic) else None
