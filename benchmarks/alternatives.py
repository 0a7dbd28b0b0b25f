"""What a user would do without himap, for each method: plain code on well-known packages, and its time.

What takes too long is timed on a sample and scaled up; the printed line says so.
"""

import time
import warnings
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.polynomial import legendre
from scipy.optimize import least_squares
from sklearn.decomposition import PCA, FastICA
from sklearn.exceptions import ConvergenceWarning

from himap.maps import sphere
from himap.removal import harmonic
from himap.removal.base import ForegroundRemover
from himap.removal.blurred_mixture import BlurredMixture
from himap.removal.gmca import SphereDetails
from himap.removal.parametric import FIXED_INDEX

N_LINES, N_CHANNELS, N_MODES = 64, 8, 1000  # the sample that a slow alternative is timed on


@dataclass(frozen=True, kw_only=True)
class Run:
    """A method that has run, on cubes `maps` and `masked`; peak masking has no `remover` and no `mixing`."""

    label: str
    remover: ForegroundRemover | None
    maps: np.ndarray
    masked: np.ndarray
    freqs: np.ndarray
    beams: np.ndarray
    mixing: np.ndarray | None
    n_iterations: int
    seconds: float


@dataclass(frozen=True, kw_only=True)
class Alternative:
    """What a user would do without himap, its seconds, and ours for the same thing: the method or a part."""

    name: str
    seconds: float
    ours: float
    part: str = ""
    sample: str = ""

    def __str__(self):
        part = f"{self.part} ({self.ours:.2g} s): " if self.part else ""
        sample = f" [sampled: {self.sample}, scaled up]" if self.sample else ""
        return f"{self.seconds / self.ours:12.2f} x  {part}{self.name}{sample}"


def timed(function, *args, **kwargs):
    """Result and seconds of a call."""
    start = time.perf_counter()
    result = function(*args, **kwargs)
    return result, time.perf_counter() - start


def alternatives(run):
    """Lines on the alternatives to a method that has run; none for a method that this file does not know."""
    beside = _ALTERNATIVES.get(run.remover.name if run.remover else run.label)
    return [str(alternative) for alternative in beside(run)] if beside else []


def evenly(n_all, n_sample):
    """Indices of at most `n_sample` of `n_all` things."""
    return np.linspace(0, n_all - 1, min(n_all, n_sample)).astype(int)


def quickest(function):
    """Seconds of the quickest of three calls, for what is short."""
    return min(timed(function)[1] for _ in range(3))


def one_by_one(name, function, items, n_all, kind, **fields):
    """The alternative that calls `function` on each of `n_all` things, from a sample of them."""
    _, seconds = timed(lambda: [function(item) for item in items])
    sample = f"{len(items)} of {n_all} {kind}"
    return Alternative(name=name, seconds=seconds * n_all / len(items), sample=sample, **fields)


