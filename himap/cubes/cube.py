"""A cube of channel maps as himap works with it: mK, frequencies ascending, HEALPix in RING."""

from dataclasses import dataclass, replace

import numpy as np

from himap.core.checks import checked_freqs, evenly_spaced
from himap.core.errors import InputError
from himap.cubes.layout import Layout, is_seen, same_freqs
from himap.cubes.weights import read_mask
from himap.maps import sphere
from himap.maps.healpix_io import MILLIKELVIN, to_ring
from himap.maps.low_rank import as_float32, scattered
from himap.removal import using
from himap.removal.data import checked_mask, checked_weights, means_of, missing_of

_TWICE = 1e-8  # relative: closer channels have one frequency
_FEW = 0.01  # of the pixels: so many may be masked in all channels for what some of these miss


@dataclass(frozen=True, kw_only=True)
class Cube:
    """Channel maps, of the whole sky or of a part.

    Attributes
    ----------
    maps
        The seen pixels, (n_channels, n_seen), mK, by RING index; float32, or float64 where the file has it
        and the sky is so bright that float32 would round HI away (`himap.maps.low_rank.precision`).
    freqs
        Channel centres, MHz, ascending, (n_channels,).
    mask
        Which pixels of the sphere, RING, or of an image are seen in every channel, or with weights in some,
        (n_pix,) bool.
    layout
        How it was given, a `himap.cubes.layout.Layout`.
    weights
        Of the seen pixels, (n_seen,), or of their voxels, (n_channels, n_seen), 0 where one is missing and
        maps are 0. None where all are the same.
    """

    maps: np.ndarray
    freqs: np.ndarray
    mask: np.ndarray
    layout: Layout
    weights: np.ndarray | None = None

    @property
    def missing(self):
        """Voxels of the seen pixels that are not seen, (n_channels, n_seen) bool, or None if all are."""
        return missing_of(self.weights)

    @property
    def remarks(self):
        """What was assumed or left out, for the user to read, a tuple of sentences."""
        return self.layout.remarks

    @property
    def summary(self):
        """What was read, a sentence for the user to check."""
        frame = self.layout.spectral_frame
        frame = f" (SPECSYS = {frame})" if frame else ""
        return (
            f"{len(self.freqs)} channels from {self.freqs[0]:.10g} to {self.freqs[-1]:.10g} MHz, given by "
            f"{self.layout.freqs_from}{frame}; {self.layout.pixels.described(self.layout.unit)}."
        )

    @property
    def said(self):
        """The summary and the remarks: what was read, assumed or left out, a list of sentences."""
        return [self.summary, *self.remarks]

    @property
    def nside(self):
        """Of HEALPix maps; InputError for an image in the plane."""
        return self.layout.pixels.nside

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

    def masked(self, path, *, rotate=False):
        """The same `within` the mask in a file; errors of that and of `himap.cubes.weights.read_mask`."""
        mask, layout = read_mask(path, self.layout, rotate=rotate)
        return replace(self, layout=layout).within(mask)

    def within(self, mask):
        """The same `Cube` of the pixels that it sees and that `mask` (n_pix,) bool, of its pixels, keeps.

        Raises
        ------
        InputError
            A mask of another resolution, or that keeps nothing of what is seen, or one channel of it.
        """
        kept = checked_mask(mask, len(self.mask)) & self.mask
        if not kept.any():
            raise InputError("the mask keeps no pixel that the cube sees; True (or 1) means kept.")
        return self._of(kept, f"{kept.mean():.1%} of {self.layout.pixels.area} is kept by the mask.")

    def seen_in(self, n_channels):
        """The same of the pixels that are seen in so many channels or more; InputError if there are none."""
        if self.missing is None:
            return self
        few, kept = np.count_nonzero(~self.missing, axis=0) < n_channels, self.mask.copy()
        if few.all():
            raise InputError(f"no pixel is seen in {n_channels} channels or more.")
        kept[kept] = ~few
        remark = f"{few.sum()} pixels are left out, which fewer than {n_channels} channels see."
        return self._of(kept, remark) if few.any() else self

    def _of(self, kept, remark):
        """The same of the pixels in `kept`, all of them seen, without the channels that see none of them."""
        seen, outdated, said = kept[self.mask], _remarks_on(self), [remark]
        cube = replace(self, maps=self.maps[:, seen], mask=kept)
        if self.weights is not None:
            weights = self.weights[..., seen]
            some = np.broadcast_to(np.atleast_2d(weights).any(axis=1), self.freqs.shape)
            if some.sum() < 2:
                raise InputError("fewer than two channels have data in the pixels that are kept.")
            if not some.all():
                cube, weights = cube._of_channels(some), weights[some]
                said.append(f"{(~some).sum()} channels have no data there and are left out.")
            cube = replace(cube, weights=checked_weights(weights, cube.maps.shape)[1])
        remarks = [one for one in self.remarks if one not in outdated]
        return replace(cube, layout=replace(cube.layout, remarks=(*remarks, *_remarks_on(cube), *said)))

    def _of_channels(self, kept):
        """The same of some channels, but for its weights."""
        layout = replace(self.layout, channels=self.layout.channels[kept])
        return replace(self, maps=self.maps[kept], freqs=self.freqs[kept], layout=layout)

    def channels_of(self, other):
        """The same `Cube` without the channels that the file of `other` has, but `other` has not."""
        if len(other.freqs) == len(other.layout.freqs):
            return self
        known, near = (same_freqs(self.freqs[:, None], one.freqs) for one in (other.layout, other))
        return self._of_channels(near.any(axis=1) | ~known.any(axis=1))

    def in_frame_of(self, other, label, *, rotate=False):
        """The same `Cube`, a truth or mock of `other`, in the frame of coordinates of that; `label` names it.

        An InputError where frames differ and it may not be rotated, or sees a part of the sky.
        """
        mine, theirs = self.layout.pixels, other.layout.pixels
        if not mine.whole_sky or not theirs.whole_sky:
            return self
        said = other.layout.joined(label, mine.frame, rotate=rotate).remarks[len(other.remarks) :]
        if None in (mine.frame, theirs.frame) or mine.frame == theirs.frame:
            return replace(self, layout=self.layout.noted(*said))
        if not self.whole_sky:
            raise InputError(
                "maps of a part of the sky cannot be rotated by their multipoles: give them in the frame of "
                f"the cube, {theirs.frame}."
            )
        maps = sphere.rotate_maps(self.maps, mine.frame, theirs.frame)
        share = maps.var(dtype=np.float64) / self.maps.var(dtype=np.float64)
        said = (*said, f"Its multipoles to l = {3 * self.nside - 1} were, with {share:.1%} of its variance.")
        layout = replace(self.layout.noted(*said), pixels=replace(mine, frame=theirs.frame))
        return replace(self, maps=maps, layout=layout)

    def on_sphere(self, maps):
        """Maps (n, n_seen) with all pixels, (n, n_pix), 0 where nothing is seen; themselves if all is."""
        return maps if self.whole_sky else scattered(maps, self.mask)

    def seen_of(self, truth):
        """Maps of a truth of the same pixels and channels, (n_channels, n_seen), as `without_gaps`."""
        return self.without_gaps(truth.maps[:, self.mask[truth.mask]])

    def without_gaps(self, maps):
        """Maps (n_channels, n_seen); where voxels are missing, less their means, and 0 in these voxels.

        So that gaps have no power: with its means a map would have a step at each.
        """
        missing = self.missing
        if missing is None:
            return maps
        means = means_of(maps, self.weights)[:, None].astype(maps.dtype)
        return np.where(missing, np.zeros((), maps.dtype), maps - means)


