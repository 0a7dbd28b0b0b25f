"""How a file has a cube: what it states of channels, units and pixels; and what all readers share."""

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
"""What is written of a cleaning, and of its pixels: of one cube, and none that is made of it."""

STRUCTURE = re.compile(
    r"SIMPLE|XTENSION|EXTEND|END|BITPIX|NAXIS\d*|[PG]COUNT|TFIELDS|THEAP|T[A-Z]{3,4}\d+|EXT(NAME|VER|LEVEL)"
    r"|CHECKSUM|DATASUM|DATE|PIXTYPE|ORDERING|NSIDE|(FIRST|LAST)PIX|INDXSCHM|OBJECT|OBS_NPIX|GRAIN|BAD_DATA"
    r"|COORDSYS|EQUINOX|RADE(C)?SYS|B?UNIT|FREQ|COMMENT|HISTORY|"
)
"""Keys of a header of FITS that are written anew, by what was read, or not at all."""

HELD = 4
"""Cubes in float32 that cleaning holds at once besides that in the file; measured with 0.1 GB."""

_LISTED = 20  # names in a message
_HELD_WEIGHTS = 3  # more of them for weights
_LARGEST = 1e15  # what is as large as this is no number: healpy marks missing pixels with -1.6e30
_ROUNDING = 1e-6  # relative: frequencies that are stated twice are the same
_KEY, _TEXT = re.compile(r"[A-Za-z0-9_-]{1,8}"), re.compile(r"[ -~]{0,60}")  # of a card in FITS


