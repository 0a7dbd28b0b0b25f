"""A cube of channel maps of one's own, as himap works with it: mK, RING, float32, frequencies ascending."""

from dataclasses import dataclass, replace

import numpy as np

from himap.checks import checked_freqs, real_array
from himap.cubes.files import read_freqs, read_raw
from himap.errors import InputError
from himap.maps import sphere
from himap.maps.healpix_files import MILLIKELVIN, is_nested, temperature_unit, to_ring
from himap.removal.masked import checked_kept

__all__ = ["Cube", "Layout", "make_cube", "read_cube", "read_truth"]

_ROUNDING = 1e-6  # relative: frequencies that are told twice are the same
_UNEVEN = 1.01  # largest distance of neighbouring channels over the smallest
_LARGEST = 1e15  # healpy marks missing pixels with -1.6e30


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How the cube was given, so that what is made of it can be given back alike.

    Attributes
    ----------
    channels
        For each channel of the `Cube` its place in the file, (n_channels,).
    freqs
        MHz, of all channels in the file, those without a seen pixel included, (n_in_file,).
    unit
        Of the file: "K", "mK" or "uK".
    nested
        Whether its pixels are in NESTED order.
    """

    channels: np.ndarray
    freqs: np.ndarray
    unit: str
    nested: bool

    def as_given(self, maps, mask):
        """Maps (n_channels, n_seen) of the pixels in `mask`, laid out as in the file; NaN elsewhere."""
        out = np.full((len(self.freqs), len(mask)), np.nan, dtype=np.float32)
        full_map = np.full(len(mask), np.nan, dtype=np.float32)
        ring = sphere.nest_to_ring(sphere.nside_of(mask)) if self.nested else slice(None)
        for place, pixels in zip(self.channels, maps, strict=True):
            full_map[mask] = pixels / MILLIKELVIN[self.unit]
            out[place] = full_map[ring]
        return out


@dataclass(frozen=True, kw_only=True)
class Cube:
    """Channel maps, of the whole sky or of a part.

    Attributes
    ----------
    maps
        The seen pixels, (n_channels, n_seen) float32, mK, by RING index.
    freqs
        Channel centres, MHz, ascending, (n_channels,).
    mask
        Which pixels of the sphere are seen in every channel, (n_pix,) bool, RING.
    layout
        How it was given, a `Layout`.
    remarks
        What was taken for granted or left out, for the user to read.
    """

    maps: np.ndarray
    freqs: np.ndarray
    mask: np.ndarray
    layout: Layout
    remarks: tuple[str, ...] = ()

    @property
    def nside(self):
        return sphere.nside_of(self.mask)

    @property
    def whole_sky(self):
        """Whether the whole sphere is seen."""
        return bool(self.mask.all())

    @property
    def channel_width(self):
        """MHz; the mean distance of two channels."""
        return float((self.freqs[-1] - self.freqs[0]) / (len(self.freqs) - 1))

    def within(self, mask):
        """The same `Cube` of the pixels that it sees and that `mask` (n_pix,) bool, RING, keeps.

        Raises
        ------
        InputError
            A mask of another resolution, or that keeps nothing of what is seen.
        """
        kept = checked_kept(mask, len(self.mask)) & self.mask
        if not kept.any():
            raise InputError("the mask keeps no pixel that the cube sees; True (or 1) means kept.")
        remark = f"{kept.mean():.1%} of the sky is kept by the mask."
        maps, remarks = self.maps[:, kept[self.mask]], (*self.remarks, remark)
        return replace(self, maps=maps, mask=kept, remarks=remarks)

    def on_sphere(self, maps):
        """Maps (n, n_seen) on the whole sphere, (n, n_pix), 0 where nothing is seen; themselves if all is."""
        if self.whole_sky:
            return maps
        out = np.zeros((len(maps), len(self.mask)), dtype=maps.dtype)
        out[:, self.mask] = maps
        return out


def read_cube(path, *, freqs=None, unit=None, order=None, maps_name=None, freqs_name=None):
    """A `Cube` from a file; see `read_raw` for the formats.

    Parameters
    ----------
    path
        File, or folder of files.
    freqs
        Channel centres in MHz, in the order of the channels in the file: an array, or the path of a file with
        one number a line; for files that do not tell them.
    unit
        "K", "mK" or "uK", if the file does not say.
    order
        "RING" or "NESTED", if the file does not say; RING unless given.
    maps_name, freqs_name
        Datasets of an HDF5 file.

    Raises
    ------
    InputError
        What is missing or contradicts the file, and how to give it.
    """
    raw = read_raw(path, maps_name=maps_name, freqs_name=freqs_name)
    return make_cube(_with_freqs(path, raw, freqs), unit=unit, order=order)


def read_truth(path, *, freqs=None, unit=None, order=None, maps_name=None, freqs_name=None):
    """A `Cube` beside another: options as in `read_cube`, for what its own file does not say."""
    try:
        raw = read_raw(path)
    except InputError:
        if maps_name is None and freqs_name is None:
            raise
        raw = read_raw(path, maps_name=maps_name, freqs_name=freqs_name)
    raw = _with_freqs(path, raw, freqs if raw.freqs is None else None)
    return make_cube(
        raw, unit=unit if raw.unit is None else None, order=order if raw.nested is None else None
    )


def _with_freqs(path, raw, freqs):
    """The `RawCube` with frequencies, its own or `freqs`, an array or a path."""
    if freqs is not None:
        freqs = read_freqs(freqs) if isinstance(freqs, str) or hasattr(freqs, "__fspath__") else freqs
        freqs = real_array("freqs", freqs).astype(float)
        if raw.freqs is not None and not (freqs.shape == raw.freqs.shape and _same(freqs, raw.freqs)):
            raise InputError(
                f"{path} tells its frequencies, {_ends(raw.freqs)}, and those given are {_ends(freqs)}, or "
                "in another order; leave them out, or mend the file."
            )
        raw = replace(raw, freqs=freqs)
    if raw.freqs is None:
        raise InputError(
            f"{path} does not tell its frequencies; give them with freqs= (--freqs FILE), MHz, or name "
            "their dataset (--freqs-name)."
        )
    return raw


def make_cube(raw, *, unit=None, order=None):
    """The `Cube` of a `RawCube`: sorted, in mK, RING, with the pixels that are seen in every channel.

    NaN, infinite and UNSEEN pixels are not seen. A channel without any seen pixel is left out.
    """
    remarks = []
    unit = _unit(raw.unit, unit)
    nested = _is_nested(raw.nested, order, remarks)
    sphere.nside_of(raw.maps)
    freqs = np.asarray(raw.freqs, dtype=float)
    if freqs.shape != (len(raw.maps),):
        raise InputError(
            f"there must be one frequency for each of the {len(raw.maps)} channels, got {freqs.size}."
        )
    channels, mask = _seen(raw.maps, np.argsort(freqs, kind="stable"), remarks)
    file_freqs, freqs = freqs, _checked_freqs(freqs[channels])
    if not mask.any():
        raise InputError("no pixel is seen in every channel; leave out the channels that see least.")
    if nested:
        mask = to_ring(mask)
    maps = np.empty((len(channels), int(mask.sum())), dtype=np.float32)
    for place, out in zip(channels, maps, strict=True):
        pixels = _wide(raw.maps[place])
        out[:] = (to_ring(pixels) if nested else pixels)[mask] * MILLIKELVIN[unit]
    if not mask.all():
        remarks.append(f"{mask.mean():.1%} of the sky is seen in every channel; the rest is masked.")
    _look_at(maps, freqs, remarks)
    layout = Layout(channels=channels, freqs=file_freqs, unit=unit, nested=nested)
    return Cube(maps=maps, freqs=freqs, mask=mask, layout=layout, remarks=tuple(remarks))


def _checked_freqs(freqs):
    """Ascending frequencies; which of them are equal, if some are."""
    twice = freqs[1:][np.diff(freqs) == 0]
    if len(twice):
        raise InputError(f"two channels have the frequency {twice[0]:g} MHz; leave one of them out.")
    return checked_freqs(freqs, len(freqs))


def _look_at(maps, freqs, remarks):
    """Say what is odd about a cube, and may be a mistake: zeros, constant channels, uneven ones."""
    if not maps.any():
        raise InputError("all maps are zero.")
    constant = [freq for freq, pixels in zip(freqs, maps, strict=True) if pixels.min() == pixels.max()]
    if constant and maps.shape[1] > 1:
        names = ", ".join(f"{freq:g}" for freq in constant[:5])
        remarks.append(f"{len(constant)} channels have one value everywhere, as dead ones: {names} MHz.")
    empty = np.mean(~maps.any(axis=0))
    if empty:
        remarks.append(f"{empty:.1%} of the pixels are 0 in all channels; make them NaN if they are missing.")
    steps = np.diff(freqs)
    if steps.max() > _UNEVEN * steps.min():
        remarks.append(
            f"channels are {steps.min():g} to {steps.max():g} MHz apart; P(k) takes them as evenly spaced."
        )


def _same(freqs, file_freqs):
    return np.allclose(freqs, file_freqs, rtol=_ROUNDING, atol=0)


def _ends(freqs):
    return f"{freqs.size} from {freqs.min():g} to {freqs.max():g} MHz" if freqs.size else "none"


def _seen(maps, order, remarks):
    """Of the channels in `order` those that see anything, and the pixels that all of these see."""
    channels, mask = [], np.ones(maps.shape[1], dtype=bool)
    for place in order:
        seen = np.abs(_wide(maps[place])) < _LARGEST  # False for NaN
        if seen.any():
            channels.append(place)
            mask &= seen
    if len(channels) < 2:
        raise InputError(f"a cube needs two channels with seen pixels, got {len(channels)} of {len(maps)}.")
    if len(channels) < len(maps):
        remarks.append(f"{len(maps) - len(channels)} of {len(maps)} channels see nothing and are left out.")
    return np.array(channels), mask


def _wide(pixels):
    """Pixels in no less than float32: float16 ends at 65504."""
    return pixels.astype(np.result_type(pixels, np.float32), copy=False)


def _unit(file_unit, user_unit):
    """The name of the unit, from what the file and the user say."""
    units = {temperature_unit(text) for text in (file_unit, user_unit) if text is not None}
    if not units:
        raise InputError("the file does not say whether its maps are in K or mK; give unit= (--unit).")
    if len(units) > 1:
        raise InputError(
            f"the file says {file_unit}, but the unit given is {user_unit}; leave it out, or mend the file."
        )
    return units.pop()


def _is_nested(file_nested, order, remarks):
    if order is None:
        if file_nested is None:
            remarks.append(
                "the file does not say the order of its pixels: taken as RING (--order to change it)."
            )
        return bool(file_nested)
    nested = is_nested(str(order), "order")
    if file_nested is not None and file_nested != nested:
        raise InputError(
            f"the file says {'NESTED' if file_nested else 'RING'}, but the order given is {order}."
        )
    return nested
