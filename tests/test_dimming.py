"""The dimmed Galactic plane."""

import numpy as np
import pytest

from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.maps import sphere
from himap.paper import cleaned, pipeline
from himap.removal.pca import PCA
from himap.sky.galaxy import Dimming

SMALL = Survey(nside=16, n_channels=20, box_cells=32)


def test_weight_goes_from_the_plane_to_the_edge_and_stays():
    nside = 64
    latitude = np.abs(sphere.pixel_latitude(nside))
    weights = Dimming().weights(nside)
    assert weights[latitude.argmin()] == pytest.approx(0.1, abs=1e-3)
    assert (weights[latitude >= 15] == 1).all()
    order = np.argsort(latitude)
    assert (np.diff(weights[order]) >= 0).all()


def test_weight_is_a_gaussian_of_a_third_of_the_edge():
    """Far from the edge, where the small step that closes the gap to 1 does not matter."""
    nside = 64
    latitude = sphere.pixel_latitude(nside)
    weights = Dimming(weight=0.0, edge=30.0).weights(nside)
    inside = np.abs(latitude) < 15
    assert weights[inside] == pytest.approx(1 - np.exp(-(latitude[inside] ** 2) / 200), abs=0.012)


def test_no_dimming_is_a_weight_of_one():
    assert (Dimming(weight=1.0).weights(16) == 1).all()


def test_only_foregrounds_are_dimmed():
    full, dimmed = (
        pipeline.Case(survey=SMALL, dimming=one) for one in (None, Dimming(weight=0.0, edge=90.0))
    )
    seen, fainter = pipeline.observation(full), pipeline.observation(dimmed)
    assert np.array_equal(seen.truth, fainter.truth)
    near = np.abs(sphere.pixel_latitude(16)) < 5
    assert fainter.maps[:, near].mean() < 0.2 * seen.maps[:, near].mean()


def test_a_dimmed_case_is_a_product_of_its_own():
    case = pipeline.Case(survey=SMALL, dimming=Dimming())
    one, two = (cleaned.residual(c, PCA(n_sources=2)) for c in (case, pipeline.Case(survey=SMALL)))
    assert not np.array_equal(one, two)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"weight": 1.1}, "at most 1"),
        ({"weight": -0.1}, "at least 0"),
        ({"edge": 0}, "above 0"),
        ({"edge": 91}, "90"),
    ],
)
def test_bad_values(options, message):
    with pytest.raises(InputError, match=message):
        Dimming(**options)


def test_a_case_takes_a_dimming_and_nothing_else():
    with pytest.raises(InputError, match="dimming must be a Dimming or None, got 0.1"):
        pipeline.Case(survey=SMALL, dimming=0.1)
