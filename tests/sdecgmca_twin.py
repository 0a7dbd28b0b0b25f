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


def thresholded(sources, inverses, memory, share, settings, channel_noise):
    """Sources after the thresholds of all their scales; coefficients; and what is remembered of them."""
    nside, lmax, n_sigma = settings["nside"], settings["lmax"], settings["n_sigma"]
    passes = low_passes(settings["n_scales"], lmax, settings["wavelets"])
    after, remembered = [], []
    for n, source in enumerate(sources):
        finer, finer_pass, total, own = healpy.alm2map(source, nside), np.ones(lmax + 1), 0, []
        for j, low_pass in enumerate(passes):
            smooth = healpy.alm2map(healpy.almxfl(source, low_pass), nside)
            scale, band = finer - smooth, finer_pass - low_pass
            if settings["thresholds"] == "mad":
                sigma = np.median(np.abs(scale - np.median(scale))) / 0.6735
            else:
                variance = 0
                for degree, inverse in enumerate(inverses):
                    per_mode = np.sum(inverse[n] ** 2 * channel_noise)
                    variance += (2 * degree + 1) * band[degree] ** 2 * per_mode / (4 * np.pi)
                sigma = np.sqrt(variance)
            sizes = np.abs(scale)
            significant = np.sort(sizes[sizes > n_sigma * sigma])
            if share == 1:
                threshold = n_sigma * sigma
            else:
                n_kept = max(int(share * len(significant)), settings["least_kept"])
                threshold = np.sort(sizes)[-n_kept] if n_kept else np.inf
            if memory is not None:
                threshold = threshold / (1 + np.abs(memory[n][j]) / (n_sigma * sigma))
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


def iteration(data, beams, mixing, sources, memory, share, settings, *, refining, channel_noise):
    """A, S and the memory after one iteration.

    Parameters
    ----------
    data, beams
        Coefficients (n_channels, n_alm), and H_l (n_channels, lmax + 1).
    mixing, sources, memory
        A, S and the memory of the last one; the last two may be None in the warm-up.
    share, settings
        K, and the options of `SDecGMCA` with nside and lmax, a dict.
    refining
        Whether this is an iteration of the refinement.
    channel_noise
        Variance of the noise per mode, (n_channels,).
    """
    strength = settings["regularisation"]
    if refining and settings["coefficients"] == "spectrum":
        epsilon = spectrum_epsilon(sources, np.mean(channel_noise), strength)
    else:
        epsilon = matrix_epsilon(beams, mixing, strength)
    sources, inverses = source_update(data, beams, mixing, epsilon, settings["floor"])
    sources, memory = thresholded(sources, inverses, memory, share, settings, channel_noise)
    window = np.ones(beams.shape[1])
    if settings["mixing_scales"] == "detail":
        window -= low_passes(settings["n_scales"], settings["lmax"], settings["wavelets"])[-1]
    mixing = mixing_update(data, beams, sources, window, settings["floor"])
    if settings["sign"] == "nonnegative":
        mixing = np.maximum(mixing * np.where(mixing.sum(axis=0) < 0, -1, 1), 0)
    return mixing / np.linalg.norm(mixing, axis=0), sources, memory
