"""A cube of channel maps of one's own, as himap works with it: mK, frequencies ascending, HEALPix in RING."""

from dataclasses import dataclass, replace

import numpy as np

from himap.core.errors import InputError
from himap.cubes.files import read_file
from himap.cubes.layout import Layout, same_freqs
from himap.cubes.resolve import resolved
from himap.cubes.seeing import cube_floats, look_at, own_freqs, seen_everywhere, seen_somewhere, wide
from himap.cubes.weights import missing_remarks, own_datasets, voxel_weights
from himap.maps.healpix_files import MILLIKELVIN
from himap.removal.data import checked_mask, checked_weights

_HELD = 4  # cubes in float32 that cleaning holds at once beside the one in the file; measured with 0.1 GB
_BESIDE = 2  # of one beside another
_WEIGHED = 3  # more of them where there are weights


@dataclass(frozen=True, kw_only=True)
class Cube:
    """Channel maps, of the whole sky or of a part.

    Attributes
    ----------
    maps
        The seen pixels, (n_channels, n_seen), mK, by RING index; float32, or float64 where the file has it
        and the sky is so bright that float32 would round HI away (`himap.maps.blocked.precision`).
    freqs
        Channel centres, MHz, ascending, (n_channels,).
    mask
        Which pixels are seen in every channel, or with weights in some, (n_pix,) bool: those of the sphere,
        RING, or of an image.
    layout
        How it was given, a `himap.cubes.layout.Layout`: what is made of it is given back alike.
    remarks
        What was assumed or left out, for the user to read.
    weights
        Of the seen pixels, (n_seen,), or of their voxels, (n_channels, n_seen), 0 where one is missing: there
        maps are 0. None where all are the same.
    """

    maps: np.ndarray
    freqs: np.ndarray
    mask: np.ndarray
    layout: Layout
    remarks: tuple[str, ...] = ()
    weights: np.ndarray | None = None

    @property
    def missing(self):
        """Voxels of the seen pixels that are not seen, (n_channels, n_seen) bool, or None if all are."""
        return self.weights == 0 if np.ndim(self.weights) == 2 else None

    @property
    def freqs_from(self):
        """What stated the frequencies, in words."""
        return self.layout.freqs_from

    @property
    def summary(self):
        """What was read, a sentence for the user to check."""
        return (
            f"{len(self.freqs)} channels from {self.freqs[0]:.10g} to {self.freqs[-1]:.10g} MHz, told by "
            f"{self.freqs_from}; {self.layout.pixels.described(self.layout.unit)}."
        )

    @property
    def nside(self):
        """Of HEALPix maps; InputError for an image in the plane."""
        return self.layout.pixels.nside

    def check_sphere(self):
        """Refuse an image in the plane, with an InputError, where multipoles are asked for."""
        return self.nside

    @property
    def whole_sky(self):
        """Whether the whole sphere is seen."""
        return self.layout.pixels.whole_sky and bool(self.mask.all())

    @property
    def sky_mask(self):
        """The mask, where it leaves out any of the sphere; None for the whole sky."""
        return None if self.whole_sky else self.mask

    @property
    def image(self):
        """Which pixels of an image in the plane are seen, (n_y, n_x) bool; None for HEALPix maps."""
        pixels = self.layout.pixels
        return None if pixels.whole_sky else self.mask.reshape(pixels.shape)

    @property
    def channel_width(self):
        """MHz; the mean distance of two channels."""
        return float((self.freqs[-1] - self.freqs[0]) / (len(self.freqs) - 1))

    def within(self, mask):
        """The same `Cube` of the pixels that it sees and that `mask` (n_pix,) bool, of its pixels, keeps.

        Raises
        ------
        InputError
            A mask of another resolution, or that keeps nothing of what is seen.
        """
        kept = checked_mask(mask, len(self.mask)) & self.mask
        if not kept.any():
            raise InputError("the mask keeps no pixel that the cube sees; True (or 1) means kept.")
        return self._of(kept, f"{kept.mean():.1%} of {self.layout.pixels.area} is kept by the mask.")

    def seen_in(self, n_channels):
        """The same `Cube` of the pixels that are seen in so many channels or more.

        Raises
        ------
        InputError
            There is none, or a channel that none of them sees.
        """
        few = None if self.missing is None else np.count_nonzero(~self.missing, axis=0) < n_channels
        if few is None or not few.any():
            return self
        if few.all():
            raise InputError(f"no pixel is seen in {n_channels} channels or more.")
        kept = self.mask.copy()
        kept[kept] = ~few
        remark = f"{few.sum()} pixels are left out, which fewer than {n_channels} channels see."
        return self._of(kept, remark)

    def _of(self, kept, remark):
        """The same of the pixels in `kept`, all of them seen."""
        seen, weights = kept[self.mask], self.weights
        maps = self.maps[:, seen]
        if weights is not None:
            weights = checked_weights(weights[..., seen], maps.shape)[1]
        return replace(self, maps=maps, mask=kept, weights=weights, remarks=(*self.remarks, remark))

    def channels_of(self, other):
        """The same `Cube` without the channels that the file of `other` has, but `other` has not."""
        if len(other.freqs) == len(other.layout.freqs):
            return self
        near = same_freqs(self.freqs[:, None], other.freqs).any(axis=1)
        known = same_freqs(self.freqs[:, None], other.layout.freqs).any(axis=1)
        kept = near | ~known
        layout = replace(self.layout, channels=self.layout.channels[kept])
        return replace(self, maps=self.maps[kept], freqs=self.freqs[kept], layout=layout)

    def on_sphere(self, maps):
        """Maps (n, n_seen) with all pixels, (n, n_pix), 0 where nothing is seen; themselves if all is."""
        if self.whole_sky:
            return maps
        out = np.zeros((len(maps), len(self.mask)), dtype=maps.dtype)
        out[:, self.mask] = maps
        return out

    def seen_of(self, truth):
        """Maps of a truth of the same pixels and channels, (n_channels, n_seen), 0 where missing here."""
        true = truth.maps[:, self.mask[truth.mask]]
        return true if self.missing is None else np.where(self.missing, 0, true)