def are_scattered(seen):
    """Whether many of the pixels that some channel sees, (n_channels, n_pix) bool, are missing in another."""
    some, every = seen.any(axis=0), seen[seen.any(axis=1)].all(axis=0)
    return bool(np.count_nonzero(some & ~every) > _FEW * np.count_nonzero(some))


def make_cube(maps, layout, *, weights=None):
    """The `Cube` of `maps` and `layout` as of `himap.cubes.files.read_file`, complete: sorted, in mK, RING.

    NaN, infinite and UNSEEN pixels are not seen. A channel without any seen pixel is left out, and a dead
    one, with one value everywhere. Pixels that are seen in every channel are kept; with weights of the
    voxels, (n_in_file, n_pix), RING, changed in place, those that are seen in some.
    """
    # float16 ends at 65504, and longer floats take room.
    floats = np.float32 if np.result_type(maps.dtype, np.float32) == np.float32 else np.float64
    in_ring = to_ring if layout.pixels.nested else np.asarray
    seen = np.array([in_ring(is_seen(pixels)) for pixels in maps])
    if weights is not None:
        weights *= seen
        seen = weights > 0
    values = (in_ring(pixels)[there] for pixels, there in zip(maps, seen, strict=True))
    dead = np.array([len(some) > 1 and some.min() == some.max() for some in values])
    if (dead | ~seen.any(axis=1)).all() and dead.any():
        raise InputError("all maps are zero, or have one value everywhere.")
    seen[dead] = False
    channels = _seen_channels(seen, layout.freqs)
    mask = seen[channels].all(axis=0) if weights is None else seen.any(axis=0)
    if not mask.any():
        raise InputError(
            "no pixel is seen in every channel; leave out the channels that see least, or take a method that "
            f"uses weights ({', '.join(using('weights'))}) and read_cube(..., scattered=True)."
        )
    lines = np.empty((len(channels), int(mask.sum())), dtype=floats)
    for place, out in zip(channels, lines, strict=True):
        pixels = in_ring(maps[place].astype(floats, copy=False))[mask]
        out[:] = np.where(seen[place, mask], pixels, 0) * MILLIKELVIN[layout.unit]
    lines = as_float32(lines)  # or float64 as it was
    if weights is not None:
        _, weights = checked_weights(weights[np.ix_(channels, mask)], lines.shape)
    cube = Cube(
        maps=lines,
        freqs=layout.freqs[channels],
        mask=mask,
        layout=replace(layout, channels=channels),
        weights=weights,
    )
    return replace(cube, layout=cube.layout.noted(*_remarks_on_file(cube, seen, dead, maps.dtype)))


