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


class TestLogarithm:
    """log T as a polynomial of log nu."""

    @pytest.fixture
    def laws(self, rng):
        """Power laws with a running of the index, around 1e4 mK."""
        x, (index, running) = np.log(FREQS / 1150)[:, None], rng.standard_normal((2, 48))
        return 1e4 * np.exp(rng.standard_normal(48) + (index - 2.7) * x + running * x**2)

    def test_power_laws_are_exact(self, laws):
        """In all channels, in few of them, and in a wide band at low frequencies."""
        low = np.linspace(50, 250, 64)
        wide = 1e5 * (low[:, None] / 100) ** np.array([-2.7, -2.4])
        for maps, freqs, close in ((laws, FREQS, 1e-6), (laws[:20], FREQS[:20], 1e-6), (wide, low, 1e-4)):
            found = Polynomial(variable="logarithm", order=2).clean(maps, freqs=freqs)
            assert found.residual == pytest.approx(0 * maps, abs=close)
        assert np.abs(clean(laws, order=2).residual).max() > 1

    def test_the_fit_is_that_of_numpy(self, laws, rng):
        maps, x = laws * (1 + 0.01 * rng.standard_normal(laws.shape)), np.log(FREQS)
        fit = np.polynomial.Polynomial.fit
        logs = np.array([fit(x, line, 3)(x) for line in np.log(maps).T]).T
        residual = clean(maps, order=3, variable="logarithm").residual
        assert residual == pytest.approx(maps - np.exp(logs), rel=1e-4, abs=0.05)

    @pytest.mark.parametrize("missing", [slice(10, 15), slice(80, None)], ids=["within", "at the end"])
    def test_missing_voxels_change_nothing_else(self, laws, rng, missing):
        """Where a fit goes on beyond what is seen it may be steep; the channels that are seen are exact."""
        weights, maps = np.ones(laws.shape), laws + 10 * rng.standard_normal(laws.shape)
        weights[missing, ::2] = 0
        kept, gaps = weights[:, 0] > 0, np.where(weights > 0, maps, -5.0)
        method = Polynomial(order=6, variable="logarithm")
        residual = method.clean(gaps, freqs=FREQS, weights=weights).residual
        assert np.isfinite(residual).all()
        logs = np.log(maps[kept][:, ::2])
        x = np.log(FREQS[kept])
        expected = [np.polynomial.Polynomial.fit(x, line, 6)(x) for line in logs.T]
        seen = maps[kept][:, ::2] - np.exp(np.array(expected).T)
        assert residual[kept][:, ::2] == pytest.approx(seen, abs=0.5)
