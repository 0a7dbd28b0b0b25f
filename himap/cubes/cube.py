"""A cube of channel maps: mK, frequencies ascending, HEALPix in RING order."""

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

_TWICE = 1e-8  # relative: closer channels have the same frequency
_SKY = 3e3  # mK, order of magnitude of the brightness of the sky at 1 GHz
_BRIGHT = 300  # times that: probably another unit
_FEW = 0.01  # largest share of pixels that may be masked in all channels because some channels lack them


@dataclass(frozen=True, kw_only=True)
class Cube:
    """Channel maps of the full sky or of a part.

    Attributes
    ----------
    maps
        Observed pixels, (n_channels, n_seen), mK, by RING index; float32, or float64 if the file has it and
        the sky is so bright that float32 would round away HI (`himap.maps.low_rank.precision`).
    freqs
        Channel centres, MHz, ascending, (n_channels,).
    mask
        Pixels of the sphere, RING, or of an image that are observed in every channel, or with weights in at
        least one, (n_pix,) bool.
    layout
        Layout of the file, a `himap.cubes.layout.Layout`.
    weights
        Of the observed pixels, (n_seen,), or of their voxels, (n_channels, n_seen); 0 for missing voxels,
        where maps are 0. None for uniform weights.
    """

    maps: np.ndarray
    freqs: np.ndarray
    mask: np.ndarray
    layout: Layout
    weights: np.ndarray | None = None

    @property
    def missing(self):
        """Missing voxels of the observed pixels, (n_channels, n_seen) bool, or None if there are none."""
        return missing_of(self.weights)

    @property
    def remarks(self):
        """Assumptions and omissions, a tuple of sentences."""
        return self.layout.remarks

    @property
    def summary(self):
        """Summary of the input, a sentence for the user to check."""
        frame = self.layout.spectral_frame
        frame = f" (SPECSYS = {frame})" if frame else ""
        return (
            f"{len(self.freqs)} channels from {self.freqs[0]:.10g} to {self.freqs[-1]:.10g} MHz, given by "
            f"{self.layout.freqs_from}{frame}; {self.layout.pixels.described(self.layout.unit)}."
        )

    @property
    def said(self):
        """The summary and the remarks, a list of sentences."""
        return [self.summary, *self.remarks]

    @property
    def nside(self):
        """Nside of HEALPix maps; InputError for an image in the plane."""
        return self.layout.pixels.nside

    @property
    def whole_sky(self):
        """Whether the full sphere is observed."""
        return self.layout.pixels.whole_sky and bool(self.mask.all())

    @property
    def sky_mask(self):
        """The mask, or None for the full sky."""
        return None if self.whole_sky else self.mask

    @property
    def image(self):
        """Observed pixels of an image in the plane, (n_y, n_x) bool; None for HEALPix maps."""
        pixels = self.layout.pixels
        return None if pixels.whole_sky else self.mask.reshape(pixels.shape)

    @property
    def channel_width(self):
        """Mean channel separation, MHz."""
        return float((self.freqs[-1] - self.freqs[0]) / (len(self.freqs) - 1))

    def masked(self, path, *, rotate=False):
        """The cube `within` the mask in a file; errors also as in `himap.cubes.weights.read_mask`."""
        mask, layout = read_mask(path, self.layout, rotate=rotate)
        return replace(self, layout=layout).within(mask)

    def within(self, mask):
        """Restrict the `Cube` to its observed pixels within `mask`, (n_pix,) bool, True for kept pixels.

        Raises
        ------
        InputError
            A mask of another resolution, or one that keeps no observed pixel, or only one channel of them.
        """
        kept = checked_mask(mask, len(self.mask)) & self.mask
        if not kept.any():
            raise InputError("the mask keeps no observed pixel of the cube; True (or 1) means kept.")
        return self._of(kept, f"{kept.mean():.1%} of {self.layout.pixels.area} is kept by the mask.")

    def seen_in(self, n_channels):
        """Restrict to pixels observed in at least `n_channels` channels; InputError if there are none."""
        if self.missing is None:
            return self
        few, kept = np.count_nonzero(~self.missing, axis=0) < n_channels, self.mask.copy()
        if few.all():
            raise InputError(f"no pixel is observed in {n_channels} channels or more.")
        kept[kept] = ~few
        remark = f"{few.sum()} pixels observed in fewer than {n_channels} channels are excluded."
        return self._of(kept, remark) if few.any() else self

    def _of(self, kept, remark):
        """Restrict to the observed pixels in `kept`, without channels that have no data in them."""
        seen, outdated, said = kept[self.mask], _remarks_on(self), [remark]
        cube = replace(self, maps=self.maps[:, seen], mask=kept)
        if self.weights is not None:
            weights = self.weights[..., seen]
            some = np.broadcast_to(np.atleast_2d(weights).any(axis=1), self.freqs.shape)
            if some.sum() < 2:
                raise InputError("fewer than two channels have data in the pixels that are kept.")
            if not some.all():
                cube, weights = cube._of_channels(some), weights[some]
                said.append(f"{(~some).sum()} channels without data there are excluded.")
            cube = replace(cube, weights=checked_weights(weights, cube.maps.shape)[1])
        remarks = [one for one in self.remarks if one not in outdated]
        return replace(cube, layout=replace(cube.layout, remarks=(*remarks, *_remarks_on(cube), *said)))

    def _of_channels(self, kept):
        """Restrict to some channels, except for the weights."""
        layout = replace(self.layout, channels=self.layout.channels[kept])
        return replace(self, maps=self.maps[kept], freqs=self.freqs[kept], layout=layout)

    def channels_of(self, other):
        """Remove the channels that the file of the `Cube` `other` has but `other` itself has not."""
        if len(other.freqs) == len(other.layout.freqs):
            return self
        known, near = (same_freqs(self.freqs[:, None], one.freqs) for one in (other.layout, other))
        return self._of_channels(near.any(axis=1) | ~known.any(axis=1))

    def in_frame_of(self, other, label, *, rotate=False):
        """Convert a truth or mock of `other` to the frame of coordinates of `other`; `label` names it.

        InputError if frames differ and rotation is not allowed, or only a part of the sky is observed.
        """
        mine, theirs = self.layout.pixels, other.layout.pixels
        if not mine.whole_sky or not theirs.whole_sky:
            return self
        said = other.layout.joined(label, mine.frame, rotate=rotate).remarks[len(other.remarks) :]
        if None in (mine.frame, theirs.frame) or mine.frame == theirs.frame:
            return replace(self, layout=self.layout.noted(*said))
        if not self.whole_sky:
            raise InputError(
                "maps of a part of the sky cannot be rotated through multipoles: provide them in the frame "
                f"of the cube, {theirs.frame}."
            )
        maps = sphere.rotate_maps(self.maps, mine.frame, theirs.frame)
        share = maps.var(dtype=np.float64) / self.maps.var(dtype=np.float64)
        said = (*said, f"Rotated by multipoles to l = {3 * self.nside - 1}, {share:.1%} of variance kept.")
        layout = replace(self.layout.noted(*said), pixels=replace(mine, frame=theirs.frame))
        return replace(self, maps=maps, layout=layout)

    def on_sphere(self, maps):
        """Maps (n, n_seen) as full maps, (n, n_pix), 0 where not observed; unchanged for the full sky."""
        return maps if self.whole_sky else scattered(maps, self.mask)

    def seen_of(self, truth):
        """Maps of a truth in the pixels and channels of the cube, (n_channels, n_seen), as `without_gaps`."""
        return self.without_gaps(truth.maps[:, self.mask[truth.mask]])

    def without_gaps(self, maps):
        """Maps (n_channels, n_seen); with missing voxels, their means are subtracted and these voxels are 0.

        Otherwise each gap would be a step, with power, because of the mean.
        """
        missing = self.missing
        if missing is None:
            return maps
        means = means_of(maps, self.weights)[:, None].astype(maps.dtype)
        return np.where(missing, np.zeros((), maps.dtype), maps - means)


