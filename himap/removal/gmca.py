"""Generalised morphological component analysis (paper, Sect. 3.1.3)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from himap.core.progress import progress
from himap.maps import sphere
from himap.maps.low_rank import SplitCube, projection
from himap.maps.starlets import PlaneStarlets, bands_of, starlet_filters
from himap.removal.base import ForegroundRemover, Separation, parameter
from himap.removal.compiled import sparse
from himap.removal.covariance import bright_axes, channel_covariance, principal_axes
from himap.removal.harmonic import safe_inverse
from himap.removal.separation import ordered

_RANK = 1e-12  # directions of S S^T below this share of the largest are rounding errors


@dataclass(frozen=True, kw_only=True)
class GMCA(ForegroundRemover):
    """Sources that are sparse in starlets (Bobin et al. 2007; Carucci et al. 2020).

    Minimises ``sum_i lambda_i |S_i^wt|_1 + |X^wt - A S^wt|^2`` (Eq. 17), with wt the starlet detail scales,
    by alternating two steps: S = A^+ X with coefficients below the thresholds lambda set to 0, then
    A = X^wt S^T (S S^T)^-1 with columns of unit length. A starts from PCA. The thresholds decrease while the
    sources take shape: the share of coefficients kept, among those above `n_sigma` times the noise, grows
    evenly to all of them in `n_falling` iterations. The noise of a source in a scale is 1.48 times its
    median absolute coefficient. The iteration stops when the change of the foreground is less than
    `tolerance` times the rms of the residual. (A itself keeps drifting: its columns become nearly parallel.)

    Finally S = A^+ X without thresholds, so that the foreground A S depends only on the space that the
    columns of A span. The smooth scale is not used for A: its few large structures are not sparse and too
    few to separate sources. There is no randomness; `rng` is not used.

    The cube is never transformed. X^wt = X Phi^T with Phi linear, so A^+ X^wt = Phi(A^+ X), and
    X^wt S^T = X (Phi^T S)^T: one iteration transforms `n_sources` maps and reads the cube twice.

    Pixels must be a full HEALPix sphere, or those of an image in the plane. In an image, starlets are the
    B-spline wavelets of Starck et al. (2007), computed from observed pixels only (`himap.maps.starlets`);
    unobserved pixels and the area beyond the border do not enter A or the thresholds. On a masked sphere
    all pixels count: bright foreground continues smoothly outside of the mask (`himap.maps.inpaint`).

    Sources are in mK (columns of A of unit length), ordered by variance.
    """

    name: ClassVar[str] = "gmca"
    uses: ClassVar[frozenset] = frozenset({"neighbours"})
    n_sources: int = parameter(3, "number of components to remove", minimum=1)
    n_scales: int = parameter(4, "number of starlet detail scales", minimum=1, maximum=12)
    penalty: str = parameter("l1", "l1 (soft thresholds) or l0 (hard thresholds)", choices=("l0", "l1"))
    n_sigma: float = parameter(3.0, "last threshold, in units of the noise of each scale", minimum=0)
    n_falling: int = parameter(50, "iterations in which the thresholds fall", minimum=1)
    max_iterations: int = parameter(200, "largest number of iterations", minimum=1)
    tolerance: float = parameter(
        1e-3, "change of the foreground to stop at, in units of the residual", minimum=0, above=True
    )

    def _separate(self, data):
        steps = self.iterate(data.centred, data.image, data.covariance)
        for step in progress(steps, "gmca", total=self.max_iterations):
            last = step
        mixing, sources = ordered(last.mixing, projection(safe_inverse(last.mixing[None])[0], data.centred))
        return Separation(
            mixing=mixing, sources=sources, converged=last.converged, n_iterations=last.n_iterations
        )

    def iterate(self, maps, image=None, covariance=None):
        """Yield a `Step` after each iteration, on maps less their channel means.

        `image` is as in `Data`, for pixels of an image in the plane; `covariance` is the `channel_covariance`
        of the maps, if it is known.
        """
        if image is None:
            starlets = SphereDetails(self.n_scales, sphere.nside_of(maps))
        else:
            starlets = PlaneStarlets(image, self.n_scales)
        covariance = channel_covariance(maps) if covariance is None else covariance
        mixing = principal_axes(covariance, self.n_sources)
        cube = SplitCube(maps, bright_axes(covariance, least=self.n_sources))
        for n_iterations in range(1, self.max_iterations + 1):
            share = min(1.0, n_iterations / self.n_falling)
            sources = starlets.details(cube.projection(safe_inverse(mixing[None])[0]))
            limits = np.empty(sources.shape[:-1])
            for index in np.ndindex(limits.shape):
                limits[index] = sparse(sources[index], self.n_sigma, share, soft=self.penalty == "l1")
            updated = _updated(mixing, cube, sources, starlets)
            converged = share == 1 and _settled(mixing, updated, covariance, self.tolerance)
            mixing = updated
            yield Step(n_iterations=n_iterations, mixing=mixing, thresholds=limits, converged=converged)
            if converged:
                return


@dataclass(frozen=True, kw_only=True)
class Step:
    """State of GMCA after `n_iterations`: A, (n_channels, n_sources), and the thresholds of that iteration.

    `thresholds` are (n_scales, n_sources), mK, as the sources; `converged` can be True only in the last step.
    """

    n_iterations: int
    mixing: np.ndarray
    thresholds: np.ndarray
    converged: bool


def _updated(mixing, cube, sources, starlets):
    """X^wt S^T (S S^T)^-1 of sparse coefficients S (n_scales, n_sources, n_pix), columns of unit length."""
    gram = np.einsum("jmp,jnp->mn", sources, sources)
    length = np.sqrt(np.diag(gram))
    alive = length > 0  # a source without nonzero coefficients keeps its column
    length = length[alive]
    cross = cube.correlation(starlets.details_adjoint(sources)[alive]) / length
    gram = gram[np.ix_(alive, alive)] / np.outer(length, length)
    columns = cross @ np.linalg.pinv(gram, rcond=_RANK, hermitian=True) / length
    updated = mixing.copy()
    updated[:, alive] = columns / np.linalg.norm(columns, axis=0)
    return updated


def _settled(before, after, covariance, tolerance):
    """Whether the foregrounds of two A differ by less than `tolerance` times the residual, or by rounding.

    Both are rms over the maps, tr(D C D)^(1/2), with C their covariance and D a difference of projections.
    """
    old, new = (axes @ axes.T for axes in (np.linalg.qr(mixing)[0] for mixing in (before, after)))
    change, residual = (np.sum(p @ covariance * p) for p in (new - old, np.eye(len(new)) - new))
    rounding = np.finfo(np.float32).eps ** 2 * np.trace(covariance)
    return bool(change <= max(tolerance**2 * residual, rounding))


class SphereDetails:
    """Starlet detail scales of HEALPix maps.

    Like `himap.maps.starlets.starlets`, but with plain quadrature, which is less exact (by 1 % of white
    noise on HEALPix) and easy to transpose. As it is linear, a mixture X = A S remains a mixture.
    """

    def __init__(self, n_scales, nside):
        self._n_scales, self._nside = n_scales, nside
        bands = bands_of(starlet_filters(n_scales, 3 * nside - 1)[1:])
        widest = bands[0][0]  # indices of every scale but the finest within the widest of these
        self._bands = [(keep[widest], band) for keep, band in bands]
        self._n_alm = len(self._bands[0][0])

    def details(self, maps):
        """Phi: detail scales of maps (n_maps, n_pix), fine to coarse, (n_scales, n_maps, n_pix) float64."""
        scales = np.empty((self._n_scales, *maps.shape))
        scales[0] = maps
        alms = sphere.analyse(maps, sphere.lmax_of_size(self._n_alm), n_iter=0)
        for scale, (keep, band) in enumerate(self._bands, start=1):
            smooth = sphere.synthesise(alms[:, keep] * band, self._nside)
            scales[0] -= smooth
            if scale < self._n_scales:
                scales[scale] = smooth
        return scales

    def details_adjoint(self, scales):
        """Phi^T: the transpose of `details`, (n_scales, n_maps, n_pix) to (n_maps, n_pix)."""
        alms = np.zeros((scales.shape[1], self._n_alm), dtype=complex)
        for scale, (keep, band) in enumerate(self._bands, start=1):
            difference = scales[scale] - scales[0] if scale < len(scales) else -scales[0]
            alms[:, keep] += sphere.analyse(difference, sphere.lmax_of_size(len(band)), n_iter=0) * band
        return scales[0] + sphere.synthesise(alms, self._nside)
