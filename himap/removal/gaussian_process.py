"""Gaussian process regression: emission that is smooth in frequency is foreground."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy import linalg, optimize
from scipy.special import gammaln, xlogy

from himap.core.errors import InputError
from himap.removal.base import ForegroundRemover, Separation, parameter
from himap.removal.separation import ordered

_LEAST = {"float32": 1e-14, "float64": 1e-20}  # of the variance of the data: the smallest that maps can hold
_MOST = 1e4  # of the variance of the data: a process smoother than the band can have more than the data
_LONGEST = 100.0  # in bands: longer scales give straight lines to the precision of float32
_MOST_STEPS = 500  # about 50 are needed
_OUT_OF_STEPS = 1  # scipy's status
_NOTHING = 1e-6  # foreground share of a direction below which it is dropped
_N_PARAMETERS = 7  # of the kernels
_STARTS = (1e-2, 1e-5)  # of the variance: initial values for the less smooth foreground


@dataclass(frozen=True, kw_only=True)
class GaussianProcess(ForegroundRemover):
    """The mean of a Gaussian process that is smooth in frequency, given the data.

    Every line of sight d is a draw of a process over frequency, a sum of independent ones with covariance

        K = K_smooth + K_mix + K_HI + s^2 1,

    where K_smooth and K_mix are squared exponentials, v exp(-x^2 / (2 L^2)) for channels x MHz apart: the
    foreground as emitted, and the less smooth part added by instruments; K_HI is an exponential, v exp(-x /
    L); and s^2 1 is white noise. The foreground is (K_smooth + K_mix) K^-1 d (Mertens et al. 2018; for single
    dishes Soares et al. 2022, whose kernels these are). No noise level is assumed: s is fitted with all other
    parameters, at the maximum of the marginal likelihood of all n lines of sight,

        ln L = -n/2 (ln det K + tr K^-1 C) + const,   C = d d^T / n,

    by L-BFGS with the exact gradient, from three starts, of which the best result is used. Lines of sight are
    treated as independent draws, which changes the width of the likelihood but not its maximum.

    The foreground is linear in the data, so it is a mixing matrix times sources: the eigenvectors of
    K_foreground relative to K_HI + s^2 1, each times its share of foreground in K, about a dozen above zero.
    Bounds keep the four apart: no foreground scale is below `shortest`, no HI scale above `longest_hi`.
    """

    name: ClassVar[str] = "gaussian_process"
    shortest: float = parameter(
        20.0, "shortest correlation length of the foreground, MHz", minimum=0, above=True
    )
    longest_hi: float = parameter(15.0, "longest correlation length of HI, MHz", minimum=0, above=True)

    def least_channels(self, n_channels):
        return _N_PARAMETERS

    def _separate(self, data):
        variance, band = np.trace(data.covariance) / len(data.covariance), np.ptp(data.freqs)
        if variance == 0:
            raise InputError(f"{self.name} needs maps that vary over the sky, got none that does.")
        mixes = [(_STARTS[0], band / 5), (_STARTS[1], band / 5), (_STARTS[1], 1.5 * self.shortest)]
        least = _LEAST[data.centred.dtype.name]
        runs = [self._maximised(data.freqs, data.covariance / variance, least, *mix) for mix in mixes]
        best = min(runs, key=lambda run: run.fun)
        spectra, rows = smoother(best.x, data.freqs)
        mixing, sources = ordered(spectra, data.project(rows))
        # A search that cannot improve beyond rounding has converged too, though scipy calls it abnormal.
        return Separation(
            mixing=mixing, sources=sources, converged=best.status != _OUT_OF_STEPS, n_iterations=best.nit
        )

    def _maximised(self, freqs, covariance, least, mix, length):
        """Maximum-likelihood logarithms of the parameters, scipy's result, in units of the data's variance.

        No variance is below `least`; `mix` and `length`, MHz, are the initial variance and length of the less
        smooth foreground.
        """
        band = freqs[-1] - freqs[0]
        faint = np.clip(np.median(np.linalg.eigvalsh(covariance)), least, 1)
        amplitude = np.log([least, _MOST])
        foreground = np.log([self.shortest, max(_LONGEST * band, 2 * self.shortest)])
        signal = np.log([self.longest_hi / _LONGEST, self.longest_hi])
        bounds = [amplitude, foreground, amplitude, foreground, amplitude, signal, amplitude]
        start = np.log([1, band, mix, length, faint, self.longest_hi / 3, faint])
        return optimize.minimize(
            cost,
            np.clip(start, *np.transpose(bounds)),
            args=(freqs, covariance),
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"maxiter": _MOST_STEPS, "maxfun": 2 * _MOST_STEPS, "ftol": 1e-10, "gtol": 1e-6},
        )


def kernel_terms(logs, freqs):
    """Roots of K_smooth and K_mix with their derivatives; K_HI, its derivative in ln L, and K_noise.

    `logs` are the logarithms of 7 parameters: variance and length of the smooth part, of the mix and of HI,
    and the variance of the noise; lengths in MHz.
    """
    place = freqs - 0.5 * (freqs[0] + freqs[-1])
    roots = [squared_exponential(place, *pair) for pair in (logs[:2], logs[2:4])]
    ratio = np.abs(freqs[:, None] - freqs) / np.exp(logs[5])
    kernel = np.exp(logs[4] - ratio)
    return roots, (kernel, kernel * ratio, np.exp(logs[6]) * np.eye(len(freqs)))


def cost(logs, freqs, covariance):
    """-ln L / n without its constant, and its gradient, (7,)."""
    roots, terms = kernel_terms(logs, freqs)
    rest = terms[0] + terms[2]
    _, rows, power = _whitened(roots, rest)
    # K^-1 = rows^T rows, and ln det K is the sum over its factors.
    rows /= np.sqrt(1 + power)[:, None]
    known = rows @ covariance @ rows.T
    value = 0.5 * (np.linalg.slogdet(rest)[1] + np.log1p(power).sum() + np.trace(known))
    excess, slope = np.eye(len(known)) - known, []
    for root, derivative in roots:
        seen = excess @ (rows @ root)
        slope += [0.5 * np.vdot(seen, rows @ root), np.vdot(seen, rows @ derivative)]
    change = 0.5 * rows.T @ excess @ rows
    return value, np.array(slope + [np.vdot(change, term) for term in terms])


def squared_exponential(place, variance, length):
    """A root F of v exp(-(x - y)^2 / (2 L^2)) = F F^T, and its derivative with respect to ln L.

    F_k(x) = sqrt(v / k!) (x / L)^k exp(-x^2 / (2 L^2)), from the series of exp(x y / L^2). It is computed
    from logarithms, since its factors may underflow, and keeps nearly all digits. A numerical root of the
    matrix would have an error of rounding times v in every eigenvalue, more than HI. `place` is x, MHz from
    the middle of the band, (n_channels,); `variance` and `length` are the logarithms of v, mK^2, and L.
    """
    ratio = place / np.exp(length)
    largest = np.abs(ratio).max()
    order = np.arange(int(largest**2 + 12 * largest + 40))  # beyond, terms are below 1e-16 of the largest
    size = xlogy(order, np.abs(ratio)[:, None]) - 0.5 * gammaln(order + 1)
    root = np.sign(ratio[:, None]) ** order * np.exp(0.5 * variance - 0.5 * ratio[:, None] ** 2 + size)
    return root, root * (ratio[:, None] ** 2 - order)


def smoother(logs, freqs):
    """Factor K_foreground K^-1 as spectra times rows, (n_channels, n) and (n, n_channels)."""
    roots, (hi, _, noise) = kernel_terms(logs, freqs)
    spectra, rows, power = _whitened(roots, hi + noise)
    share = power / (1 + power)
    kept = share > _NOTHING
    return spectra[:, kept], share[kept, None] * rows[kept]


def _whitened(roots, rest):
    """Spectra, rows and powers with K_HI + noise = spectra spectra^T, rows spectra = 1, and
    K_foreground = spectra diag(power) spectra^T.

    Uses singular values of the roots, whose errors are rounding relative to the largest. Eigenvalues would
    have errors relative to the largest power, which is 1e12 times that of HI.
    """
    factor, root = linalg.cholesky(rest, lower=True), np.hstack([root for root, _ in roots])
    white = linalg.solve_triangular(factor, root, lower=True)
    white = np.pad(white, ((0, 0), (0, max(0, len(white) - white.shape[1]))))  # as many axes as channels
    axes, size, _ = np.linalg.svd(white, full_matrices=False)
    rows = linalg.solve_triangular(factor, axes, lower=True, trans="T").T
    return factor @ axes, rows, size**2