def are_scattered(seen):
    """Whether many pixels (n_channels, n_pix) bool are observed in some channels but not in others."""
    some, every = seen.any(axis=0), seen[seen.any(axis=1)].all(axis=0)
    return bool(np.count_nonzero(some & ~every) > _FEW * np.count_nonzero(some))


def make_cube(maps, layout, *, weights=None):
    """Make the `Cube` of `maps` and a complete `layout` (`himap.cubes.files.read_file`): sorted, in mK, RING.

    NaN, infinite and UNSEEN pixels are not observed. Channels without observed pixels and dead channels, with
    one value everywhere, are excluded. Pixels observed in every channel are kept; with weights of the voxels,
    (n_in_file, n_pix), RING, changed in place, those observed in at least one.
    """
    # float16 overflows at 65504, and longer floats need memory.
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
            "no pixel is observed in every channel; exclude the channels with the least data, or use a "
            f"method with weights ({', '.join(using('weights'))}) and read_cube(..., scattered=True)."
        )
    lines = np.empty((len(channels), int(mask.sum())), dtype=floats)
    for place, out in zip(channels, lines, strict=True):
        pixels = in_ring(maps[place].astype(floats, copy=False))[mask]
        out[:] = np.where(seen[place, mask], pixels, 0) * MILLIKELVIN[layout.unit]
    lines = as_float32(lines)  # or float64 if needed
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
    """Indices (n_channels,) of the channels with observed pixels, by frequency, at least two."""
    channels = np.argsort(freqs, kind="stable")
    channels = channels[seen[channels].any(axis=1)]
    if len(channels) < 2:
        raise InputError(f"a cube needs two observed channels, got {len(channels)} of {len(seen)}.")
    twice = freqs[channels][1:][np.diff(freqs[channels]) < _TWICE * freqs[channels][1:]]
    if len(twice):
        raise InputError(
            f"two channels have the same frequency, or nearly, {twice[0]:g} MHz: exclude one of them, or "
            "correct the frequency step (CDELT)."
        )
    checked_freqs(freqs[channels], len(channels))
    return channels


