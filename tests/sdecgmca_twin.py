"""One iteration of SDecGMCA, slowly and with healpy alone: the oracle of `himap.removal.sdecgmca`.

Everything is done on complex coefficients and HEALPix maps, one source, one scale, one channel after the
other, as Carloni Gertosio & Bobin (2021, C21) and the paper's Sect. 3.3 have it. Coefficients with m > 0
stand for two, m and -m.
"""

import healpy
import numpy as np


def degrees(lmax):
    return healpy.Alm.getlm(lmax)[0]


def twice(lmax):
    return np.where(healpy.Alm.getlm(lmax)[1] == 0, 1, 2)


def spline(x):
    """The cubic B-spline of C21's filters: 3/2 times the mean of five cubes."""
    cubes = [np.abs(x + shift) ** 3 for shift in (-2, -1, 0, 1, 2)]
    return 1.5 * np.dot([1, -4, 6, -4, 1], cubes) / 12


def low_passes(n_scales, lmax, kind):
    """[h_1, h_2, ...], each (lmax + 1,)."""
    degree = np.arange(lmax + 1)
    passes = []
    for j in range(n_scales):
        h = spline(4 * 2**j * degree / lmax)
        if kind == "ratio":
            h = h / (spline(2 * 2**j * degree / lmax) + 1e-6)
            h[degree >= int(lmax / (2 * 2**j))] = 0
        passes.append(h)
    return passes


def raised(matrix, floor):
    """A symmetric matrix whose singular values are no less than `floor` times the largest."""
    left, values, right = np.linalg.svd(matrix)
    return left @ np.diag(np.maximum(values, floor * values[0])) @ right


def source_update(data, beams, mixing, epsilon, floor):
    """(A^T H_l^2 A + diag(epsilon_l))^-1 A^T H_l X_lm (C21, Eq. 21); and the inverses, one for each l."""
    lmax = beams.shape[1] - 1
    inverses = []
    for degree in range(lmax + 1):
        seen = beams[:, degree, None] * mixing
        normal = raised(seen.T @ seen + np.diag(epsilon[:, degree]), floor)
        inverses.append(np.linalg.solve(normal, seen.T))
    sources = np.array(
        [inverses[degree] @ column for degree, column in zip(degrees(lmax), data.T, strict=True)]
    )
    return sources.T, inverses


def matrix_epsilon(beams, mixing, strength):
    """Strategy #3 of C21, Eq. 26, (n_sources, lmax + 1)."""
    smallest = np.linalg.svd(mixing.T @ mixing, compute_uv=False)[-1]
    values = []
    for window in beams.T:
        seen = window[:, None] * mixing
        values.append(max(0, strength - np.linalg.svd(seen.T @ seen, compute_uv=False)[-1] / smallest))
    return np.tile(values, (mixing.shape[1], 1))


def spectrum_epsilon(sources, noise, strength):
    """Strategy #4 of C21, Eq. 27: c times noise over C_l of each source, (n_sources, lmax + 1)."""
    return np.array([strength * noise / healpy.alm2cl(source) for source in sources])


def thresholded(sources, inverses, memory, method, nside, channel_noise):
    """Sources after the thresholds of all their scales, and their coefficients."""
    lmax = len(inverses) - 1
    passes = low_passes(method.n_scales, lmax, method.wavelets)
    after, remembered = [], []
    for n, source in enumerate(sources):
        finer, finer_pass, total, own = healpy.alm2map(source, nside), np.ones(lmax + 1), 0, []
        for j, low_pass in enumerate(passes):
            smooth = healpy.alm2map(healpy.almxfl(source, low_pass), nside)
            scale, band = finer - smooth, finer_pass - low_pass
            if method.thresholds == "mad":
                sigma = np.median(np.abs(scale - np.median(scale))) / 0.6735
            else:
                variance = 0
                for degree, inverse in enumerate(inverses):
                    per_mode = np.sum(inverse[n] ** 2 * channel_noise)
                    variance += (2 * degree + 1) * band[degree] ** 2 * per_mode / (4 * np.pi)
                sigma = np.sqrt(variance)
            sizes, cut = np.abs(scale), method.n_sigma * sigma
            n_kept = max(int(method.share * np.sum(sizes > cut)), method.least_kept)
            threshold = np.sort(sizes)[-n_kept] if n_kept else np.inf
            if memory is not None:
                threshold = threshold / (1 + np.abs(memory[n][j]) / cut)
            shrunk = np.where(sizes > threshold, np.sign(scale) * (sizes - threshold), 0)
            own.append(np.where(sizes == threshold, scale, shrunk))
            total = total + own[-1]
            finer, finer_pass = smooth, low_pass
        after.append(healpy.map2alm(total + finer, lmax=lmax, iter=3))
        remembered.append(own)
    return np.array(after), remembered


def mixing_update(data, beams, sources, window, floor):
    """A by least squares of window_l X_lm = H_l A window_l S_lm, channel by channel (C21, Eq. 14)."""
    lmax = beams.shape[1] - 1
    seen = sources * window[degrees(lmax)]
    rows = []
    for channel, beam in zip(data, beams, strict=True):
        h = beam[degrees(lmax)]
        normal = np.real((twice(lmax) * h**2 * seen) @ seen.conj().T)
        cross = np.real((twice(lmax) * h * window[degrees(lmax)] * channel) @ seen.conj().T)
        rows.append(np.linalg.solve(raised(normal, floor), cross))
    return np.array(rows)


def iteration(alms, problem, method, nside, mixing, sources, memory, *, refining):
    """A, S and its coefficients after one iteration of an `SDecGMCA` at its largest share.

    Of coefficients (n_channels, n_alm), with beams and noise of `problem`; A, S and the memory are those of
    the last iteration, the last two None in the warm-up.
    """
    beams = problem.beams
    if refining and method.coefficients == "spectrum":
        epsilon = spectrum_epsilon(sources, np.mean(problem.noise), method.regularisation)
    else:
        epsilon = matrix_epsilon(beams, mixing, method.regularisation)
    sources, inverses = source_update(alms, beams, mixing, epsilon, method.floor)
    sources, coefficients = thresholded(sources, inverses, memory, method, nside, problem.noise)
    window = np.ones(beams.shape[1])
    if method.mixing_scales == "detail":
        window -= low_passes(method.n_scales, len(window) - 1, method.wavelets)[-1]
    mixing = mixing_update(alms, beams, sources, window, method.floor)
    if method.sign == "nonnegative":
        mixing = np.maximum(mixing * np.where(mixing.sum(axis=0) < 0, -1, 1), 0)
    memory = coefficients if refining and method.reweighted else None
    return mixing / np.linalg.norm(mixing, axis=0), sources, memory
