"""A plain twin of GMCA with the whole cube in starlets, and how near found sources are to true ones."""

import numpy as np


def plain_gmca(maps, n_sources, matrices, n_iterations, n_falling, soft):
    """GMCA as in its definition: the starlets of the whole cube, pseudo-inverses, sorted coefficients."""
    starlets = np.concatenate([maps @ matrix.T for matrix in matrices], axis=1)
    mixing = np.linalg.svd(maps, full_matrices=False)[0][:, :n_sources]
    for iteration in range(n_iterations):
        coefficients = np.linalg.pinv(mixing) @ starlets
        for row in coefficients:
            for scale in np.split(row, len(matrices)):
                last = 3 * 1.4826 * np.median(np.abs(scale))
                size = np.sort(np.abs(scale)[np.abs(scale) > last])
                n_kept = int(np.ceil(min(1, (iteration + 1) / n_falling) * len(size)))
                limit = last if n_kept == len(size) else size[-n_kept - 1]
                kept = np.abs(scale) > limit
                scale[:] = np.where(kept, scale - limit * np.sign(scale) * soft, 0)
        mixing = starlets @ np.linalg.pinv(coefficients)
        mixing /= np.linalg.norm(mixing, axis=0)
    return mixing


def similarity(one, two):
    """Largest absolute correlation of every row of `one` with a row of `two`."""
    return np.abs(np.corrcoef(one, two)[: len(one), len(one) :]).max(axis=1)


def mixing_error(found, true):
    """Mean absolute entry of A^+ A_true less the permutation with signs that fits best (C21, Eq. 33)."""
    product = np.linalg.pinv(found) @ true
    best = np.abs(product).argmax(axis=0)
    assert sorted(best) == list(range(len(product)))  # each source found once
    product = product[best] * np.sign(product[best].diagonal())[:, None]
    return np.abs(product - np.eye(len(product))).mean()
