"""Work on a cube block by block, several blocks at a time."""

import numpy as np
import pytest

from himap.maps import low_rank, sphere
from himap.removal.data import Data
from himap.removal.parametric import Parametric
from himap.removal.peaks import smooth_baselines
from himap.removal.polynomial import Polynomial

N_PIX = 12 * 32**2  # three blocks of the peak masking


@pytest.fixture
def three_threads(monkeypatch):
    monkeypatch.setattr(sphere, "n_threads", lambda: 3)


def test_what_one_block_raises_is_raised(three_threads):
    def work(block):
        if block.start == 4:
            raise ZeroDivisionError("of the second block")

    with pytest.raises(ZeroDivisionError, match="second block"):
        low_rank.in_threads(work, 10, "", 4)


@pytest.mark.parametrize("step", ["peaks", "polynomial", "parametric", "projection"])
def test_threads_change_nothing(step, rng, monkeypatch):
    freqs = np.linspace(900, 1050, 24)
    maps = (1e3 * rng.lognormal(0, 1, N_PIX) * (freqs[:, None] / 1000) ** -2.7).astype(np.float32)
    maps[10, ::7] += 500

    def found():
        match step:
            case "peaks":
                baselines = smooth_baselines(maps, freqs, order=3, n_sigma=4)
                return baselines.first, baselines.second, baselines.flagged
            case "projection":
                return (low_rank.projection(np.vander(freqs / 1000, 3).T, maps),)
            case _:
                method = Polynomial(order=3) if step == "polynomial" else Parametric()
                return (method.separate(Data.of(maps, freqs=freqs)).sources,)

    monkeypatch.setattr(sphere, "n_threads", lambda: 1)
    alone = found()
    monkeypatch.setattr(sphere, "n_threads", lambda: 3)
    monkeypatch.setattr(low_rank, "_BLOCK", 5000)
    assert all(map(np.array_equal, found(), alone))
