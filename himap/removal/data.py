"""Input of a method: maps, the positions of their pixels, missing data, and the instrument.

Masks, flags, hits, NaN and UNSEEN are all converted to one form here: a missing pixel has no column in the
maps, and a missing voxel has no weight.
"""

import copy
import operator
from dataclasses import dataclass, field, replace

import numpy as np

from himap.core.checks import checked_beams, checked_cube, checked_freqs, checked_noise, real_array
from himap.core.errors import InputError
from himap.maps.low_rank import as_float32, centred, projection
from himap.removal.covariance import channel_covariance


@dataclass(frozen=True, kw_only=True, eq=False)
class Data:
    """Maps of observed pixels and their metadata.

    Attributes
    ----------
    maps
        (n_channels, n_pix), mK, float32 or float64; 0 where a voxel is missing.
    freqs
        Channel centres, MHz, ascending, (n_channels,).
    grid
        Positions of the pixels: on a HEALPix sphere, RING, (12 nside^2,) bool; in an image in the plane,
        (n_y, n_x) bool. None for a full sphere, or for lines of sight at unspecified positions.
    weights
        Hits or inverse variances, of which only ratios matter: for pixels, (n_pix,), or for voxels,
        (n_channels, n_pix), 0 where a voxel is missing. None if all are equal.
    beams
        b_l, (n_channels, lmax + 1), or None.
    noise
        Noise of the instrument per pixel, mK, a number or (n_channels,), or None.
    seed
        numpy Generator, or a seed for one, for methods that draw random numbers; or None.
    inside
        The observed pixels, (n_pix,) bool, if the maps continue beyond them (`on_sphere`); else None.
    known
        Results already computed from the maps, such as "modes", or functions that compute them. Data with
        other beams, noise or seed share them; those that depend on beams or noise are named by `key_of`.

    Raises
    ------
    InputError
        If frequencies, beams or noise are invalid or do not fit the maps.
    """

    maps: np.ndarray
    freqs: np.ndarray
    grid: np.ndarray | None = None
    weights: np.ndarray | None = None
    beams: np.ndarray | None = None
    noise: float | tuple | None = None
    seed: object = None
    inside: np.ndarray | None = None
    known: dict = field(default_factory=dict, repr=False)

    def __post_init__(self):
        n_channels, of = len(self.maps), (self.maps, self.weights, self.grid)
        if not all(map(operator.is_, self.known.get("of", (None,) * 3), of)):
            object.__setattr__(self, "known", {"of": of})
        object.__setattr__(self, "freqs", checked_freqs(self.freqs, n_channels))
        beams = None if self.beams is None else checked_beams("beams", self.beams, n_channels)
        object.__setattr__(self, "beams", beams)
        object.__setattr__(self, "noise", checked_noise("noise", self.noise, n_channels))

    @classmethod
    def of(cls, maps, *, freqs, mask=None, weights=None, image=None, rng=None, label="maps", **known):
        """Make `Data` from maps in the form that users have.

        Parameters
        ----------
        maps
            (n_channels, n_pix), mK; not changed.
        freqs
            Channel centres, MHz, ascending, (n_channels,).
        mask
            (n_pix,) bool, True where kept; values elsewhere are ignored. None keeps all.
        weights
            (n_pix,) or (n_channels, n_pix). A pixel without any weight is dropped. In a pixel with some
            weight, a voxel without weight is missing; its value is ignored.
        image
            Positions of the pixels in an image in the plane, row by row, (n_y, n_x) bool.
        rng
            numpy Generator, for methods that draw numbers.
        label
            Name of the maps in error messages.
        known
            `beams` and `noise`.

        Raises
        ------
        InputError
            If maps are not finite, have only one channel, or have a channel with one value everywhere; if
            a mask, weights or an image do not fit the maps.
        """
        maps = real_array("maps", maps)
        n_pix = maps.shape[-1] if maps.ndim else 0
        kept = None if mask is None else checked_mask(mask, n_pix)
        if weights is not None:
            kept, weights = checked_weights(weights, maps.shape, kept)
        grid = kept
        if image is not None:
            grid = np.array(image)
            if grid.dtype != bool or grid.ndim != 2 or np.count_nonzero(grid) != n_pix:
                got = f"{grid.dtype} {grid.shape}, {np.count_nonzero(grid)} of them not 0"
                raise InputError(
                    f"image must be (n_y, n_x) bool, True at the {n_pix} pixels that the maps have, got "
                    f"{got}."
                )
            grid[grid] = True if kept is None else kept
        by_voxel = np.ndim(weights) == 2
        maps = checked_cube(label, maps, min_channels=2, kept=weights > 0 if by_voxel else kept)
        if kept is not None:
            maps, weights = maps[:, kept], None if weights is None else weights[..., kept]
        if by_voxel:
            maps = np.where(weights > 0, maps, np.zeros((), maps.dtype))
        missing = missing_of(weights)
        rows = maps if missing is None else (row[~gaps] for row, gaps in zip(maps, missing, strict=True))
        varies = np.array([np.ptp(row) > 0 for row in rows])
        if varies.any() and not varies.all():
            raise InputError(
                f"{label} must vary over the sky, but channel {varies.argmin()} has one value everywhere, "
                "like a dead channel; leave it out."
            )
        return cls(maps=maps, freqs=freqs, grid=grid, weights=weights, seed=rng, **known)

    @property
    def image(self):
        """Positions of the pixels in an image in the plane, (n_y, n_x) bool, or None."""
        return self.grid if np.ndim(self.grid) == 2 else None

    @property
    def missing(self):
        """Which voxels are missing, (n_channels, n_pix) bool, or None."""
        return missing_of(self.weights)

    @property
    def rng(self):
        """A numpy Generator that draws the same numbers at every access, or None."""
        return None if self.seed is None else np.random.default_rng(copy.deepcopy(self.seed))

    @property
    def means(self):
        """The weighted mean of every channel, (n_channels,) float64."""
        return self.get_or_compute("means", lambda: means_of(self.maps, self.weights))

    @property
    def centred(self):
        """The maps less their means: float32, or float64 where that would round HI away."""
        return self.get_or_compute("centred", lambda: centred(self.maps, self.means))

    def project(self, rows):
        """``rows @ centred``, (n_rows, n_channels) times (n_channels, n_pix), float64.

        No copy of the maps is made if they are float32.
        """
        if self.maps.dtype != np.float32 or isinstance(self.known.get("centred"), np.ndarray):
            return projection(rows, self.centred)
        return projection(rows, self.maps, self.means)

    @property
    def total(self):
        """The maps with their means, with the precision of `centred`."""
        return as_float32(self.maps)

    @property
    def covariance(self):
        """Unweighted covariance of the channels, (n_channels, n_channels) float64, mK^2."""
        return self.get_or_compute("covariance", lambda: channel_covariance(self.centred))

    @property
    def modes(self):
        """The `CubeModes` of `centred`; for a part of the sphere, bright emission continues outside of it."""
        # Imported here: most methods need no transforms, and importing these takes a second.
        from himap.removal.analysis import cube_modes

        return self.get_or_compute("modes", lambda: cube_modes(self.centred, self.grid, self.covariance))

    def get_or_compute(self, name, make):
        """Return the result known under `name`, computing it with ``make()`` and keeping it if necessary."""
        value = self.known.get(name, make)
        if callable(value):
            value = self.known[name] = value()
        return value

    def key_of(self, method):
        """Name for what a method estimates from these data, which also depends on beams and noise."""
        parts = (None if one is None else np.asarray(one).tobytes() for one in (self.beams, self.noise))
        return method, *parts

    def on_sphere(self):
        """The same on the full sphere, less the means; bright emission continues smoothly outside `grid`."""
        if self.grid is None:
            return self
        from himap.removal.analysis import inpainted_maps

        maps = inpainted_maps(self.centred, self.grid, self.modes)
        full = replace(self, maps=maps, grid=None, weights=None, inside=self.grid)
        full.known.update(means=self.means, centred=maps, modes=self.modes)
        return full

    def with_mock(self, mock):
        """The same with a mock (n_channels, n_pix) of HI and noise, mK, added; missing voxels stay missing.

        The noise, if known, is that of data and mock together.
        """
        mock = mock if self.missing is None else np.where(self.missing, np.zeros((), mock.dtype), mock)
        noise = None if self.noise is None else np.sqrt(2) * np.asarray(self.noise)
        return replace(self, maps=self.maps + mock, noise=noise)

    def on(self, mask):
        """Return the part of full-sphere maps in the pixels that `mask`, (n_pix,) bool, keeps.

        Raises
        ------
        InputError
            If the mask has other pixels or keeps none.
        """
        kept = checked_mask(mask, self.maps.shape[1])
        weights = None if self.weights is None else self.weights[..., kept]
        return replace(self, maps=self.maps[:, kept], weights=weights, grid=kept)


