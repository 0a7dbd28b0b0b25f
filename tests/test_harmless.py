"""Foreground left and HI lost, each by itself, as products; and spectra divided by what is foreseen."""

import numpy as np
import pytest

from himap.core.survey import Survey
from himap.instrument.beams import Oscillating
from himap.maps import sphere
from himap.maps.low_rank import centred
from himap.measures.transfer import TransferFunction
from himap.paper import cleaned, pipeline
from himap.paper.harmless import corrected, foreseen, parts
from himap.paper.losses import error_parts
from himap.paper.mocks import own_recovery
from himap.removal import PCA, BeamSubspace, SDecGMCA, SmoothSpectra

CASE = pipeline.Case(survey=Survey.preset("ci", nside=8, n_channels=24, box_cells=16), beam=Oscillating())
NEW = SmoothSpectra(n_sources=3, n_smooth=5)
SHORT = SDecGMCA(lmax=10, n_warmup=4, n_refinement=2, n_sources=3)
LOW = slice(2, 11)


@pytest.mark.parametrize("remover", [PCA(n_sources=3), BeamSubspace(n_sources=3), NEW, SHORT])
@pytest.mark.filterwarnings("ignore::himap.removal.base.SeparationWarning")
def test_they_are_those_of_what_comes_back(remover):
    """Powers of all and in common against `own_recovery`, which knows of no parts."""
    found, expected = parts(CASE, remover), own_recovery(CASE, remover)
    for one, two in (
        (found.truth, expected.input),
        (found.recovered, expected.output),
        (found.shared, expected.cross),
    ):
        assert one.angular[LOW] == pytest.approx(two.angular[LOW], rel=0.02)


@pytest.mark.filterwarnings("ignore::himap.removal.base.SeparationWarning")
def test_a_filter_takes_of_hi_what_it_takes_of_the_maps():
    """T - P (T - D) of every coefficient, D being the peaks that were masked."""
    linear, truth = cleaned.separation(CASE, NEW).filter, pipeline.truth(CASE)
    peaks = pipeline.observation(CASE).maps - pipeline.peak_masked(CASE).maps
    put_in, seen = (sphere.analyse(centred(cube)) for cube in (truth, truth - peaks))
    operators = linear.spectra @ linear.estimators
    degrees = sphere.alm_degree(CASE.survey.lmax)
    lost = np.array([np.einsum("ac,ca->a", operators[degrees, row], seen) for row in range(len(seen))])
    powers = [sphere.power_spectrum(alms).mean(axis=0)[LOW] for alms in (put_in, put_in - lost)]
    ratios = parts(CASE, NEW).ratios("angular")
    assert ratios["kept"][LOW] == pytest.approx(powers[1] / powers[0], rel=0.01)
    assert set(ratios) == {"recovered", "kept", "left", "shared"}


def test_parts_of_a_projection_are_those_of_its_cubes():
    remover = BeamSubspace(n_sources=3)
    left, lost, truth = error_parts(CASE, remover)
    ratios = parts(CASE, remover).ratios("angular")
    expected = [
        sphere.power_spectrum(sphere.analyse(cube)).mean(axis=0) for cube in (truth, left, truth - lost)
    ]
    assert ratios["left"][LOW] == pytest.approx((expected[1] / expected[0])[LOW], rel=0.02)
    assert ratios["kept"][LOW] == pytest.approx((expected[2] / expected[0])[LOW], rel=0.02)


@pytest.mark.filterwarnings("ignore::himap.removal.base.SeparationWarning")
def test_corrected_is_divided_by_what_is_foreseen():
    share = TransferFunction(mocks=(foreseen(CASE, NEW),))
    ratios = parts(CASE, NEW)
    found = corrected(CASE, NEW)
    for kind in ("angular", "frequency"):
        expected = ratios.ratios(kind)["recovered"]
        assert found[kind] * getattr(share, kind) == pytest.approx(expected)
    assert share.angular.max() < 1
