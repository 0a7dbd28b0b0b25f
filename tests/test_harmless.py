"""Foreground left and HI lost, each by itself, as products; and spectra divided by what is foreseen."""

import numpy as np
import pytest

from himap.instrument.beams import Oscillating
from himap.maps import sphere
from himap.measures.transfer import TransferFunction
from himap.paper import cleaned, pipeline
from himap.paper.harmless import corrected, foreseen, parts
from himap.paper.losses import error_parts
from himap.paper.mocks import own_recovery
from himap.removal import PCA, BeamSubspace, SDecGMCA, SmoothSpectra
from himap.survey import Survey

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
        (found.truth, expected.put_in),
        (found.recovered, expected.came_back),
        (found.shared, expected.common),
    ):
        assert one.angular[LOW] == pytest.approx(two.angular[LOW], rel=0.02)


@pytest.mark.filterwarnings("ignore::himap.removal.base.SeparationWarning")
def test_of_a_filter_too_the_parts_are_the_error():
    """T - P T + F - P F is what is left, and P T is small."""
    found = cleaned.separation(CASE, NEW)
    ratios = parts(CASE, NEW).ratios("angular")
    truth = pipeline.truth_alms(CASE)
    left = np.array([alm for alm in _kept(found, truth)])
    expected = sphere.power_spectrum(left).mean(axis=0) / sphere.power_spectrum(truth).mean(axis=0).clip(
        1e-30
    )
    masked = np.abs(pipeline.observation(CASE).maps - pipeline.peak_masked(CASE).maps).max()
    assert ratios["kept"][LOW] == pytest.approx(expected[LOW], abs=0.02 if masked == 0 else 0.1)
    assert (ratios["kept"][LOW] < 1).all()
    assert set(ratios) == {"recovered", "kept", "left", "shared"}


def _kept(found, alms):
    """(1 - W_l G_l) of every coefficient."""
    degrees = sphere.alm_degree(sphere.lmax_of_size(alms.shape[-1]))
    operators = np.eye(len(alms)) - found.filter.spectra @ found.filter.estimators
    for channel in range(len(alms)):
        yield np.einsum("ac,ca->a", operators[degrees, channel], alms)


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
    share = TransferFunction(recoveries=(foreseen(CASE, NEW),))
    ratios = parts(CASE, NEW)
    found = corrected(CASE, NEW)
    for kind in ("angular", "frequency"):
        expected = ratios.ratios(kind)["recovered"]
        assert found[kind] * getattr(share, kind) == pytest.approx(expected)
    assert share.angular.max() < 1
