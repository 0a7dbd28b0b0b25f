"""Layout of a cube in its file: channels, units and pixels; and helpers shared by all readers."""

import re
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from himap.core.errors import InputError
from himap.core.memory import PROCESS, check_room
from himap.maps import sphere
from himap.maps.frames import FRAMES, frame_cards, frame_name, spectral_frame_of
from himap.maps.healpix_io import MILLIKELVIN, write_maps

OURS = ("method", "parameters", "himap", "restart", "restarts", "failed", "remarks", "axes", "wcs")
"""Keys that describe a cleaning and its pixels: valid for one cube, not for cubes derived from it."""

STRUCTURE = re.compile(
    r"SIMPLE|XTENSION|EXTEND|END|BITPIX|NAXIS\d*|[PG]COUNT|TFIELDS|THEAP|T[A-Z]{3,4}\d+|EXT(NAME|VER|LEVEL)"
    r"|CHECKSUM|DATASUM|DATE|PIXTYPE|ORDERING|NSIDE|(FIRST|LAST)PIX|INDXSCHM|OBJECT|OBS_NPIX|GRAIN|BAD_DATA"
    r"|COORDSYS|EQUINOX|RADE(C)?SYS|B?UNIT|FREQ|COMMENT|HISTORY|"
)
"""Keys of FITS headers that are rewritten from the data read, or dropped."""

HELD = 4
"""Number of float32 cubes in memory during cleaning, in addition to that of the file; measured at 0.1 GB."""

_LISTED = 20  # names in a message
_HELD_WEIGHTS = 3  # additional cubes with weights
_LARGEST = 1e15  # larger values are not data: healpy marks missing pixels with -1.6e30
_ROUNDING = 1e-6  # relative tolerance for equal frequencies
_KEY, _TEXT = re.compile(r"[A-Za-z0-9_-]{1,8}"), re.compile(r"[ -~]{0,60}")  # of a card in FITS


