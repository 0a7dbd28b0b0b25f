"""What a user would do without himap, for each method: plain code on well-known packages.

What takes too long is done on a sample; `alternatives_to` says how many times that is all of the work.
"""

import warnings
from functools import partial

import numpy as np
from numpy.polynomial import legendre
from scipy.optimize import least_squares
from sklearn.decomposition import PCA, FastICA
from sklearn.exceptions import ConvergenceWarning

from himap.maps import sphere
from himap.paper import pipeline
from himap.removal import harmonic
from himap.removal.gmca import SphereDetails
from himap.removal.parametric import FIXED_INDEX

N_LINES, N_CHANNELS, N_MODES = 64, 8, 1000  # the sample that a slow alternative is timed on


def alternatives_to(case, method, separation):
    """The alternatives to a method on a `Case` where it gave a `Separation`; method None is peak masking.

    Returns a list of (name, function, how many times the work of that function is the work of the method),
    empty for a method that this file does not know. The table of all steps has the first.
    """
    alternatives = _ALTERNATIVES.get(method.name) if method else _for_polynomials
    if alternatives is None:
        return []
    masked = pipeline.peak_masked(case).maps if method else pipeline.observation(case).maps
    return list(alternatives(case, masked, method, separation))


def evenly(n_all, n_sample):
    """Indices of at most `n_sample` of `n_all` things."""
    return np.linspace(0, n_all - 1, min(n_all, n_sample)).astype(int)


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


def _on_sample(name, function, items, n_all):
    """The alternative that calls `function` on each of `n_all` things, from a sample of them."""
    return name, lambda: [function(item) for item in items], n_all / len(items)


def _for_pca(case, masked, method, separation):
    maps, model = pipeline.observation(case).maps, PCA(method.n_sources)
    yield "scikit-learn PCA", partial(plain_residual, model, maps, masked), 1


def _for_fastica(case, masked, method, separation):
    """By both of its ways to whiten: eigh, meant for many more pixels than channels, and svd, its default."""
    maps = pipeline.observation(case).maps
    options = {"fun": method.contrast, "max_iter": method.max_iterations, "tol": method.tolerance}
    for solver in ("eigh", "svd"):
        model = FastICA(method.n_sources, whiten_solver=solver, random_state=0, **options)
        yield f"scikit-learn FastICA, whitened by {solver}", partial(plain_residual, model, maps, masked), 1


def _for_polynomials(case, masked, method, separation):
    n_pix = masked.shape[1]
    block = evenly(n_pix, N_LINES**2)
    yield "numpy legfit, in blocks", lambda: plain_polynomials(masked[:, block]), n_pix / len(block)
    lines = masked[:, evenly(n_pix, N_LINES)].T
    yield _on_sample("numpy legfit, line by line", plain_polynomials, lines, n_pix)


def _for_parametric(case, masked, method, separation):
    n_pix = masked.shape[1]
    lines, x = masked[:, evenly(n_pix, N_LINES)].T.astype(float), case.survey.freqs / method.nu0
    fit = partial(plain_power_laws, x=x, beta_min=method.beta_min, beta_max=method.beta_max)
    yield _on_sample("scipy least_squares, line by line", fit, lines, n_pix)


def _for_gmca(case, masked, method, separation):
    channels = evenly(len(masked), N_CHANNELS)
    inverse = np.linalg.pinv(separation.mixing)[:, channels]

    def work():
        cube = masked[channels].astype(float)
        scales = SphereDetails(method.n_scales, sphere.nside_of(cube)).details(cube)
        for _ in range(separation.n_iterations):
            for scale in scales:
                scale @ (inverse @ scale).T

    name = "starlets of the whole cube, A^+ X and X S^T on them in each iteration, no thresholds"
    yield name, work, len(masked) / len(channels)


def _for_sdecgmca(case, masked, method, separation):
    """A part of it: the update of all sources for a given A in each iteration; of random numbers, whose
    values cost no time.
    """
    lmax = min(method.lmax, 2 * case.survey.nside)
    matrices = pipeline.observation(case).beams.T[: lmax + 1, :, None] * separation.mixing
    modes = np.random.default_rng(0).standard_normal((len(separation.mixing), (lmax + 1) ** 2))
    n_iterations = max(1, separation.n_iterations)
    yield "sources alone, by numpy lstsq, l by l", partial(plain_sources, matrices, modes), n_iterations
    alms, degree = np.ascontiguousarray(harmonic.from_modes(modes).T), sphere.alm_degree(lmax)
    name, work, times = _on_sample(
        "sources alone, by numpy lstsq, (l, m) by (l, m)",
        lambda n: np.linalg.lstsq(matrices[degree[n]], alms[n]),
        evenly(len(alms), N_MODES),
        len(alms),
    )
    yield name, work, n_iterations * times


_ALTERNATIVES = {
    "pca": _for_pca,
    "fastica": _for_fastica,
    "gmca": _for_gmca,
    "sdecgmca": _for_sdecgmca,
    "polynomial": _for_polynomials,
    "parametric": _for_parametric,
}
