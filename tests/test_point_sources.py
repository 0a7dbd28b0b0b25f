"""Point sources against the check values of FACTS.md and against their statistics."""

import numpy as np
import pytest

from himap.maps import sphere
from himap.sky import point_sources as ps


@pytest.mark.parametrize(
    ("measured", "expected"),
    [
        (ps.mean_temperature(1.0), 127.50),
        (ps.mean_temperature(0.01), 84.47),
        (ps.poisson_spectrum(0.01), 8.192e-4),
        (ps.number_density(0.01, 1.0), 50_233),
        (ps.clustering_spectrum(100, 127.5)[[0, 10, 100]], [0, 0.1846, 0.01165]),
        (ps.flux_to_temperature() / (4 * np.pi / (12 * 256**2)), 1039),
    ],
)
def test_numbers_of_the_paper(measured, expected):
    assert measured == pytest.approx(expected, rel=1e-3)


def test_injected_sources_cover_the_whole_sphere_once(rng):
    """Cumulants of the flux in a pixel are moments of the counts, since sources in one pixel add up.

    Here 0.8 sources a pixel: assignment instead of addition would lose a third of them.
    """
    n_pix = 12 * 256**2
    omega = 4 * np.pi / n_pix
    flux = ps._injected(n_pix, rng) * omega / ps.flux_to_temperature()
    assert flux[flux > 0].min() >= 0.01 * (1 - 1e-9)
    k = [omega * ps._moment(n, 0.01, 1.0) for n in range(7)]
    variances = k[2], k[4] + 2 * k[2] ** 2, k[6] + 9 * (k[4] * k[2] + k[3] ** 2) + 6 * k[2] ** 3
    measured = flux.mean(), *(np.mean((flux - flux.mean()) ** n) for n in (2, 3))
    assert np.abs((measured - np.array(k[1:4])) / np.sqrt(np.array(variances) / n_pix)).max() < 5


def test_faint_field_has_the_spectrum_of_theory(rng):
    nside = 64
    field = np.mean(
        [sphere.power_spectrum(sphere.analyse(ps._faint_field(nside, rng))) for _ in range(4)], axis=0
    )
    degrees = np.arange(10, 129)
    expected = ps.clustering_spectrum(128, ps.mean_temperature(0.01))[degrees] + ps.poisson_spectrum(0.01)
    weight = (2 * degrees + 1) / expected
    ratio = (weight * field[degrees]).sum() / (weight * expected).sum()
    assert ratio == pytest.approx(1, abs=4 * np.sqrt(2 / (4 * (2 * degrees + 1).sum())))


def test_component(rng):
    component = ps.point_sources(32, rng)
    assert component.amplitude.min() > 0
    assert component.amplitude.mean() == pytest.approx(127.5, rel=0.02)
    assert component.index.mean() == pytest.approx(-2.7, abs=0.01)
    assert component.index.std() == pytest.approx(0.2, rel=0.03)
    ratio = component.map(1000.0) / component.amplitude
    assert np.log(ratio) / np.log(1000 / 1400) == pytest.approx(component.index)


def test_faint_and_bright_sources_have_separate_streams():
    faint, bright, _ = np.random.default_rng(1).spawn(3)
    expected = ps._faint_field(8, faint) + ps._injected(768, bright)
    assert np.array_equal(ps.point_sources(8, np.random.default_rng(1)).amplitude, expected)
