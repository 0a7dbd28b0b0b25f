"""A cleaning: data and a method, the separation and residual, and variants with one thing changed."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from himap.maps.low_rank import in_threads
from himap.removal.data import Data
from himap.removal.peaks import mask_peaks


@dataclass(frozen=True, kw_only=True, eq=False)
class Cleaning:
    """Data cleaned by a method; separation and residual are computed once, at first use.

    Attributes
    ----------
    data
        The `Data` from which the foreground is subtracted.
    method
        The `ForegroundRemover`.
    basis
        The `Data` in which the foreground is estimated, such as those with masked peaks; default: `data`.
    spread
        If peaks are masked, which deviation they stand out from: a name in `himap.removal.peaks.SPREADS`.
    """

    data: Data
    method: object
    basis: Data | None = None
    spread: str = "line"

    def __post_init__(self):
        if self.basis is None:
            object.__setattr__(self, "basis", self.data)

    @classmethod
    def of(cls, data, method, *, peaks=True, **fields):
        """The `Cleaning` of data; with `peaks`, its peaks are masked for the separation (Sect. 4.1)."""
        return cls(data=data, method=method, basis=without_peaks(data) if peaks else data, **fields)

    @cached_property
    def separation(self):
        """The `Separation` that the method estimates."""
        return self.method.separate(self.basis)

    @cached_property
    def residual(self):
        """Data less foreground, (n_channels, n_pix) float32, mK; 0 where a voxel is missing."""
        residual = self.separation.residual(self.data.maps, self.basis)
        if self.data.missing is not None:
            residual[self.data.missing] = 0
        return residual

    @property
    def maps(self):
        """The maps of the data, with the estimated foreground in missing voxels."""
        if self.data.missing is None:
            return self.data.maps
        foreground, maps = self.separation.foreground, self.data.maps.copy()
        rows = zip(foreground.spectra, self.separation.means, self.data.missing, maps, strict=True)
        for spectrum, mean, gaps, row in rows:
            row[gaps] = spectrum @ foreground.maps[:, gaps] + mean
        return maps

    @property
    def flagged(self):
        """Fraction of the voxels that peak masking replaced."""
        return 0.0 if self._keeps_peaks else float(np.mean(self.basis.maps != self.data.maps))

    def with_mock(self, mock):
        """The same with a mock, (n_channels, n_pix), mK, added to the data; peaks of the sum are masked."""
        return self._of(self.data.with_mock(mock))

    def resampled(self, mock, separation=None, alms=None):
        """Return a member of a parametric bootstrap, whose truth is the mock (n_channels, n_pix), mK.

        The mock replaces all that the data hold besides the foreground, that of a given `Separation` or the
        one estimated here. Peaks are masked again; missing voxels remain missing. With coefficients `alms`
        of the mock less its means, (n_channels, n_alm) to 3 nside - 1, few maps need a transform.
        """
        separation = self.separation if separation is None else separation
        foreground, old = separation.foreground, self.data.maps
        maps = np.empty_like(old)

        def add(pixels):
            maps[:, pixels] = foreground.lines(pixels) + separation.means[:, None] + mock[:, pixels]

        in_threads(add, maps.shape[1], "member")
        if self.data.missing is not None:
            maps = np.where(self.data.missing, old, maps)
        data = replace(self.data, maps=maps)
        if alms is not None:
            # Imported here: most methods need no transforms, and importing these takes a second.
            from himap.removal.analysis import modes_of_sum

            data.known["modes"] = lambda: modes_of_sum(foreground, alms, self.basis.covariance)
        return self._of(data)

    @property
    def _keeps_peaks(self):
        return self.basis.maps is self.data.maps

    def _of(self, data):
        """The same with other `Data`; peaks are masked if they are masked here."""
        return self._with(data, data if self._keeps_peaks else without_peaks(data, self.spread))

    def _with(self, data, basis):
        basis = replace(basis, beams=self.basis.beams, seed=self.basis.seed)  # which the method assumes
        return replace(self, data=data, basis=basis)

    def with_beams(self, beams):
        """The same with a method that assumes the beams b_l, (n_channels, lmax + 1)."""
        return replace(self, basis=replace(self.basis, beams=beams))

    def with_method(self, method, *, rng=None):
        """The same with another `ForegroundRemover`, which may get its own Generator."""
        basis = self.basis if rng is None else replace(self.basis, seed=rng)
        return replace(self, method=method, basis=basis)

    def with_sources(self, n_sources):
        """The same with another number of sources."""
        return self.with_method(replace(self.method, n_sources=n_sources))

    def with_restart(self, restart):
        """The same with another start of a chaotic method, such as `SDecGMCA`; 0 is the unperturbed start."""
        return self.with_method(replace(self.method, restart=restart))

    def on(self, mask):
        """The same on a part of a full sphere, `mask` (n_pix,) bool."""
        data = self.data.on(mask)
        return self._with(data, data if self._keeps_peaks else self.basis.on(mask))


def without_peaks(data, spread="line"):
    """`Data` whose peaks are replaced by a smooth baseline, with the precision of the maps."""
    masked = mask_peaks(data.maps, data.freqs, spread=spread, weights=data.weights)
    double = data.maps.dtype == np.float64
    basis = replace(data, maps=np.where(masked.flagged, masked.maps, data.maps) if double else masked.maps)
    if "modes" in data.known and data.grid is None:
        basis.known["modes"] = lambda: data.modes.without_peaks(data.maps, basis.maps)
    return basis
