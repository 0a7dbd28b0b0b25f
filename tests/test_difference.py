"""What follows from the error of a cleaned cube, a few spectra times maps, against the cube itself."""

import numpy as np
import pytest
from cube_measures import correlation, line_errors

from himap.core.errors import InputError
from himap.maps.low_rank import LowRankCube
from himap.measures import low_rank_spectra as measures
from himap.measures.spectra import frequency_power


@pytest.fixture
def truth(rng):
    return (rng.standard_normal((6, 3000)) + 3).astype(np.float32)


@pytest.fixture
def error(rng):
    """Three terms, one of them far brighter than the truth, and channel means that no measure should see."""
    return LowRankCube(
        spectra=rng.standard_normal((6, 3)),
        maps=np.array([[0.1], [2], [40]]) * rng.standard_normal((3, 3000)) + 5,
    )


@pytest.fixture(params=[False, True])
def mask(request, rng):
    return rng.random(3000) < 0.8 if request.param else None


def recovered(truth, error):
    return truth + error.lines(slice(None))


class TestMoments:
    def test_correlation_is_that_of_numpy(self, truth, error, mask):
        kept = slice(None) if mask is None else mask
        expected = correlation(recovered(truth, error)[:, kept], truth[:, kept])
        assert measures.Moments.of(truth, error, mask=mask).correlation == pytest.approx(expected, abs=1e-9)

    def test_frequency_power_is_that_of_the_cube(self, truth, error, mask):
        true = frequency_power(truth.astype(float), 2.0, mask=mask)
        expected = frequency_power(recovered(truth, error), 2.0, mask=mask)
        found = measures.Moments.of(truth, error, mask=mask).frequency_power(true, 2.0)
        assert found.k == pytest.approx(expected.k)
        assert found.power == pytest.approx(expected.power, rel=1e-9)

    def test_what_takes_the_truth_away_leaves_nothing(self, truth):
        whole = LowRankCube(spectra=-np.eye(6), maps=truth.astype(float))
        true = frequency_power(truth.astype(float), 2.0)
        left = measures.Moments.of(truth, whole).frequency_power(true, 2.0)
        assert np.abs(left.power).max() < 1e-12 * true.power.max()
        assert np.isnan(measures.Moments.of(np.zeros_like(truth), whole).correlation).all()


def test_line_errors_are_those_of_the_cube(truth, error):
    assert measures.line_errors(error) == pytest.approx(line_errors(recovered(truth, error), truth))


class TestDifference:
    def test_of_two_cubes(self, truth, error, mask):
        found = measures.difference(recovered(truth, error), truth, mask=mask)
        assert found.spectra.shape == (6, 3)
        kept = np.ones(3000) if mask is None else mask
        assert found.lines(slice(None)) == pytest.approx(error.lines(slice(None)) * kept, abs=1e-9)

    def test_what_the_mask_leaves_out_may_be_anything(self, truth, error):
        cube, mask = recovered(truth, error), np.arange(3000) > 10
        cube[:, ~mask] = np.nan
        assert np.isfinite(measures.difference(cube, truth, mask=mask).maps).all()

    def test_cubes_that_do_not_belong_together(self, truth):
        with pytest.raises(InputError, match="one shape"):
            measures.difference(truth[:1], truth)
        with pytest.raises(InputError, match="mask"):
            measures.difference(truth, truth, mask=np.ones(7, dtype=bool))
        broken = truth.copy()
        broken[2, 5] = np.nan
        with pytest.raises(InputError, match="finite|NaN"):
            measures.difference(broken, truth)

    def test_faint_terms_are_left_out(self, truth, rng):
        size = np.sqrt(measures.FAINT * truth.var(axis=1).sum())  # channel means are no spectrum
        spectrum = np.full((6, 1), 1 / np.sqrt(6))
        for factor, n_terms in ((0.9, 0), (1.1, 1)):
            one = LowRankCube(spectra=spectrum, maps=factor * size * rng.choice([-1.0, 1.0], (1, 3000)))
            found = measures.difference(truth.astype(float) + one.lines(slice(None)), truth.astype(float))
            assert found.spectra.shape[1] == n_terms


class TestMapModes:
    def test_sum_and_difference(self, error, rng):
        other = LowRankCube(spectra=rng.standard_normal((6, 2)), maps=rng.standard_normal((2, 3000)))
        whole = error.lines(slice(None)) - other.lines(slice(None))
        assert (error + -other).lines(slice(None)) == pytest.approx(whole)
        assert error.of_channels(slice(4, 5)).lines(slice(None)) == pytest.approx(
            error.lines(slice(None))[4:5]
        )
        assert error.cube() == pytest.approx(error.lines(slice(None)), rel=1e-5, abs=1e-5)
        assert error.cube().dtype == np.float32

    def test_subtract_from_a_cube(self, truth, error):
        means = np.arange(6.0)
        expected = truth - error.lines(slice(None)) - means[:, None]
        assert error.subtract_from(truth, means) == pytest.approx(expected, abs=1e-4)

    def test_truncate(self, error, rng):
        """Orthonormal spectra, the brightest first, no channel means, and no more terms than there are."""
        twice = error + LowRankCube(spectra=error.spectra[:, :1], maps=1e-9 * rng.standard_normal((1, 3000)))
        found = twice.truncate(1e-12)
        lines = error.lines(slice(None))
        assert found.lines(slice(None)) == pytest.approx(lines - lines.mean(axis=1, keepdims=True), abs=1e-7)
        assert found.spectra.T @ found.spectra == pytest.approx(np.eye(3), abs=1e-12)
        assert (np.diff(found.maps.std(axis=1)) < 0).all()

    def test_truncate_keeps_a_faint_difference(self, rng):
        """Of two foregrounds a hundred thousand times brighter than what they differ by."""
        bright = LowRankCube(spectra=rng.standard_normal((6, 2)), maps=1e5 * rng.standard_normal((2, 3000)))
        faint = LowRankCube(spectra=rng.standard_normal((6, 1)), maps=0.1 * rng.standard_normal((1, 3000)))
        found = (bright + faint + -bright).truncate(1e-9)
        lines = faint.lines(slice(None))
        assert found.lines(slice(None)) == pytest.approx(lines - lines.mean(axis=1, keepdims=True), abs=1e-8)
