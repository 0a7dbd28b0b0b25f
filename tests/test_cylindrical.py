"""P(k_perp, k_par) against closed forms and a slow sum over cells."""

import numpy as np
import pytest

from himap.measures.cylindrical import cylindrical_power

CELL = np.array([3.0, 2.0, 2.5])
SHAPE = (24, 18, 20)


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


@pytest.mark.parametrize("numbers", [(3, 2, 0), (3, 0, -2), (5, 3, 4), (12, 1, 1)])
def test_a_plane_wave_lands_in_its_bin(numbers):
    """A cos(k x) has A^2 V / 4 in each of its two modes, and the Nyquist wave A^2 V in its one."""
    k = 2 * np.pi * np.array(numbers) / SHAPE  # in cells
    maps = 0.8 * np.cos(np.tensordot(k, np.indices(SHAPE, dtype=float), 1))
    total = (found := cylindrical_power(maps, CELL)).power * found.n_modes
    place = place_of(found, np.hypot(*(k / CELL)[1:]), (k / CELL)[0])
    waves = 2 if numbers[0] == SHAPE[0] // 2 else 1  # +k_par and -k_par are one
    assert total[place] == pytest.approx(waves * 0.8**2 * np.prod(SHAPE * CELL) / 4, rel=1e-10)
    assert np.nansum(total) == pytest.approx(total[place], rel=1e-10)
    assert cylindrical_power(maps.astype("f4"), CELL).power[place] == pytest.approx(
        found.power[place], rel=1e-4
    )


def test_as_a_slow_sum(rng):
    """Every mode by a sum over all cells, with gaps and channel means."""
    shape, cell = (6, 5, 7), np.array([1.5, 2.0, 1.0])
    maps, mask = rng.standard_normal(shape) + np.arange(6)[:, None, None], rng.random(shape[1:]) > 0.2
    found = cylindrical_power(maps, cell, mask=mask)
    seen = np.where(mask, maps - maps[:, mask].mean(axis=1)[:, None, None], 0)
    total, count = np.zeros(found.power.shape), np.zeros(found.power.shape, dtype=int)
    for numbers in np.ndindex(3, 5, 7):
        n, m, q = np.array(numbers) - (-1, 2, 3)
        k = 2 * np.pi * np.array([n, m, q]) / shape
        mode = (seen * np.exp(-1j * np.tensordot(k, np.indices(shape), 1))).sum()
        row, column = place_of(found, np.hypot(*(k / cell)[1:]), (k / cell)[0])
        if (m or q) and column < len(found.k_perp):
            total[row, column] += abs(mode) ** 2 * np.prod(cell) / (seen.size * mask.mean())
            count[row, column] += 1
    assert np.array_equal(count, found.n_modes)
    assert np.allclose(found.power[count > 0], total[count > 0] / count[count > 0])
