"""The polynomial fit: exact on polynomials, blind to peaks, and the numbers of numpy."""

import numpy as np
import pytest

from himap.removal.polynomial import Polynomial

FREQS = np.linspace(902.5, 1397.5, 100)
U = (FREQS - 1150) / 247.5


@pytest.fixture
def sextic(rng):
    """Any polynomial of order 6 along each line of sight, around 1e3 mK."""
    return U[:, None] ** np.arange(7) @ (1e3 * rng.standard_normal((7, 48)))


def clean(maps, **options):
    return Polynomial(**options).clean(maps, freqs=FREQS)


def test_the_fit_is_that_of_numpy(sextic, rng):
    maps = sextic + rng.standard_normal(sextic.shape)
    expected = np.polynomial.polynomial.polyval(U, np.polynomial.polynomial.polyfit(U, maps, 4)).T
    residual = clean(maps, order=4).residual
    assert residual == pytest.approx(maps - expected, abs=2e-3)


def test_peaks_stay_in_the_residual(sextic, rng):
    """Without the clip the fit takes a part of the peak; with it all of the peak is left."""
    signal = 0.01 * rng.standard_normal(sextic.shape)
    signal[40] += 5
    peak = clean(sextic + signal).residual[40]
    pulled = clean(sextic + signal, n_sigma=50).residual[40]
    assert peak == pytest.approx(signal[40], abs=0.03)
    assert (pulled < 0.98 * peak).all()


def test_sources_are_coefficients_of_the_mixing(sextic):
    separation = clean(sextic).separation
    assert separation.mixing.shape == (100, 7)
    assert separation.mixing.T @ separation.mixing == pytest.approx(np.eye(7), abs=1e-13)
    model = separation.mixing @ separation.sources
    assert separation.foreground.cube() == pytest.approx(model, rel=1e-7)
