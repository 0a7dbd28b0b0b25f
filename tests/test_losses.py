"""The error of a component method, taken apart into foreground that is left and HI that is lost."""

import numpy as np
import pytest

from himap.core.survey import Survey
from himap.instrument.beams import Oscillating
from himap.maps import sphere
from himap.maps.low_rank import centred
from himap.paper import cleaned, pipeline
from himap.paper.losses import error_parts
from himap.removal import PCA, BeamSubspace, SDecGMCA

CASE = pipeline.Case(survey=Survey.preset("ci", nside=8, n_channels=12, box_cells=16), beam=Oscillating())
SHORT = {"n_warmup": 4, "n_refinement": 2, "n_sources": 3}


@pytest.mark.parametrize(
    "remover", [PCA(n_sources=3), BeamSubspace(n_sources=3), SDecGMCA(beyond="projection", **SHORT)]
)
def test_the_parts_are_the_error(remover):
    left, lost, truth = error_parts(CASE, remover)
    residual = cleaned.residual(CASE, remover)
    assert np.array_equal(truth, centred(pipeline.observation(CASE).truth))
    rounding = 3e-7 * np.abs(pipeline.observation(CASE).maps).max()  # of cubes in float32
    assert np.allclose(left - lost, centred(residual) - truth, atol=rounding)
    assert lost.std() > 0.05 * truth.std()


def test_what_pca_loses_lies_in_its_space():
    remover = PCA(n_sources=3)
    left, lost, _ = error_parts(CASE, remover)
    basis = np.linalg.qr(cleaned.separation(CASE, remover).mixing)[0]
    assert np.allclose(basis @ (basis.T @ lost), lost, atol=1e-6)
    assert (basis.T @ left).std() < 0.02 * left.std()  # but for rounding of float32


def test_a_method_that_ends_is_compared_with_a_truth_that_ends_there():
    remover = SDecGMCA(lmax=10, **SHORT)
    assert cleaned.separation(CASE, remover).lmax == 10
    for cube in error_parts(CASE, remover):
        power = sphere.power_spectrum(sphere.analyse(cube)).mean(axis=0)
        assert power[12:].max() < 0.02 * power[2:11].mean()
