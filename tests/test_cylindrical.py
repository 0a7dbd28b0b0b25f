"""P(k_perp, k_par) against a slow sum over cells."""

import numpy as np
import pytest

from himap.measures.cylindrical import cylindrical_power


def place_of(found, k_perp, k_par):
    return tuple(
        np.searchsorted(edges, k) - 1 for edges, k in ((found.par_edges, k_par), (found.perp_edges, k_perp))
    )


@pytest.mark.parametrize("with_gaps", [True, False])
@pytest.mark.parametrize("n_channels", [6, 7])
def test_as_a_slow_sum(n_channels, with_gaps, rng):
    """Every mode by a sum over all cells, less channel means, with and without a Nyquist k_par."""
    shape, cell = (n_channels, 8, 7), np.array([1.5, 2.0, 1.0])
    mask = rng.random(shape[1:]) > 0.2 if with_gaps else np.ones(shape[1:], dtype=bool)
    maps = np.where(mask, rng.standard_normal(shape) + 3 * np.arange(n_channels)[:, None, None], np.nan)
    given = {"mask": mask} if with_gaps else {}
    found = cylindrical_power(maps, cell, **given)
    seen = np.where(mask, maps - maps[:, mask].mean(axis=1)[:, None, None], 0)
    total, share = np.zeros((2, *found.power.shape))
    count = np.zeros(found.power.shape, dtype=int)
    for numbers in np.ndindex(3, 8, 7):
        n, m, q = np.array(numbers) - (-1, 4, 3)
        k = 2 * np.pi * np.array([n, m, q]) / shape
        mode = (seen * np.exp(-1j * np.tensordot(k, np.indices(shape), 1))).sum()
        row, column = place_of(found, np.hypot(*(k / cell)[1:]), (k / cell)[0])
        if (m or q) and column < len(found.k_perp):
            total[row, column] += abs(mode) ** 2 * np.prod(cell) / (seen.size * mask.mean())
            count[row, column] += 1
            window = (mask * np.exp(-1j * np.tensordot(k[1:], np.indices(shape[1:]), 1))).sum()
            share[row, column] += 1 - abs(window / mask.sum()) ** 2  # what the means leave of white noise
    assert np.array_equal(count, found.n_modes)
    along, across = 2 * np.pi / (n_channels * cell[0]), np.pi / cell[1] / 4  # few: in steps, to Nyquist in y
    assert found.par_edges == pytest.approx(along * (np.arange(4) + 0.5))
    assert found.k_par == pytest.approx(along * np.arange(1, 4))
    assert found.perp_edges == pytest.approx(across * (np.arange(5) + 0.5))
    expected = total[count > 0] / share[count > 0]
    assert found.power[count > 0] == pytest.approx(expected, rel=1e-10)
    single = cylindrical_power(maps.astype("f4"), cell, **given)
    assert single.power[count > 0] == pytest.approx(expected, rel=1e-4)


def test_white_noise_with_a_mask_is_white(rng):
    """Though the mean of every channel, which is subtracted, has much of what varies as widely as it."""
    mask, cell = np.zeros((24, 24), dtype=bool), (1.0, 1.0, 1.0)
    mask[:12, :16] = True
    powers = [cylindrical_power(rng.standard_normal((64, 24, 24)), cell, mask=mask).power for _ in range(40)]
    assert np.nanmean(powers, axis=(0, 1)) == pytest.approx(1, abs=0.05)
