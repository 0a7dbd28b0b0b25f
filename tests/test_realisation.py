"""What one realisation asks of the chain: cases, methods, and where lines of sight are left out."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from himap.core.survey import PRESETS, Survey
from himap.instrument.beams import Degraded, Evolving, MeerKAT, Oscillating
from himap.instrument.noise import noise_sigma
from himap.measures.diagnostics import Comparison
from himap.measures.spectra import AngularPower, FrequencyPower, PowerSpectra
from himap.paper import cleaned, evidence, pipeline
from himap.paper.methods import BEAM_AWARE, BSS
from himap.paper.realisation import Realisation
from himap.removal import Polynomial, SDecGMCA
from himap.sky.galaxy import Dimming


@dataclass(frozen=True, kw_only=True)
class Other:
    """What may stand in the place of SDecGMCA."""

    name = "other"
    n_sources: int
    depth: int = 1
    restart: int = 0
    beyond: str = "nothing"

    def check(self, n_channels):
        pass


SURVEY = Survey(nside=8, n_channels=30, box_cells=16)
DIMMING = Dimming(weight=0.3)
SKY = Realisation(survey=SURVEY, dimming=DIMMING, n_sources=(2, 3))


def test_cases():
    found = {name: (case.beam, case.dimming, peaks) for name, (case, peaks) in SKY.cases.items()}
    assert found == {
        "degraded": (Degraded(), None, True),
        "evolving": (Evolving(), None, True),
        "oscillating": (Oscillating(), None, True),
        "degraded, peaks left in": (Degraded(), None, False),
        "evolving, peaks left in": (Evolving(), None, False),
        "oscillating, peaks left in": (Oscillating(), None, False),
        "oscillating, sigma of the channel": (Oscillating(), None, "channel"),
        "oscillating, sigma of the cube": (Oscillating(), None, "cube"),
        "dimmed": (Oscillating(), DIMMING, True),
    }
    assert {case.survey for case, *_ in SKY.cases.values()} == {SURVEY}


def test_another_beam_in_the_place_of_the_oscillating_one():
    cases = Realisation(survey=SURVEY, oscillating=MeerKAT()).cases
    three = ["degraded", "evolving", "meerkat"]
    assert [str(case.beam) for case, *_ in cases.values()] == [*three, *three, *["meerkat"] * 3]


@pytest.mark.parametrize("reading", ["deviation", "variance"])
def test_noise_is_that_of_the_paper_s_pixels_and_channels(reading):
    """Noise is white, C_l = sigma^2 Omega_pixel, and no beam smooths it but the degraded one."""
    sky = replace(SKY, survey=replace(SURVEY, noise_reading=reading))
    found = sky.noise_over_hi("evolving")
    noise = found.angular
    paper = replace(PRESETS["paper"], noise_reading=reading)
    expected = np.mean(noise_sigma(paper) ** 2) * 4 * np.pi / paper.n_pix
    assert np.average(noise, weights=2 * np.arange(len(noise)) + 5) == pytest.approx(expected, rel=0.05)
    expected = np.mean(noise_sigma(paper) ** 2) * paper.channel_width
    assert np.mean(found.frequency) == pytest.approx(expected, rel=0.05)


def test_choices_that_do_not_concern_sdecgmca():
    """The average is that of every comparison, the variable that of the polynomial alone."""
    sky = replace(SKY, average="middle", polynomial="logarithm")
    usual, other = SKY.calls("degraded"), sky.calls("degraded")
    assert other.pop("polynomial") == (usual.pop("polynomial")[0], Polynomial(variable="logarithm"), True)
    assert other == usual
    for one, average in ((SKY, "means"), (sky, "middle")):
        call = one.calls("degraded")["pca"]
        expected = cleaned.compared(*call, average=average)
        assert np.array_equal(one._compare(call).angular, expected.angular)
    assert not np.array_equal(expected.angular, cleaned.compared(*call).angular)


@pytest.mark.parametrize(
    ("options", "strategy", "coefficients"),
    [((), "strategy 3", "matrix"), ((("reading", "follow-up"),), "strategy 4", "spectrum")],
)
def test_settings_of_the_regularisation_and_as_many_restarts(options, strategy, coefficients):
    """All else is as it is; what agrees with another is there once."""
    sky = replace(SKY, options=options, restart=2)
    own, settings = sky.calls("oscillating")["sdecgmca"], sky._settings()
    changed = {
        "c = 0.001": {"regularisation": 1e-3},
        "c = 0.1": {"regularisation": 0.1},
        strategy: {"coefficients": coefficients},
    }
    assert own[1].regularisation == 1e-2 and settings.pop("as it is") == own
    assert settings == {name: (own[0], replace(own[1], **one), True) for name, one in changed.items()}
    expected = [(own[0], replace(own[1], restart=n), *own[2:]) for n in (2, 3, 4, 5)]
    assert sky._restarts(4) == expected
    assert {*settings.values(), *expected} <= set(sky.assessments)


def test_another_method_in_the_place_of_sdecgmca(monkeypatch):
    """It has its own options, and those alone; in the claims it goes by the name of SDecGMCA."""
    monkeypatch.setitem(BEAM_AWARE, "other", (Other, ("n_sources",)))
    sky = replace(SKY, method="other", options=(("depth", 7),), restart=3)
    for case in sky.cases:
        method = sky.calls(case)["sdecgmca"][1]
        assert (method.depth, method.restart, method.beyond) == (7, 3, "nothing")
    beyond = [call for call in sky.assessments if getattr(call[1], "beyond", "") == "regularised"]
    assert [(case, peaks) for case, _, peaks in beyond] == [
        (sky.cases[beam][0], True) for beam in ("degraded", "evolving", "oscillating")
    ]
    assert {call[1].depth for call in beyond} == {7}
    assert [method.n_sources for _, method, *_ in sky.assessments[-2:]] == [2, 3]
    assert not {SDecGMCA} & {type(method) for _, method, *_ in sky.assessments}


def test_a_method_without_those_options_has_no_settings_and_goes_on_as_it_is():
    sky = replace(SKY, method="beam_subspace")
    assert (sky._settings(), sky._restarts(0)) == ({}, [])
    for beam in ("degraded", "evolving", "oscillating"):
        assert sky._beyond(beam) == sky.calls(beam)["sdecgmca"]


def test_a_residual_that_ends_before_the_maps_is_compared_as_far_as_it_goes():
    degrees, k = np.arange(20.0), np.arange(4.0)
    power = PowerSpectra(
        angular=AngularPower(degrees=degrees, cl=np.ones((30, 20))),
        frequency=FrequencyPower(k=k, power=np.ones(4)),
    )
    ending = replace(power, angular=power.angular.upto(12))
    assert Comparison.of(ending, power, l_top=16).degrees.tolist() == list(range(2, 13))
    assert Comparison.of(power, power, l_top=16).degrees.tolist() == list(range(2, 17))


def test_variance_is_that_of_the_fractional_errors():
    """The paper's Eq. A.3, at the multipoles that are compared."""
    case, method, peaks = SKY.calls("oscillating")["pca"]
    found = cleaned.assessment(case, method, peaks).power_spectra.angular.cl[:, 2:17]
    true = pipeline.true_spectra(case).angular.cl[:, 2:17]
    assert SKY.of("oscillating")["pca"].degrees.astype(int).tolist() == list(range(2, 17))
    assert SKY.variance("pca") == pytest.approx((found / true - 1).var(axis=0), rel=1e-3)


def test_facts_are_of_the_case_and_method_that_claims_are_about():
    assert SKY.facts["flagged"] == (evidence.error_of_flagged_lines, SKY.calls("oscillating")["sdecgmca"])
    product, call = SKY.facts["no sources"]
    assert product is evidence.spectra_without_sources
    assert call == (SKY.cases["degraded"][0], SKY.calls("degraded")["parametric"][1])
    masked = [call for product, call in SKY.facts.values() if product is cleaned.post_masked]
    assert masked == [SKY.calls("oscillating")[name] for name in BSS]


def test_the_peak_without_the_brightest_lines_is_the_highest_near_the_ripple(monkeypatch):
    k = np.linspace(0, 1, 101)
    ratios = np.array([1 + n * np.exp(-(((k - 0.31) / 0.01) ** 2)) for n in range(6)])
    ratios[:, -1] = 99  # elsewhere
    monkeypatch.setattr(Realisation, "_fact", lambda self, what: (k, ratios))
    shares, values = SKY.without_brightest("pca")
    assert shares == evidence.BRIGHTEST and values == pytest.approx(1 + np.arange(6.0))
