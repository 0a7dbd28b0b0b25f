"""What this machine can do, measured on the spot, and what every step of the chain needs of it at least.

Transforms, bytes moved, and operations of matrix products: their time is the floor of a step.
"""

from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from himap.maps import sphere
from himap.sky.cosmology import Cosmology, redshift
from himap.sky.light_cone import plan_rays

_BYTES = 2**28  # of an array far larger than the caches
_SIDE = 1500  # of the matrices that are multiplied
_ANALYSIS = 2 * sphere.N_ITER_FLAT + 1  # transforms


@dataclass(frozen=True, kw_only=True)
class Machine:
    """Bytes moved and operations done in a second, and seconds of one transform, in float32 and float64."""

    bandwidth: float
    operations: float
    operations_single: float
    transform: float
    transform_single: float

    @classmethod
    def measured(cls, nside):
        """Of this machine, all cores, with transforms between maps of `nside` and l = 3 nside - 1."""
        source, target = np.ones(_BYTES // 8), np.zeros(_BYTES // 8)
        matrix = np.random.default_rng(0).standard_normal((_SIDE, _SIDE))
        single = matrix.astype(np.float32)
        alm = sphere.gaussian_alm(np.ones(3 * nside), np.random.default_rng(0))
        alm_single = alm.astype(np.complex64)
        return cls(
            bandwidth=2 * _BYTES / _quickest(lambda: np.copyto(target, source)),
            operations=2 * _SIDE**3 / _quickest(lambda: matrix @ matrix),
            operations_single=2 * _SIDE**3 / _quickest(lambda: single @ single),
            transform=_quickest(lambda: sphere.synthesise(alm, nside)),
            transform_single=_quickest(lambda: sphere.synthesise(alm_single, nside)),
        )


@dataclass(frozen=True, kw_only=True)
class Needs:
    """What a step cannot do without: transforms, bytes moved, operations of matrix products."""

    transforms: float = 0
    transforms_single: float = 0
    n_bytes: float = 0
    operations: float = 0
    operations_single: float = 0

    def floor(self, machine):
        """Seconds on `machine`, if nothing were lost and nothing overlapped."""
        transforms = self.transforms * machine.transform + self.transforms_single * machine.transform_single
        products = self.operations / machine.operations + self.operations_single / machine.operations_single
        return transforms + self.n_bytes / machine.bandwidth + products


def _quickest(function):
    """Seconds of the quickest of five calls, after one that does not count."""
    function()
    seconds = []
    for _ in range(5):
        started = perf_counter()
        function()
        seconds.append(perf_counter() - started)
    return min(seconds)


def _cube(survey):
    return 4 * survey.n_channels * survey.n_pix


def light_cone(survey, _):
    """Five transforms of the box (noise, density, three displacements), three passes each; the rays.

    Of the rays two trilinear interpolations in every step, of seven times two operations.
    """
    far, near = Cosmology().comoving_distance(redshift(survey.freq_edges[[0, -1]]))
    bounds, step = plan_rays(survey.nside, survey.box_size / survey.box_cells, near, far)
    lengths, box = np.diff(bounds) / step, 4 * survey.box_cells**3
    n_steps = survey.n_pix * float(lengths @ 4.0 ** np.arange(len(lengths)))  # of all rays
    n_bytes = 5 * 3 * 2 * box + 4 * 2 * box + 2 * box + _cube(survey)
    return Needs(n_bytes=n_bytes, operations_single=2 * 7 * 2 * n_steps)


def observations(survey, _):
    """Coefficients of HI and noise; HI, noise and foregrounds of three beams."""
    n = survey.n_channels
    return Needs(transforms_single=(2 * _ANALYSIS + 3) * n, transforms=3 * n, n_bytes=3 * 4 * _cube(survey))


def lines(survey, _):
    """Polynomials of order 6: the cube read twice and written once, two projections."""
    n = survey.n_channels * survey.n_pix
    return Needs(n_bytes=3 * _cube(survey), operations=4 * 7 * n)


def pca(survey, residual):
    """A covariance and two products with the cube; cube centred, read, mixed and subtracted."""
    n, n_sources = survey.n_channels * survey.n_pix, residual.mixing.shape[1]
    return Needs(n_bytes=8 * _cube(survey), operations=(survey.n_channels + 4 * n_sources) * n)


def fastica(survey, residual):
    """PCA, and in each iteration products of whitened maps, float64."""
    shared = pca(survey, residual)
    source_bytes = residual.mixing.shape[1] * survey.n_pix * 8
    return replace(shared, n_bytes=shared.n_bytes + 3 * source_bytes * residual.n_iterations)


def parametric(survey, _):
    """At least two products of every line with the curves of one index, and the result."""
    n = survey.n_channels * survey.n_pix
    return Needs(n_bytes=4 * _cube(survey), operations=2 * 2 * 2 * n)


def gmca(survey, residual):
    """In each iteration two products with the cube, float32, and the starlets of the sources and back."""
    n, n_sources = survey.n_channels * survey.n_pix, residual.mixing.shape[1]
    work = Needs(n_bytes=2 * _cube(survey), operations_single=4 * n_sources * n, transforms=1.4 * n_sources)
    return Needs(**{name: residual.n_iterations * value for name, value in vars(work).items()})


def analysis(survey, _):
    """Every channel once, a few bright maps closely; a covariance and a projection of the cube."""
    n = survey.n_channels * survey.n_pix
    return Needs(
        transforms_single=survey.n_channels,
        transforms=6 * (2 * sphere.N_ITER + 1),
        n_bytes=4 * _cube(survey),
        operations=survey.n_channels * n,
    )


def beam_subspace(survey, found):
    """As `sdecgmca`, and a transform for each spectrum that is subtracted."""
    return replace(sdecgmca(survey, found), transforms_single=len(found.foreground.maps))


def sdecgmca(survey, found):
    """In each iteration two products with the modes, float64, and four scales of every source and back."""
    lmax, (n_channels, n_sources) = min(200, 2 * survey.nside), found.mixing.shape
    n_modes, n_iterations = n_channels * (lmax + 1) ** 2, found.n_iterations
    share = (lmax / survey.lmax) ** 3  # of the work of a whole transform
    return Needs(
        transforms=6 * n_sources * n_iterations * share,
        n_bytes=2 * 8 * n_modes * n_iterations,
        operations=4 * n_sources * n_modes * n_iterations,
    )


def spectra(survey, _):
    """The coefficients of the truth, read and added to; some ten maps analysed; a product with the truth."""
    n = survey.n_channels * survey.n_pix
    return Needs(
        transforms_single=(2 * sphere.N_ITER + 1) * 10,
        n_bytes=_cube(survey) + 3 * 4 * survey.n_channels * sphere.alm_size(survey.lmax) * 2,
        operations=2 * 10 * n,
    )