def _seen_channels(seen, freqs):
    """The places (n_channels,) of the channels that see some pixel, by frequency, two or more."""
    channels = np.argsort(freqs, kind="stable")
    channels = channels[seen[channels].any(axis=1)]
    if len(channels) < 2:
        raise InputError(f"a cube needs two channels with seen pixels, got {len(channels)} of {len(seen)}.")
    twice = freqs[channels][1:][np.diff(freqs[channels]) < _TWICE * freqs[channels][1:]]
    if len(twice):
        raise InputError(
            f"two channels have the frequency {twice[0]:g} MHz, or nearly: leave one of them out, or correct "
            "what states the step of frequencies (CDELT)."
        )
    checked_freqs(freqs[channels], len(channels))
    return channels


def _remarks_on_file(cube, seen, dead, dtype):
    """What of a file of maps of this dtype is not in its `Cube`, or may be a mistake, a list of sentences."""
    remarks, n_left = [], len(seen) - len(cube.freqs)
    if n_left:
        remarks.append(f"{n_left} of {len(seen)} channels have no data and are left out.")
    if not cube.mask.all():
        where = "every" if cube.missing is None else "some"
        area = f"{cube.mask.mean():.1%} of {cube.layout.pixels.area}"
        pixels = f"{cube.mask.sum()} of {cube.mask.size} pixels ({area})"
        remarks.append(f"{pixels} are seen in {where} channel; the rest is masked.")
    remarks += _remarks_on(cube)
    if dead.any():
        names = ", ".join(f"{freq:g}" for freq in np.sort(cube.layout.freqs[dead])[:5])
        remarks.append(f"{dead.sum()} of the channels have one value everywhere, as dead ones: {names} MHz.")
    if cube.weights is None and are_scattered(seen):
        remarks.append(
            "Pixels that some channels miss are masked in all; methods that take weights keep what is seen "
            f"of them ({', '.join(using('weights'))})."
        )
    if dtype.itemsize == 2 and dtype.kind == "f":
        rounding = np.abs(cube.maps).max() * np.finfo(np.float16).eps / 2
        remarks.append(
            f"the file has floats of 16 bits, which round its brightest voxels by up to {rounding:.2g} mK, "
            "where HI is of the order of 0.1 mK: write float32."
        )
    return remarks


def _remarks_on(cube):
    """What is missing in the maps of a `Cube`, and what may be a mistake in them, a list of sentences."""
    remarks, steps = [], np.diff(cube.freqs)
    if cube.missing is not None:
        remarks.append(
            f"{np.mean(cube.missing):.2%} of the voxels in these pixels are missing (flagged, not seen or of "
            "no weight): they have no weight, their residual is not known, and the spectra have 0 in "
            "their place."
        )
    empty = np.mean(~cube.maps.any(axis=0))
    if empty:
        remarks.append(f"{empty:.1%} of the pixels are 0 in all channels; make them NaN if they are missing.")
    if not evenly_spaced(cube.freqs):
        remarks.append(
            f"channels are {steps.min():g} to {steps.max():g} MHz apart; P(k) assumes even spacing."
        )
    return remarks