def read_cube(
    path,
    *,
    freqs=None,
    unit=None,
    order=None,
    maps_name=None,
    freqs_name=None,
    weights=None,
    flags=None,
):
    """A `Cube` from a file; see `himap.cubes.files.read_file` for the formats.

    Parameters
    ----------
    path
        File, or folder of files.
    freqs
        Channel centres in MHz, in the order of the channels in the file: an array, or the path of a file with
        one number a line, or of a table of edges (`himap.cubes.files.read_freqs`); for files that do not
        state them.
    unit
        "K", "mK" or "uK", if the file does not say.
    order
        "RING" or "NESTED", if the file does not say; RING unless given.
    maps_name, freqs_name
        Datasets of an HDF5 file.
    weights
        Hits or inverse variances, of which only ratios matter, 0 where not seen: of pixels, (n_pix,), or of
        voxels, (n_channels, n_pix), pixels and channels in the order of the file; or the path of such an
        array in .npy, of HEALPix maps in FITS, in any order of pixels, or of HDF5 with a dataset ``weights``.
    flags
        True (or 1) where a voxel, or all of a pixel, is bad: as `weights`, the dataset is called ``flags``.

    Raises
    ------
    InputError
        What is missing or contradicts the file, and how to give it.

    Notes
    -----
    With weights or flags a pixel that is missing in some channels is kept, and what is missing is filled, or
    left out, by the method. Without, the pixels that are seen in all channels are kept.
    """
    weighed = weights is not None or flags is not None
    names = {"maps_name": maps_name, "freqs_name": freqs_name, "aside": own_datasets(path, weights, flags)}
    maps, layout = read_file(path, **names, held=_HELD + _WEIGHED * weighed)
    layout = resolved(path, maps, layout, freqs=freqs, unit=unit, order=order)
    if weighed:
        weights = voxel_weights(maps, layout, weights=weights, flags=flags)
    return make_cube(maps, layout, weights=weights)


def read_truth(path, *, freqs=None, unit=None, order=None, maps_name=None, freqs_name=None, beside=None):
    """A `Cube` beside another: options as in `read_cube`, for what its own file does not say.

    Channels that are in the file of the cube `beside`, but left out of that, are left out.
    """
    try:
        maps, layout = read_file(path, held=_BESIDE)
    except InputError:
        if maps_name is None and freqs_name is None:
            raise
        maps, layout = read_file(path, maps_name=maps_name, freqs_name=freqs_name, held=_BESIDE)
    layout = resolved(path, maps, layout, freqs=freqs, unit=unit, order=order, only_gaps=True)
    truth = make_cube(maps, layout)
    return truth if beside is None else truth.channels_of(beside)


def make_cube(maps, layout, *, weights=None):
    """The `Cube` of maps as a file has them: sorted, in mK, RING, with the pixels seen in every channel.

    NaN, infinite and UNSEEN pixels are not seen. A channel without any seen pixel is left out. With weights,
    (n_in_file, n_pix) as `voxel_weights` gives them, pixels that are seen in some channel are kept.

    Parameters
    ----------
    maps, layout
        As of `himap.cubes.files.read_file`, complete.
    weights
        Of its voxels, 0 where missing.
    """
    remarks, pixels, factor = list(layout.remarks), layout.pixels, MILLIKELVIN[layout.unit]
    places = np.argsort(layout.freqs, kind="stable")
    if weights is None:
        channels, mask = seen_everywhere(maps, places, remarks)
    else:
        maps = np.where(weights > 0, maps, np.zeros((), maps.dtype))
        channels, mask = seen_somewhere(weights, places, remarks)
    freqs = own_freqs(layout.freqs[channels])
    if not mask.any():
        raise InputError(
            "no pixel is seen in every channel; leave out the channels that see least, or give weights or "
            "flags to a method that takes them: then what is missing is missing in its channel alone."
        )
    dtype = cube_floats(maps, channels, mask, factor)
    mask = pixels.sorted(mask)
    seen = np.empty((len(channels), int(mask.sum())), dtype=dtype)
    for place, out in zip(channels, seen, strict=True):
        out[:] = pixels.sorted(wide(maps[place]))[mask] * factor
    if not mask.all():
        where = "every" if weights is None else "some"
        remarks.append(f"{mask.mean():.1%} of {pixels.area} is seen in {where} channel; the rest is masked.")
    if weights is not None:
        weights = np.array([pixels.sorted(weights[place])[mask] for place in channels])
        remarks += missing_remarks(weights)
        weights = checked_weights(weights, weights.shape)[1]
    look_at(seen, freqs, remarks)
    layout = replace(layout, channels=channels)
    return Cube(maps=seen, freqs=freqs, mask=mask, layout=layout, remarks=tuple(remarks), weights=weights)
