"""Separation of sparse sources seen through beams (paper, Sect. 3.3; Carloni Gertosio & Bobin 2021, C21)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from himap.errors import InputError
from himap.maps import sphere
from himap.progress import progress
from himap.removal import harmonic
from himap.removal.base import ForegroundRemover, Separation, parameter
from himap.removal.beam_projection import through_beams
from himap.removal.conventions import ordered
from himap.removal.covariance import principal_axes
from himap.removal.sdecgmca.mixture import BlurredMixture
from himap.removal.sdecgmca.sparse_sources import SparseSources

__all__ = ["SDecGMCA"]

_SETTLED = 1e-4  # relative change of the misfit at which the space of the spectra has been found
_ROUNDING = 1e-13  # of the power of the data: a misfit below is that of float32 maps without HI and noise
_MOST_STABLE = 50  # iterations for that; the misfit settles in 3 to 20
_LARGEST_RIDGE = 1e6  # relative to columns of unit length: where a source has no power it stays zero
_CONDITION_LIMIT = 1 / np.finfo(np.float32).eps  # of A; beyond, sources of float32 maps have no digit left


@dataclass(frozen=True, kw_only=True)
class SDecGMCA(ForegroundRemover):
    """Sources sparse in starlets, at the resolution of the best beam: X_l = diag(H_l) A S_l + N_l (Eq. 22).

    H is the beam over the best beam of any channel, so at most 1. S is found from A by least squares at
    every l, coefficients of S below a threshold are dropped, and A is found from what is kept, in turns. A
    starts from the principal components of the data re-convolved to the worst beam. In the end the
    foreground is H A S with S from least squares at every l of the maps, nothing dropped: it depends on A
    only through the space that its columns span. The two iterations differ in how they find it.

    "published"
        C21: S with a Tikhonov term epsilon (Eq. 25; C21, Eq. 21); the share of coefficients kept, among
        those above `n_sigma` times the noise, grows evenly to `share` in `n_warmup` iterations; then
        `n_refinement` more follow with reweighted thresholds and A from the detail scales only. A is fitted
        to the data with the thresholded S (C21, Eq. 14). It separates the sources; but what a threshold takes
        from one large source the others no longer cancel, and seen through beams it differs from channel to
        channel. A goes to fit that, and the result moves with the noise level and other things of no account.
    "stable"
        A is corrected by what the residual of the *whole* sources holds of the thresholded ones
        (`BlurredMixture.corrected`), so that no threshold can bias it, until the misfit settles. The result
        hardly depends on noise level, threshold or start. Sources are given uncorrelated, not separated.

    Columns of A have unit length, and sources are ordered by variance. There is no randomness.
    """

    name: ClassVar[str] = "sdecgmca"
    needs_beams: ClassVar[bool] = True
    needs_whole_sky: ClassVar[bool] = True
    needs_modes: ClassVar[bool] = True
    n_sources: int = parameter(3, "number of sources, n_s", minimum=1)
    regularisation: float = parameter(1e-3, "strength c of the Tikhonov term", minimum=0)
    share: float = parameter(
        0.3, "largest share K_max of significant coefficients kept", minimum=0, maximum=1, above=True
    )
    n_scales: int = parameter(5, "number of starlet detail scales", minimum=1, maximum=12)
    lmax: int = parameter(200, "largest multipole that shapes A, at most 2 nside", minimum=4)
    iteration: str = parameter(
        "stable", "stable or published: how A is found", choices=("stable", "published")
    )
    coefficients: str = parameter(
        "spectrum",
        "epsilon of the refinement: spectrum (#4) or matrix (#3)",
        choices=("spectrum", "matrix"),
    )
    thresholds: str = parameter(
        "analytic", "noise of the thresholds: analytic or mad", choices=("analytic", "mad")
    )
    nonnegative: bool = parameter(False, "set negative entries of A to zero", choices=(False, True))
    reweighted: bool = parameter(True, "l1 reweighting in the refinement", choices=(True, False))
    noise: float | tuple | None = parameter(None, "noise per pixel, mK, or one for each channel")
    n_sigma: float = parameter(3.0, "lowest threshold, in units of the noise", minimum=0)
    n_warmup: int = parameter(100, "iterations in which the share grows; half as many may follow", minimum=1)
    n_refinement: int = parameter(25, "least number of refinements; as many may follow", minimum=1)
    warmup_tolerance: float = parameter(1e-2, "relative change of S that ends the warm-up", minimum=0)
    tolerance: float = parameter(1e-4, "relative change of S that ends the refinement", minimum=0)

    def __post_init__(self):
        super().__post_init__()
        if self.noise is not None:
            noise = np.asarray(self.noise)
            if noise.dtype.kind not in "fiu" or noise.ndim > 1 or not ((noise > 0) & (noise < np.inf)).all():
                raise InputError(f"noise must be above zero, in mK per pixel, got {self.noise!r}.")
            object.__setattr__(self, "noise", tuple(noise.tolist()) if noise.ndim else float(noise))

    def check(self, n_channels):
        super().check(n_channels)
        if isinstance(self.noise, tuple) and len(self.noise) != n_channels:
            raise InputError(
                f"noise must be one value or {n_channels}, one for each channel, got {len(self.noise)}."
            )

    def _separate(self, maps, *, freqs, beams, rng, modes):
        nside = sphere.nside_of(maps)
        lmax = min(self.lmax, 2 * nside, beams.shape[1] - 1)
        data = modes.upto(lmax)
        best = beams.max(axis=0)
        relative = beams[:, : lmax + 1] / best[: lmax + 1]
        mixing = _start(data, relative, self.n_sources)
        mixture = BlurredMixture(data, relative)
        mixture = mixture.with_noise(self._noise_power(mixture, mixing, maps.shape[1]))
        iteration = self._stable if self.iteration == "stable" else self._published
        mixing, converged, n_iterations = iteration(mixture, mixing)
        mixing, sources = ordered(mixing, _least_squares(mixture, mixing))
        condition = np.linalg.cond(mixing)
        too_close = f"the mixing matrix is near-degenerate (condition {condition:.0e}): use fewer sources"
        return Separation(
            foreground=through_beams(maps, mixing, beams / best, modes),
            mixing=mixing,
            sources=sphere.synthesise(harmonic.from_modes(sources), nside),
            converged=converged,
            n_iterations=n_iterations,
            remark=too_close if condition > _CONDITION_LIMIT else "",
        )

    def _noise_power(self, mixture, mixing, n_pix):
        """Variance of the noise per mode and channel, (n_channels,): as given, or what the start leaves."""
        if self.noise is None:
            return mixture.residual_noise(mixing, _least_squares(mixture, mixing))
        return np.broadcast_to(np.square(self.noise) * 4 * np.pi / n_pix, len(mixture.modes))

    def _stable(self, mixture, mixing):
        """A whose columns span the spectra of the foreground, whether that space settled, iterations."""
        sparse = self._sparse(mixture)
        exact = _ROUNDING * np.vdot(mixture.modes, mixture.modes)
        misfit = None
        for count in progress(range(_MOST_STABLE), "sdecgmca"):
            inverses = harmonic.safe_inverse(mixture.matrices(mixing))
            sources = harmonic.project(inverses, mixture.modes)
            residual = mixture.residual(mixing, sources)
            previous, misfit = misfit, np.vdot(residual, residual)
            settled = previous is not None and abs(previous - misfit) <= _SETTLED * misfit
            if settled or misfit <= exact:
                return _uncorrelated(mixing, sources), True, count
            kept = sparse(sources, mixture.noise_of(inverses), self.share)
            mixing, _ = np.linalg.qr(mixture.corrected(mixing, residual, sources, kept))
        return mixing, False, _MOST_STABLE

    def _published(self, mixture, mixing):
        """A after warm-up and refinement, whether S settled, iterations."""
        sparse = self._sparse(mixture)
        sources, n_iterations = None, 0
        for refining, least, most, tolerance in (
            (False, self.n_warmup, self.n_warmup * 3 // 2, self.warmup_tolerance),
            (True, self.n_refinement, self.n_refinement * 2, self.tolerance),
        ):
            for count in progress(range(1, most + 1), "refinement" if refining else "warm-up"):
                share = self.share if refining else self.share * min(1, count / least)
                previous = sources
                mixing, sources = self._iterated(mixture, sparse, mixing, previous, share, refining)
                n_iterations += 1
                settled = previous is not None and _change(previous, sources) < tolerance
                if count >= least and settled:
                    break
        return mixing, settled, n_iterations

    def _iterated(self, mixture, sparse, mixing, previous, share, refining):
        """One iteration: A, and the thresholded S with its smooth scale."""
        matrices = mixture.matrices(mixing)
        if refining and self.coefficients == "spectrum":
            ridge = self._ridge_of_spectra(mixture.noise, previous)
        else:
            ridge = self._ridge_of_matrices(matrices, mixing)
        inverses = harmonic.safe_inverse(matrices, ridge)
        sources = harmonic.project(inverses, mixture.modes)
        kept = sparse(sources, mixture.noise_of(inverses), share, reweighted=refining and self.reweighted)
        thresholded = kept + sparse.coarse(sources)
        if refining:
            fitted = mixture.fit(kept, sparse.detail)
        else:
            fitted = mixture.fit(thresholded, np.ones_like(sparse.detail))
        return self._normalised(fitted, mixing), thresholded

    def _ridge_of_matrices(self, matrices, mixing):
        """epsilon = max(0, c - lambda_min(W_l^T W_l) / lambda_min(A^T A)) (C21, strategy 3)."""
        smallest = np.linalg.svd(matrices, compute_uv=False)[:, -1] ** 2
        limit = np.linalg.svd(mixing, compute_uv=False)[-1] ** 2
        if limit == 0:
            return None
        epsilon = np.maximum(0, self.regularisation - smallest / limit)
        return np.repeat(epsilon[:, None], mixing.shape[1], axis=1)

    def _ridge_of_spectra(self, noise, sources):
        """epsilon = c times noise over C_l of each source (C21, strategy 4)."""
        power = np.stack([np.mean(block**2, axis=1) for block in harmonic.blocks(sources)])
        level = self.regularisation * np.mean(noise)
        return level / np.maximum(power, level / _LARGEST_RIDGE) if level else None

    def _normalised(self, fitted, mixing):
        """`fitted` with columns of unit length; the column of a source that vanished stays as in `mixing`."""
        if self.nonnegative:
            fitted = np.maximum(fitted * np.where(fitted.sum(axis=0) < 0, -1, 1), 0)
        length = np.linalg.norm(fitted, axis=0)
        return np.where(length > 0, fitted / np.where(length > 0, length, 1), mixing)

    def _sparse(self, mixture):
        analytic = self.thresholds == "analytic"
        return SparseSources(mixture.lmax, self.n_scales, n_sigma=self.n_sigma, analytic=analytic)


def _start(modes, relative, n_sources):
    """Principal components of the data re-convolved to the worst beam at every l, (n_channels, n_sources)."""
    ratios = relative.min(axis=0) / relative
    covariance = np.zeros((len(modes), len(modes)))
    for ratio, block in zip(ratios.T, harmonic.blocks(modes), strict=True):
        convolved = ratio[:, None] * block
        covariance += convolved @ convolved.T
    return principal_axes(covariance, n_sources)


def _change(previous, sources):
    """Relative change of the sources, for the stopping rules (paper, Sect. 3.3)."""
    size = np.linalg.norm(sources)
    return np.linalg.norm(sources - previous) / size if size else 0.0


def _uncorrelated(mixing, sources):
    """The columns of A, orthonormal, turned so that their sources are uncorrelated."""
    return mixing @ np.linalg.eigh(sources @ sources.T)[1]


def _least_squares(mixture, mixing):
    """Sources of A by least squares at every l, as real modes."""
    return harmonic.project(harmonic.safe_inverse(mixture.matrices(mixing)), mixture.modes)