@dataclass(frozen=True, kw_only=True)
class SpherePixels:
    """HEALPix pixels: in a `Cube` RING, in its file NESTED or RING.

    Attributes
    ----------
    nside
        Of the maps.
    nested
        Whether the file has them in NESTED order; None where it does not say.
    partial
        Whether the file names the pixels that it has (explicit indexing).
    frame
        Of the coordinates, as of `himap.maps.frames.frame_of`; None where nothing says it.
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
        """Of a map."""
        return (12 * self.nside**2,)

    @property
    def order(self):
        """Of the file: "RING" or "NESTED"."""
        return "NESTED" if self.nested else "RING"

    def described(self, unit):
        """What they are, for a sentence."""
        return f"maps of nside {self} in {unit}, {self.order}, {frame_name(self.frame)}"

    def same(self, other):
        """Whether other pixels are of the same nside, in whatever order and frame."""
        return isinstance(other, SpherePixels) and self.nside == other.nside

    def in_hdf5(self, layout):
        """What HDF5 keeps of them, attributes {name: text}, and datasets {name: texts}."""
        return {"ordering": self.order} | {key.lower(): value for key, value in frame_cards(self.frame)}, {}

    def write(self, path, maps, layout, *, name, cards):
        """Write maps of `Layout.as_given` as FITS; `name` says what they are, `cards` go into the header."""
        names = [f"{name} {np.format_float_positional(freq, trim='-')} MHz" for freq in layout.freqs]
        order = {"nested": self.nested, "partial": self.partial, "frame": self.frame}
        cards = [*layout.cards, *cards]
        write_maps(path, maps, names=names, unit=layout.unit, cards=cards, **order)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How a file has a cube; None for what it does not state, until `read_cube` completes it.

    Attributes
    ----------
    pixels
        The `SpherePixels` or `himap.cubes.images.ImagePixels`.
    freqs
        MHz, of all channels in the file, those without a seen pixel included, (n_in_file,).
    freqs_from
        What states the frequencies, in words.
    unit
        Of the file, as text; "K", "mK" or "uK" once it is complete.
    remarks
        What was assumed or left out, for the user to read.
    names
        Of a folder the names of its files, one for each channel.
    about
        What else the file says of the maps, {name: text or number}, to be written again; of the frame of its
        frequencies SPECSYS, such as TOPOCENT or LSRK.
    channels
        For each channel of a `Cube` its place in the file, (n_channels,).
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
        _ = self.spectral_frame  # refuses a word that is none

    @classmethod
    def of_sphere(cls, maps, nested=None, *, partial=False, frame=None, **stated):
        """That of HEALPix maps (n_channels, n_pix); InputError for a number of pixels that no sphere has."""
        pixels = SpherePixels(nside=sphere.nside_of(maps), nested=nested, partial=partial, frame=frame)
        return cls(pixels=pixels, **stated)

    @property
    def spectral_frame(self):
        """SPECSYS, as of `himap.maps.frames.spectral_frame_of`; None where nothing says it."""
        return spectral_frame_of(self.about.get("SPECSYS"))

    @property
    def cards(self):
        """What of `about` a header of FITS can hold, a list of (key, value)."""
        return [
            (key.upper(), value)
            for key, value in self.about.items()
            if _KEY.fullmatch(key)
            and not STRUCTURE.fullmatch(key.upper())
            and (_TEXT.fullmatch(value) if isinstance(value, str) else np.isfinite(value))
        ]

    def noted(self, *remarks):
        """The same with more remarks."""
        return replace(self, remarks=(*self.remarks, *remarks))

    def joined(self, label, frame, spectral_frame=None, *, rotate=False):
        """The same with the frames of others where it states none, and remarks on what is assumed or rotated.

        The others, called `label`, have a frame of coordinates, as of `himap.maps.frames.frame_of`, and a
        spectral one, SPECSYS. An InputError where frames differ, but for those of coordinates that are known
        if the others may be rotated (`rotate`).
        """
        pixels, about, said = self.pixels, self.about, []
        mine, theirs = frame_name(pixels.frame), frame_name(frame)
        if rotate and not pixels.whole_sky:
            raise InputError(f"only HEALPix maps are rotated: reproject {label} to the header of the cube.")
        if pixels.whole_sky and frame != pixels.frame:
            if frame is None:
                said.append(f"{label} does not state its frame: assumed as that of the cube, {mine}.")
            elif pixels.frame is None:
                said.append(f"the cube does not state its frame: assumed as that of {label}, {theirs}.")
                pixels = replace(pixels, frame=frame)
            elif not rotate:
                raise InputError(
                    f"coordinates must be of one frame: that of {label} is {theirs} (COORDSYS = {frame}), of "
                    f"the cube {mine} (COORDSYS = {pixels.frame}). Rotate all to that of the cube with "
                    "rotate=True (--rotate), or correct the card that is wrong."
                )
            elif not {frame, pixels.frame} <= FRAMES.keys():
                known = ", ".join(FRAMES)
                raise InputError(f"{label} is {theirs}, the cube {mine}: only {known} can be rotated.")
            else:
                said.append(f"{label}: rotated, {theirs} to {mine}.")
        mine, theirs = self.spectral_frame, spectral_frame_of(spectral_frame)
        if mine is None and theirs is not None:
            about = about | {"SPECSYS": theirs}
            said.append(f"the cube does not state its spectral frame: assumed as that of {label}, {theirs}.")
        elif theirs not in (None, mine):
            raise InputError(
                f"{label} must have the spectral frame of the cube, SPECSYS = {mine}, and has {theirs}; "
                "convert one of them, or correct the card that is wrong."
            )
        return replace(self, pixels=pixels, about=about).noted(*said)

    def as_given(self, maps, mask):
        """Maps (n_channels, n_seen) of the pixels in `mask`, laid out as in the file; NaN elsewhere."""
        out = np.full((len(self.freqs), len(mask)), np.nan, dtype=maps.dtype)
        full_map = np.full(len(mask), np.nan, dtype=maps.dtype)
        order = sphere.nest_to_ring(self.pixels.nside) if self.pixels.nested else slice(None)
        for place, pixels in zip(self.channels, maps, strict=True):
            full_map[mask] = pixels / MILLIKELVIN[self.unit]
            out[place] = full_map[order]
        return out.reshape(-1, *self.pixels.shape)


def is_seen(pixels):
    """Which pixels are neither NaN nor infinite nor UNSEEN."""
    return np.abs(pixels.astype(np.result_type(pixels.dtype, np.float32), copy=False)) < _LARGEST


def same_freqs(first, second):
    """Which frequencies are the same but for their rounding, of two arrays that fit each other."""
    return np.isclose(first, second, rtol=_ROUNDING, atol=0)


def listed(names, separator=", "):
    """The first of some names, for a message, and how many more there are."""
    more = [f"and {len(names) - _LISTED} more"] if len(names) > _LISTED else []
    return separator.join([*names[:_LISTED], *more])


def plain_pairs(pairs, left_out=()):
    """Those of texts and numbers, a dict, without the names in `left_out` and those that himap writes."""
    plain = ((key, value) for key, value in pairs.items() if isinstance(value, str | int | float))
    return {key: value for key, value in plain if key.lower() not in {*left_out, *OURS}}


def only_value(path, what, values, names):
    """The value that all maps in `path` have; `what` it is, and their `names`, say where they differ."""
    first = {value: n for n, value in reversed([*enumerate(values)])}
    if len(first) > 1:
        each = (f"{values[n]} ({names[n]})" for n in sorted(first.values()))
        raise InputError(f"the maps in {path} must have one {what}, got {', '.join(each)}.")
    return values[0]


def check_cube_room(path, n_values, itemsize, *, weighed=False):
    """Refuse a cube of `n_values` voxels of `itemsize` bytes, with weights if `weighed`, that cannot fit."""
    held = HELD + _HELD_WEIGHTS * weighed
    check_room(f"work on {path}", PROCESS + n_values * (itemsize + 4 * held))