def checked_mask(mask, n_pix):
    """Return a mask as (n_pix,) bool, True where kept; InputError for a wrong shape or value, or no pixel."""
    from himap.maps.masks import mask_weights  # here: it imports healpy, which takes a second

    kept = mask_weights(mask, n_pix)
    if not np.isin(kept, (0, 1)).all():
        raise InputError(
            "the mask of a separation must be True where kept and False elsewhere (or 1 and 0), got values "
            "between; weights are for power spectra: give mask > 0.5 or the like."
        )
    return kept.astype(bool)


def checked_weights(weights, shape, kept=None):
    """Return which pixels have weights, and the weights in their simplest form, for maps of this shape.

    `weights` are (n_pix,) or (n_channels, n_pix), used in the pixels `kept`, (n_pix,) bool or None for all.
    The first result is (n_pix,) bool, or None if all pixels have weights. The second, 0 elsewhere, is
    (n_channels, n_pix); (n_pix,) if all channels have the same weights; None if all voxels have.

    Raises
    ------
    InputError
        For another shape, invalid weights, or no weight at all in the maps or in a channel.
    """
    is_bool = np.asarray(weights).dtype == bool
    values = real_array("weights", np.asarray(weights, dtype=float) if is_bool else weights)
    if len(shape) != 2 or values.shape not in (shape, shape[1:]):
        raise InputError(
            f"weights must have shape (n_pix,) or (n_channels, n_pix), that of the maps, {shape}; got "
            f"{values.shape}."
        )
    if values.dtype != np.float32:
        values = values.astype(np.float64, copy=False)
    n_bad = sum(np.count_nonzero(~((row >= 0) & np.isfinite(row))) for row in np.atleast_2d(values))
    if n_bad:
        raise InputError(f"weights must be finite and 0 or more, got {n_bad} that are not; 0 means not seen.")
    seen = np.atleast_2d(values).any(axis=0)
    seen = seen if kept is None else seen & kept
    if not seen.any():
        raise InputError("the weights are 0 in all pixels that are kept; 0 means not seen.")
    values = np.where(seen, values, np.zeros((), values.dtype))
    if values.ndim == 2:
        empty = np.flatnonzero(~values.any(axis=1))
        if len(empty):
            raise InputError(
                f"the weights are 0 in all pixels of channel {empty[0]} and {len(empty) - 1} more; leave "
                "these channels out of the maps."
            )
        if all(np.array_equal(row, values[0]) for row in values[1:]):
            values = values[0]
    if values.ndim == 1 and np.ptp(values[seen]) == 0:
        values = None
    return None if kept is None and seen.all() else seen, values


def missing_of(weights):
    """Return which voxels have no weight, given the result of `checked_weights`; None if all have some."""
    missing = np.equal(weights, 0) if np.ndim(weights) == 2 else None
    return missing if missing is not None and missing.any() else None


def check_channels(weights, least, label):
    """Raise InputError if weights (n_channels, n_pix) leave `label` too few channels on a line of sight."""
    n_few = np.count_nonzero(np.count_nonzero(weights, axis=0) < least)
    if n_few:
        raise InputError(
            f"{label} needs {least} channels on a line of sight that are not missing, and {n_few} of "
            f"{weights.shape[1]} have fewer; leave these out with a mask."
        )


def means_of(maps, weights=None):
    """Mean of every channel of maps (n_channels, n_pix), weighted if given weights, (n_channels,) float64."""
    if weights is None:
        return maps.mean(axis=1, dtype=np.float64)
    rows = np.broadcast_to(weights, maps.shape)
    return np.array([np.average(row, weights=w.astype(float)) for row, w in zip(maps, rows, strict=True)])
