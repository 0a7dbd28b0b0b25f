"""The space of the blurred spectra, estimated without thresholded sources; a method of this library."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from himap.core.errors import InputError
from himap.core.progress import progress
from himap.maps import sphere
from himap.maps.starlets import bands_of, noise_of_scales, starlet_filters
from himap.removal import harmonic
from himap.removal.base import ForegroundRemover, Separation, parameter
from himap.removal.blurred_mixture import BlurredMixture, noise_per_mode
from himap.removal.compiled import NORMAL, median, sparse
from himap.removal.separation import ordered
from himap.removal.spectral_filter import through_beams

_SETTLED = 1e-4  # relative change of the misfit at which the iteration stops
_ROUNDING = 1e-13  # of the power of the data: a misfit below is that of float32 maps without HI and noise
_MOST_ITERATIONS = 50  # the misfit settles in 3 to 20


@dataclass(frozen=True, kw_only=True)
class BeamSubspace(ForegroundRemover):
    """A few spectra, blurred by the beam of every channel, that describe the foreground.

    Not a method of the paper. The model, X_l = diag(H_l) A S_l + N_l (Eq. 21), the start and the sparsity in
    starlets are those of `SDecGMCA` (Carloni Gertosio & Bobin 2021); the estimate of A is not. H is the beam
    of a channel over the best beam of all, so at most 1. In alternation, S follows from A by plain least
    squares at every l, and A from S, channel by channel, by one Newton step towards

        sum_l H_l (X_l - H_l A S_l) T_l^T = 0,

    where T are the thresholded detail scales of S. Unthresholded sources are subtracted, so T only weights
    the data, and without noise the true A is a solution for any thresholds. (In a fit of X with T alone,
    bright sources no longer cancel where a coefficient is cut: each channel has the remainder through another
    beam, which biases A.) So the result hardly depends on noise level, share or start; but `thresholds` of
    "mad" keep almost nothing of a source that is bright nearly everywhere. The iteration ends when the misfit
    no longer changes.

    The foreground is H A S with S by least squares at every l of the maps (`through_beams`): it depends on
    A only through the space that its columns span. They are orthonormal; the sources are uncorrelated and
    ordered by variance, not separated. There is no randomness.

    With a mask, the squares of X - H A S are minimised over the kept pixels, with S free outside. Extending
    the maps by any H A S does not change this, so the maps are continued smoothly to the full sphere, where
    their bright part is nearly such an H A S, and least squares are solved there (`himap.maps.inpaint`). The
    continuation is inaccurate near the edge, within reach of the beam. T has zero weight there, so A is
    estimated from pixels further inside, and spectra of the residual should exclude the same margin: two
    widths of the widest beam.
    """

    name: ClassVar[str] = "beam_subspace"
    uses: ClassVar[frozenset] = frozenset({"beams", "sphere"})
    n_sources: int = parameter(3, "number of spectra", minimum=1)
    share: float = parameter(
        0.3, "share of the significant coefficients used to fit A", minimum=0, maximum=1, above=True
    )
    n_scales: int = parameter(5, "number of starlet detail scales", minimum=1, maximum=12)
    lmax: int = parameter(200, "largest multipole that shapes A, at most 2 nside", minimum=4)
    thresholds: str = parameter(
        "analytic", "noise of the thresholds: analytic or mad", choices=("analytic", "mad")
    )
    noise: float | tuple | None = parameter(None, "noise per pixel, mK, or one for each channel")
    n_sigma: float = parameter(3.0, "lowest threshold, in units of the noise", minimum=0)

    def check_data(self, data):
        """Refuse a mask that keeps too few pixels farther inside than the beam reaches."""
        super().check_data(data)
        if data.grid is None:
            return
        kept, beams = data.grid, data.beams
        lmax, last = min(self.lmax, 2 * sphere.nside_of(kept)), beams.shape[1] - 1
        if last < lmax:
            raise InputError(
                f"with a mask the beams must reach l = {lmax}, as {self.name} does, got b_l to {last}: what "
                "lies beyond would be mixed across the edge. Give longer b_l, or a smaller lmax."
            )
        inside = inner_weights(kept, beams.min(axis=0), lmax)
        n_modes, needed = np.mean(inside) * (lmax + 1) ** 2, len(beams)
        if n_modes < needed:
            raise InputError(
                f"the mask keeps {kept.mean():.2%} of the sky; farther from its edge than the beam reaches "
                f"there are {n_modes:.0f} modes to l = {lmax}, and {needed} channels need as many. Keep more "
                "of the sky, or use a method that needs no neighbouring pixels, such as pca."
            )

    def _separate(self, data):
        beams, modes, kept, nside = data.beams, data.modes, data.inside, sphere.nside_of(data.maps)
        lmax = min(self.lmax, 2 * nside, beams.shape[1] - 1)
        best = beams.max(axis=0)
        mixture = BlurredMixture(modes.upto(lmax), beams[:, : lmax + 1] / best[: lmax + 1])
        mixing = mixture.start(self.n_sources)
        if self.noise is None:  # the residual of the initial A, in the upper half of the multipoles
            residual = mixture.residual(mixing, mixture.sources(mixture.least_squares(mixing)))
            noise = np.mean(residual[:, ((lmax + 1) // 2) ** 2 :] ** 2, axis=1)
            noise = noise if kept is None else noise / np.mean(kept)
        else:
            noise = noise_per_mode(self.noise, *data.maps.shape)
        mixture = replace(mixture, noise=noise)
        weights = None
        if kept is not None:
            weights = inner_weights(kept, beams.min(axis=0), lmax, on_grid=True)
        mixing, converged, n_iterations = self._settled(mixture, mixing, weights)
        mixing, sources = ordered(mixing, mixture.sources(mixture.least_squares(mixing)))
        return Separation(
            low_rank=through_beams(data.project, mixing, beams / best, modes),
            mixing=mixing,
            sources=harmonic.synthesise(sources, nside),
            converged=converged,
            n_iterations=n_iterations,
        )

    def _settled(self, mixture, mixing, weights):
        """Return A whose columns span the spectra of the foreground, whether it settled, and iterations."""
        exact = _ROUNDING * np.vdot(mixture.modes, mixture.modes)
        misfit = None
        for count in progress(range(_MOST_ITERATIONS), self.name):
            inverses = mixture.least_squares(mixing)
            sources = mixture.sources(inverses)
            residual = mixture.residual(mixing, sources)
            previous, misfit = misfit, np.vdot(residual, residual)
            settled = previous is not None and abs(previous - misfit) <= _SETTLED * misfit
            if settled or misfit <= exact:
                # Rotated so that the sources are uncorrelated.
                return mixing @ np.linalg.eigh(sources @ sources.T)[1], True, count
            kept = self._sparse(sources, mixture.source_noise(inverses), weights)
            mixing, _ = np.linalg.qr(mixture.corrected(mixing, residual, sources, kept))
        return mixing, False, _MOST_ITERATIONS

    def _sparse(self, sources, noise, weights):
        """Sum of the detail scales of sources after soft thresholds, real modes (n_sources, (lmax + 1)^2).

        Thresholds work on a grid that is exact for multipoles up to lmax. `noise` is the variance of each
        source per mode, (n_l, n_sources). `weights` of the grid, (n_grid,), multiply the coefficients.
        """
        lmax, kept = len(noise) - 1, np.empty_like(sources)
        filters = starlet_filters(self.n_scales, lmax)[:-1]
        bands, levels = bands_of(filters), noise_of_scales(filters, noise)
        for alm, level_of_scale, out in zip(harmonic.from_modes(sources), levels.T, kept, strict=True):
            scales = [sphere.synthesise_grid(alm[keep] * band, lmax) for keep, band in bands]
            for scale, level in zip(scales, level_of_scale, strict=True):
                if weights is not None:
                    scale *= weights
                if self.thresholds == "mad":
                    level = NORMAL * median(np.abs(scale if weights is None else scale[weights > 0]))
                sparse(scale, self.n_sigma, self.share, level)
            out[:] = harmonic.to_modes(sphere.analyse_grid(sum(scales), lmax))
        return kept


def inner_weights(kept, beam, lmax, *, on_grid=False):
    """Weights 0 outside a mask (n_pix,) and at its edge, 1 beyond reach of a beam b_l; on pixels or grid.

    Computed from the coefficients of the mask up to `lmax`, smoothed twice with the beam.
    """
    mask = sphere.analyse(kept.astype(np.float64), lmax)
    alm = sphere.multiply_beam(mask, (beam[: lmax + 1] / beam[0]) ** 2)
    field = sphere.synthesise_grid(alm) if on_grid else sphere.synthesise(alm, sphere.nside_of(kept))
    return np.clip(2 * field - 1, 0, 1)