def plain_residual(model, maps, masked):
    """Maps less what a scikit-learn decomposition finds in the masked ones, (n_channels, n_pix) float64."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        sources = model.fit_transform(masked.T.astype(float))
    return maps - model.inverse_transform(sources).T


def plain_polynomials(lines, order=6, n_sigma=5.0):
    """Fit, clip, fit again: polynomials along lines of sight, (n_channels, n_lines) or one (n_channels,)."""
    lines = np.array(lines, dtype=float).reshape(len(lines), -1)
    u = np.linspace(-1, 1, len(lines))
    fit = legendre.legval(u, legendre.legfit(u, lines, order)).T
    residual = lines - fit
    kept = np.abs(residual) <= n_sigma * residual.std(axis=0)
    for n in np.flatnonzero(~kept.all(axis=0)):
        fit[:, n] = legendre.legval(u, legendre.legfit(u, lines[:, n], order, w=kept[:, n]))
    return fit


def plain_power_laws(line, x, beta_min, beta_max):
    """a1, a2, beta of free-free emission and a power law along one line of sight; x is frequency over nu0."""
    bounds = [(-np.inf, -np.inf, beta_min), (np.inf, np.inf, beta_max)]
    start = (0.1 * line.mean(), 0.9 * line.mean(), -2.7)

    def misfit(p):
        return p[0] * x**FIXED_INDEX + p[1] * x ** p[2] - line

    return least_squares(misfit, start, bounds=bounds, x_scale="jac").x


def plain_sources(matrices, modes):
    """Least-squares sources at every l, real modes (n_sources, (lmax + 1)^2)."""
    pairs = zip(matrices, harmonic.blocks(modes), strict=True)
    return np.hstack([np.linalg.lstsq(matrix, block)[0] for matrix, block in pairs])


def beside_pca(run):
    """scikit-learn, as in its manual."""
    _, seconds = timed(plain_residual, PCA(run.remover.n_sources), run.maps, run.masked)
    yield Alternative(name="scikit-learn PCA in float64", seconds=seconds, ours=run.seconds)


def beside_fastica(run):
    """scikit-learn, by both of its ways to whiten; svd is the default."""
    remover = run.remover
    options = {"fun": remover.contrast, "max_iter": remover.max_iterations, "tol": remover.tolerance}
    for solver in ("svd", "eigh"):
        model = FastICA(remover.n_sources, whiten_solver=solver, random_state=0, **options)
        _, seconds = timed(plain_residual, model, run.maps, run.masked)
        name = f"scikit-learn FastICA in float64, whitened by {solver}, {model.n_iter_} iterations"
        yield Alternative(name=name, seconds=seconds, ours=run.seconds)


def beside_polynomial(run):
    """numpy, on the cube at once as far as it can be, and line by line."""
    maps = run.masked if run.remover else run.maps
    _, seconds = timed(plain_polynomials, maps)
    name = "numpy legfit in float64, all lines at once, then one by one where clipped"
    yield Alternative(name=name, seconds=seconds, ours=run.seconds)
    lines = maps[:, evenly(maps.shape[1], N_LINES)].T
    yield one_by_one(
        "numpy legfit, line by line", plain_polynomials, lines, maps.shape[1], "lines", ours=run.seconds
    )


def beside_parametric(run):
    """scipy, line by line."""
    remover, n_pix = run.remover, run.masked.shape[1]
    lines = run.masked[:, evenly(n_pix, N_LINES)].T.astype(float)
    fit = partial(
        plain_power_laws, x=run.freqs / remover.nu0, beta_min=remover.beta_min, beta_max=remover.beta_max
    )
    yield one_by_one("scipy least_squares, line by line", fit, lines, n_pix, "lines", ours=run.seconds)


def beside_gmca(run):
    """The cube in starlets, made in each iteration; or once, with two products of it in each iteration."""
    n_channels = len(run.masked)
    channels = evenly(n_channels, N_CHANNELS)
    factor = n_channels / len(channels)
    inverse = np.linalg.pinv(run.mixing)[:, channels]
    cube = run.masked[channels].astype(float)
    scales, seconds_once = timed(SphereDetails(run.remover.n_scales, sphere.nside_of(cube)).details, cube)
    _, seconds_each = timed(lambda: [scale @ (inverse @ scale).T for scale in scales])
    sample = f"{len(channels)} of {n_channels} channels"
    yield Alternative(
        name="starlets of the whole cube, without the iteration itself",
        seconds=seconds_once * factor,
        ours=run.seconds / run.n_iterations,
        part="an iteration",
        sample=sample,
    )
    yield Alternative(
        name="starlets of the whole cube once, A^+ X and X S^T on them in each iteration, no thresholds",
        seconds=(seconds_once + run.n_iterations * seconds_each) * factor,
        ours=run.seconds,
        sample=sample,
    )


def beside_sdecgmca(run):
    """The update of all sources for a given A; on random numbers, for their values cost no time."""
    lmax = min(run.remover.lmax, 2 * sphere.nside_of(run.maps))
    matrices = run.beams.T[: lmax + 1, :, None] * run.mixing
    modes = np.random.default_rng(0).standard_normal((len(run.mixing), (lmax + 1) ** 2))
    mixture = BlurredMixture(modes, run.beams[:, : lmax + 1])
    ours = quickest(lambda: mixture.sources(mixture.least_squares(run.mixing)))
    common = {"ours": ours, "part": "sources from A once"}
    seconds = quickest(lambda: plain_sources(matrices, modes))
    yield Alternative(name="numpy lstsq, l by l", seconds=seconds, **common)
    alms, degree = np.ascontiguousarray(harmonic.from_modes(modes).T), sphere.alm_degree(lmax)
    yield one_by_one(
        "numpy lstsq, (l, m) by (l, m)",
        lambda n: np.linalg.lstsq(matrices[degree[n]], alms[n]),
        evenly(len(alms), N_MODES),
        len(alms),
        "modes",
        **common,
    )


_ALTERNATIVES = {
    "peak masking": beside_polynomial,
    "pca": beside_pca,
    "fastica": beside_fastica,
    "gmca": beside_gmca,
    "sdecgmca": beside_sdecgmca,
    "beam_subspace": beside_sdecgmca,
    "polynomial": beside_polynomial,
    "parametric": beside_parametric,
}
