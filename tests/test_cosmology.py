"""Distances, growth and P(k) against astropy and CAMB."""

import astropy.cosmology
import camb
import numpy as np
import pytest

from himap.sky.cosmology import FREQ_21CM, Cosmology, HIModel, redshift

Z = np.array([0.0, 0.1, 0.3, 0.58, 1.0])


def test_redshift():
    assert redshift(FREQ_21CM) == 0
    assert redshift(900) == pytest.approx(0.5782, abs=1e-4)


def test_distance_and_expansion_against_astropy():
    ours = Cosmology()
    theirs = astropy.cosmology.FlatLambdaCDM(H0=67, Om0=0.3, Tcmb0=0)
    assert ours.comoving_distance(Z) == pytest.approx(theirs.comoving_distance(Z).value * 0.67, rel=1e-7)
    assert ours.expansion(Z) == pytest.approx(theirs.efunc(Z), rel=1e-10)
    assert ours.redshift_at(ours.comoving_distance(Z)) == pytest.approx(Z, abs=1e-8)


@pytest.fixture(scope="module")
def camb_results():
    params = camb.set_params(H0=67, ombh2=0.049 * 0.67**2, omch2=0.251 * 0.67**2, mnu=0, ns=0.96, As=2e-9)
    params.set_matter_power(redshifts=list(Z), kmax=5.0)
    return camb.get_results(params)


def test_growth_against_camb(camb_results):
    ours = Cosmology()
    sigma_8 = camb_results.get_sigma8()[::-1]  # CAMB goes from high to low redshift
    assert ours.growth(Z) == pytest.approx(sigma_8 / sigma_8[0], rel=2e-3)
    rate = camb_results.get_fsigma8()[::-1] / sigma_8
    assert ours.growth_rate(Z) == pytest.approx(rate, rel=5e-3)


def test_sigma_8_of_the_power_spectrum():
    k = np.geomspace(1e-4, 40, 20000)
    x = 8 * k
    window = 3 * (np.sin(x) - x * np.cos(x)) / x**3
    variance = np.trapezoid(k**3 * Cosmology().linear_power(k) * window**2, np.log(k)) / (2 * np.pi**2)
    assert np.sqrt(variance) == pytest.approx(0.8, rel=1e-3)


def test_power_spectrum_ends():
    power = Cosmology().linear_power(np.array([0.0, 1e-7, 1e-6, 1e3]))
    assert power[0] == 0
    assert power[2] / power[1] == pytest.approx(10**0.96, rel=0.01)  # primordial slope
    assert 0 < power[3] < 1e-5


def test_hi_model_of_the_paper():
    model = HIModel()
    assert model.bias(0.0) == pytest.approx(0.9)
    assert model.omega(0.0) == pytest.approx(4e-4)
    assert model.bias(0.5) == pytest.approx(1.05)
    assert model.omega(0.5) == pytest.approx(4e-4 * 1.5**0.6)