def rms_of(maps, missing=None):
    """Rms of maps (n_channels, n_seen) over observed voxels, without the means of channels."""
    kept = [slice(None)] * len(maps) if missing is None else ~missing
    return np.sqrt(np.mean([row[some].var(dtype=np.float64) for row, some in zip(maps, kept, strict=True)]))


def _remarks_on_file(cube, seen, dead, dtype):
    """Omissions of a `Cube` relative to its file of this dtype, and likely mistakes, a list of sentences."""
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
        remarks.append(f"{dead.sum()} of the channels are dead, with one value everywhere: {names} MHz.")
    if cube.weights is None and are_scattered(seen):
        remarks.append(
            "Pixels missing in some channels are masked in all; methods with weights use their remaining "
            f"voxels ({', '.join(using('weights'))})."
        )
    rms, sky = rms_of(cube.maps, cube.missing), _SKY * np.mean(cube.freqs / 1000) ** -2.7
    if rms > _BRIGHT * sky:
        remarks.append(
            f"the maps have an rms of {rms / 1000:.3g} K, where the sky has some {sky / 1000:.2g} K: is "
            f"{cube.layout.unit} their unit?"
        )
    if dtype.itemsize == 2 and dtype.kind == "f":
        rounding = np.abs(cube.maps).max() * np.finfo(np.float16).eps / 2
        remarks.append(
            f"the file has 16-bit floats, which round the brightest voxels by up to {rounding:.2g} mK, "
            "where HI is about 0.1 mK: write float32."
        )
    return remarks


def _remarks_on(cube):
    """Missing data in the maps of a `Cube`, and likely mistakes, a list of sentences."""
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
