"""Foreground residual and signal loss, each by itself, and spectra divided by the loss that is expected."""

import numpy as np
import pytest
from skies import spectrum

from himap.core.survey import Survey
from himap.instrument.beams import Oscillating
from himap.maps import sphere
from himap.maps.low_rank import centred
from himap.measures.diagnostics import flagged_lines
from himap.measures.transfer import TransferFunction
from himap.paper import cleaned, pipeline
from himap.paper.leakage import corrected, decompose, error_parts, expected_loss, ratios, split_error
from himap.paper.mocks import own_recovery
from himap.removal import PCA, BeamSubspace, SDecGMCA, SmoothSpectra

pytestmark = pytest.mark.filterwarnings("ignore::himap.removal.base.SeparationWarning")

CASE = pipeline.Case(survey=Survey.preset("ci", nside=8, n_channels=24, box_cells=16), beam=Oscillating())
PLAIN, AWARE = PCA(n_sources=3), BeamSubspace(n_sources=3)
FILTER = SmoothSpectra(n_sources=3, n_smooth=5)
SHORT = {"n_warmup": 4, "n_refinement": 2, "n_sources": 3}
ENDING = SDecGMCA(reading="letter", lmax=10, **SHORT)
LOW = slice(2, 11)
PARTS = "foreground residual", "signal loss"


@pytest.mark.parametrize("remover", [PLAIN, AWARE, SDecGMCA(beyond="projection", **SHORT), FILTER])
def test_the_parts_are_the_error(remover):
    left, lost = split_error(CASE, remover)
    residual, truth = centred(cleaned.residual(CASE, remover)), centred(pipeline.truth(CASE))
    rounding = 3e-7 * np.abs(pipeline.observation(CASE).maps).max()  # of cubes in float32
    assert np.allclose((left + -lost).cube(), residual - truth, atol=rounding)
    assert lost.cube().std() > 0.05 * truth.std()


def test_what_pca_loses_lies_in_its_space():
    left, lost = (part.cube() for part in split_error(CASE, PLAIN))
    basis = np.linalg.qr(cleaned.separation(CASE, PLAIN).mixing)[0]
    assert np.allclose(basis @ (basis.T @ lost), lost, atol=1e-6)
    assert (basis.T @ left).std() < 0.02 * left.std()  # but for rounding of float32


def test_a_method_that_ends_is_compared_with_a_truth_that_ends_there():
    assert cleaned.separation(CASE, ENDING).lmax == 10
    for part in split_error(CASE, ENDING):
        power = spectrum(part.cube()).mean(axis=0)
        assert power[12:].max() < 0.02 * power[LOW].mean()
    assert all(len(power.angular) == 11 for power in decompose(CASE, ENDING).values())


@pytest.mark.parametrize("remover", [PLAIN, AWARE, FILTER, ENDING])
def test_powers_are_those_of_what_comes_back(remover):
    """Powers of all and in common against `own_recovery`, which knows of no parts."""
    found, expected = decompose(CASE, remover), own_recovery(CASE, remover)
    pairs = {"truth": expected.input, "recovered": expected.output, "shared": expected.cross}
    for part, power in pairs.items():
        assert found[part].angular == pytest.approx(power.angular, rel=1e-5)


def test_a_filter_takes_of_hi_what_it_takes_of_the_maps():
    """T - P (T - D) of every coefficient, D being the peaks that were masked."""
    linear, truth = cleaned.separation(CASE, FILTER).filter, pipeline.truth(CASE)
    peaks = pipeline.observation(CASE).maps - pipeline.peak_masked(CASE).maps
    put_in, seen = (sphere.analyse(centred(cube)) for cube in (truth, truth - peaks))
    operators = linear.spectra @ linear.estimators
    degrees = sphere.alm_degree(CASE.survey.lmax)
    lost = np.array([np.einsum("ac,ca->a", operators[degrees, row], seen) for row in range(len(seen))])
    powers = [sphere.power_spectrum(alms).mean(axis=0)[LOW] for alms in (put_in, put_in - lost)]
    kept = ratios(decompose(CASE, FILTER), "angular")["kept"]
    assert kept[LOW] == pytest.approx(powers[1] / powers[0], rel=0.01)


def test_powers_of_a_projection_are_those_of_its_cubes():
    left, lost = (part.cube() for part in split_error(CASE, AWARE))
    truth = centred(pipeline.truth(CASE))
    power, over = spectrum(truth).mean(axis=0), ratios(decompose(CASE, AWARE), "angular")
    for name, cube in (("left", left), ("kept", truth - lost)):
        assert over[name][LOW] == pytest.approx((spectrum(cube).mean(axis=0) / power)[LOW], rel=0.02)


def test_corrected_is_divided_by_what_is_expected():
    share = TransferFunction(mocks=(expected_loss(CASE, FILTER),))
    parts, found = decompose(CASE, FILTER), corrected(CASE, FILTER)
    for kind in ("angular", "frequency"):
        assert found[kind] * getattr(share, kind) == pytest.approx(ratios(parts, kind)["recovered"])
    assert share.angular.max() < 1


def test_mean_squares_of_the_parts_are_of_the_flagged_lines_of_the_others_and_of_all():
    found, parts = error_parts(CASE, AWARE), dict(zip(PARTS, split_error(CASE, AWARE), strict=True))
    lines = flagged_lines(cleaned.assessment(CASE, AWARE).line_errors)
    assert 0 < lines.sum() < len(lines) / 2
    cubes = {name: part.cube().astype(float) for name, part in parts.items()}
    cubes["error"] = cubes[PARTS[0]] - cubes[PARTS[1]]
    for name, cube in cubes.items():
        for place, pixels in (("flagged", lines), ("others", ~lines), ("all", slice(None))):
            expected = np.mean(cube[:, pixels] ** 2, axis=1)
            assert found[name][place] == pytest.approx(expected, rel=1e-3), (name, place)