@dataclass(frozen=True, kw_only=True)
class SpherePixels:
    """HEALPix pixels: RING in a `Cube`, NESTED or RING in its file.

    Attributes
    ----------
    nside
        Of the maps.
    nested
        Whether the file is in NESTED order; None if not stated.
    partial
        Whether the file lists its pixels (explicit indexing).
    frame
        Of the coordinates, as in `himap.maps.frames.frame_of`; None if not stated.
    """

    area: ClassVar[str] = "the sky"
    grid: ClassVar[str] = "nside"
    whole_sky: ClassVar[bool] = True
    nside: int
    nested: bool | None = None
    partial: bool = False
    frame: str | None = None

    def __str__(self):
        return f"{self.nside}"

    @property
    def shape(self):
        """Shape of a map."""
        return (12 * self.nside**2,)

    @property
    def order(self):
        """Of the file: "RING" or "NESTED"."""
        return "NESTED" if self.nested else "RING"

    def described(self, unit):
        """Description for a sentence."""
        return f"maps of nside {self} in {unit}, {self.order}, {frame_name(self.frame)}"

    def same(self, other):
        """Whether other pixels have the same nside, in any order and frame."""
        return isinstance(other, SpherePixels) and self.nside == other.nside

    def in_hdf5(self, layout):
        """Description stored in HDF5: attributes {name: text} and datasets {name: texts}."""
        return {"ordering": self.order} | {key.lower(): value for key, value in frame_cards(self.frame)}, {}

    def write(self, path, maps, layout, *, name, cards):
        """Write maps of `Layout.as_given` as FITS; `name` describes them, `cards` go into the header."""
        names = [f"{name} {np.format_float_positional(freq, trim='-')} MHz" for freq in layout.freqs]
        order = {"nested": self.nested, "partial": self.partial, "frame": self.frame}
        cards = [*layout.cards, *cards]
        write_maps(path, maps, names=names, unit=layout.unit, cards=cards, **order)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Layout of a cube in its file; None for anything not stated, until `read_cube` completes it.

    Attributes
    ----------
    pixels
        The `SpherePixels` or `himap.cubes.images.ImagePixels`.
    freqs
        MHz, of all channels in the file, including those without an observed pixel, (n_in_file,).
    freqs_from
        Source of the frequencies, in words.
    unit
        Of the file, as text; "K", "mK" or "uK" once complete.
    remarks
        Assumptions and omissions, for the user.
    names
        Names of the files of a folder, one per channel.
    about
        Other information of the file on the maps, {name: text or number}, copied to the output; SPECSYS for
        the frame of the frequencies, such as TOPOCENT or LSRK.
    channels
        Index in the file of each channel of a `Cube`, (n_channels,).
    """

    pixels: object
    freqs: np.ndarray | None = None
    freqs_from: str | None = None
    unit: str | None = None
    remarks: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    about: dict = field(default_factory=dict)
    channels: np.ndarray | None = None

    def __post_init__(self):
        _ = self.spectral_frame  # refuses an unknown frame

    @classmethod
    def of_sphere(cls, maps, nested=None, *, partial=False, frame=None, **stated):
        """The layout of HEALPix maps (n_channels, n_pix); InputError for an invalid number of pixels."""
        pixels = SpherePixels(nside=sphere.nside_of(maps), nested=nested, partial=partial, frame=frame)
        return cls(pixels=pixels, **stated)

    @property
    def spectral_frame(self):
        """SPECSYS, as in `himap.maps.frames.spectral_frame_of`; None if not stated."""
        return spectral_frame_of(self.about.get("SPECSYS"))

    @property
    def cards(self):
        """Entries of `about` that fit into a FITS header, a list of (key, value)."""
        return [
            (key.upper(), value)
            for key, value in self.about.items()
            if _KEY.fullmatch(key)
            and not STRUCTURE.fullmatch(key.upper())
            and (_TEXT.fullmatch(value) if isinstance(value, str) else np.isfinite(value))
        ]

    def noted(self, *remarks):
        """Add remarks."""
        return replace(self, remarks=(*self.remarks, *remarks))

    def joined(self, label, frame, spectral_frame=None, *, rotate=False):
        """Adopt the frames of other maps where none is stated; remarks on assumptions and rotation.

        The other maps, called `label`, have a frame of coordinates, as in `himap.maps.frames.frame_of`, and a
        spectral one, SPECSYS. InputError if frames differ, except for known frames of coordinates if `rotate`
        allows the rotation of the others.
        """
        pixels, about, said = self.pixels, self.about, []
        mine, theirs = frame_name(pixels.frame), frame_name(frame)
        if rotate and not pixels.whole_sky:
            raise InputError(f"only HEALPix maps are rotated: reproject {label} to the header of the cube.")
        if pixels.whole_sky and frame != pixels.frame:
            if frame is None:
                said.append(f"{label} does not state its frame: assumed to be that of the cube, {mine}.")
            elif pixels.frame is None:
                said.append(f"the cube does not state its frame: assumed to be that of {label}, {theirs}.")
                pixels = replace(pixels, frame=frame)
            elif not rotate:
                raise InputError(
                    f"frames of coordinates differ: that of {label} is {theirs} (COORDSYS = {frame}), that "
                    f"of the cube {mine} (COORDSYS = {pixels.frame}). Rotate all to that of the cube with "
                    "rotate=True (--rotate), or correct the wrong card."
                )
            elif not {frame, pixels.frame} <= FRAMES.keys():
                known = ", ".join(FRAMES)
                raise InputError(f"{label} is {theirs}, the cube {mine}: only {known} can be rotated.")
            else:
                said.append(f"{label}: rotated from {theirs} to {mine}.")
        mine, theirs = self.spectral_frame, spectral_frame_of(spectral_frame)
        if mine is None and theirs is not None:
            about = about | {"SPECSYS": theirs}
            said.append(f"the cube does not state its spectral frame: assumed as that of {label}, {theirs}.")
        elif theirs not in (None, mine):
            raise InputError(
                f"{label} must have the spectral frame of the cube, SPECSYS = {mine}, but has {theirs}; "
                "convert one of them, or correct the wrong card."
            )
        return replace(self, pixels=pixels, about=about).noted(*said)

    def as_given(self, maps, mask):
        """Maps (n_channels, n_seen) of the pixels in `mask`, in the layout of the file; NaN elsewhere."""
        out = np.full((len(self.freqs), len(mask)), np.nan, dtype=maps.dtype)
        full_map = np.full(len(mask), np.nan, dtype=maps.dtype)
        order = sphere.nest_to_ring(self.pixels.nside) if self.pixels.nested else slice(None)
        for place, pixels in zip(self.channels, maps, strict=True):
            full_map[mask] = pixels / MILLIKELVIN[self.unit]
            out[place] = full_map[order]
        return out.reshape(-1, *self.pixels.shape)


def is_seen(pixels):
    """Which pixels are neither NaN, infinite nor UNSEEN."""
    return np.abs(pixels.astype(np.result_type(pixels.dtype, np.float32), copy=False)) < _LARGEST


def same_freqs(first, second):
    """Which frequencies of two arrays that broadcast agree within rounding."""
    return np.isclose(first, second, rtol=_ROUNDING, atol=0)


def listed(names, separator=", "):
    """The first names of a list, for a message, and the number of others."""
    more = [f"and {len(names) - _LISTED} more"] if len(names) > _LISTED else []
    return separator.join([*names[:_LISTED], *more])


def plain_pairs(pairs, left_out=()):
    """Entries with texts and numbers, a dict, without names in `left_out` and those written by himap."""
    plain = ((key, value) for key, value in pairs.items() if isinstance(value, str | int | float))
    return {key: value for key, value in plain if key.lower() not in {*left_out, *OURS}}


def only_value(path, what, values, names):
    """The common value of all maps in `path`; errors use the description `what` and the `names`."""
    first = {value: n for n, value in reversed([*enumerate(values)])}
    if len(first) > 1:
        each = (f"{values[n]} ({names[n]})" for n in sorted(first.values()))
        raise InputError(f"the maps in {path} must have one {what}, got {', '.join(each)}.")
    return values[0]


def check_cube_room(path, n_values, itemsize, *, weighed=False):
    """Refuse a cube of `n_values` voxels of `itemsize` bytes, with weights if `weighed`, beyond memory."""
    held = HELD + _HELD_WEIGHTS * weighed
    check_room(f"work on {path}", PROCESS + n_values * (itemsize + 4 * held))
