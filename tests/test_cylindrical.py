"""P(k_perp, k_par) against closed forms and a slow sum over cells."""

import numpy as np
import pytest

from himap.measures.cylindrical import cylindrical_power

CELL = np.array([3.0, 2.0, 2.5])


def place_of(found, k_perp, k_par):
    return tuple(
        np.searchsorted(edges, k) - 1 for edges, k in ((found.par_edges, k_par), (found.perp_edges, k_perp))
    )


@pytest.mark.parametrize("kept", [1.0, 0.6])
def test_white_noise_is_flat(kept, rng):
    sigma, mask = 1.7, rng.random((40, 44)) < kept
    maps = np.where(mask, sigma * rng.standard_normal((48, 40, 44)), np.nan)
    found = cylindrical_power(maps, CELL, mask=mask)
    ratio = found.power / (sigma**2 * np.prod(CELL))
    assert np.nanstd((ratio - 1) * np.sqrt(found.n_modes)) == pytest.approx(1, abs=0.25)
    spread = np.sqrt(1 / (kept * found.n_modes.sum()))  # a mask leaves fewer independent numbers
    assert np.average(ratio, weights=found.n_modes) == pytest.approx(1, abs=4 * spread)


@pytest.mark.parametrize("n_channels", [6, 7])
def test_as_a_slow_sum(n_channels, rng):
    """Every mode by a sum over all cells, with gaps and channel means, with and without a Nyquist k_par."""
    shape, cell = (n_channels, 8, 7), np.array([1.5, 2.0, 1.0])
    steps = 3 * np.arange(n_channels)[:, None, None]
    maps, mask = rng.standard_normal(shape) + steps, rng.random(shape[1:]) > 0.2
    found = cylindrical_power(maps, cell, mask=mask)
    seen = np.where(mask, maps - maps[:, mask].mean(axis=1)[:, None, None], 0)
    total, count = np.zeros(found.power.shape), np.zeros(found.power.shape, dtype=int)
    for numbers in np.ndindex(3, 8, 7):
        n, m, q = np.array(numbers) - (-1, 4, 3)
        k = 2 * np.pi * np.array([n, m, q]) / shape
        mode = (seen * np.exp(-1j * np.tensordot(k, np.indices(shape), 1))).sum()
        row, column = place_of(found, np.hypot(*(k / cell)[1:]), (k / cell)[0])
        if (m or q) and column < len(found.k_perp):
            total[row, column] += abs(mode) ** 2 * np.prod(cell) / (seen.size * mask.mean())
            count[row, column] += 1
    assert np.array_equal(count, found.n_modes)
    expected = total[count > 0] / count[count > 0]
    assert found.power[count > 0] == pytest.approx(expected, rel=1e-10)
    single = cylindrical_power(maps.astype("f4"), cell, mask=mask)
    assert single.power[count > 0] == pytest.approx(expected, rel=1e-4)
