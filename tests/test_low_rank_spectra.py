"""What follows from the error of a cleaned cube, a few spectra times maps, against the cube itself."""

import re

import numpy as np
import pytest
from skies import correlation, line_errors

from himap.core.errors import InputError
from himap.maps import sphere
from himap.maps.low_rank import LowRankCube
from himap.measures import low_rank_spectra as measures
from himap.measures.low_rank_spectra import Moments, difference, masked_alms, masked_power, recovered_power
from himap.measures.spectra import TAPERS, angular_power, frequency_power

NSIDE = 32
LMAX = 3 * NSIDE - 1
CUT = np.abs(sphere.pixel_latitude(NSIDE)) > 10
SEEN = slice(1, 2 * NSIDE + 1)
"""Multipoles; beyond, the quadrature of HEALPix is poor with refinements too."""


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


@pytest.fixture(params=[False, True], ids=["all", "masked"])
def mask(request, rng):
    return rng.random(3000) < 0.8 if request.param else None


def recovered(truth, error):
    return truth + error.lines(slice(None))


class TestMoments:
    @pytest.mark.parametrize("taper", TAPERS)
    def test_as_of_the_cube(self, truth, error, mask, taper):
        kept = slice(None) if mask is None else mask
        found, cube = Moments.of(truth, error, mask=mask), recovered(truth, error)
        assert found.correlation == pytest.approx(correlation(cube[:, kept], truth[:, kept]), abs=1e-9)
        options = {"mask": mask, "taper": taper}
        true, expected = (frequency_power(one, 2.0, **options) for one in (truth.astype(float), cube))
        power = found.frequency_power(true, 2.0)
        assert power.k == pytest.approx(expected.k)
        assert power.power == pytest.approx(expected.power, rel=1e-9) and power.taper == taper

    def test_what_takes_the_truth_away_leaves_nothing(self, truth):
        minus = LowRankCube(spectra=-np.eye(6), maps=truth.astype(float))
        true = frequency_power(truth.astype(float), 2.0)
        residual = Moments.of(truth, minus).frequency_power(true, 2.0)
        assert np.abs(residual.power).max() < 1e-12 * true.power.max()
        assert np.isnan(Moments.of(np.zeros_like(truth), minus).correlation).all()


@pytest.mark.parametrize("taper", TAPERS)
@pytest.mark.parametrize("share", [0.0, 0.02, 0.6])
def test_the_frequency_power_without_some_lines(truth, error, share, rng, taper):
    """Those left out may be far brighter than the others, and no others are read but for the means."""
    removed, exact = rng.random(3000) < share, truth.astype(float)
    error.maps[:, removed] *= 1e4
    for cube, of in ((exact, ()), (recovered(exact, error), (error,))):
        expected = frequency_power(cube, 2.0, mask=~removed, taper=taper)
        total = frequency_power(truth, 2.0, taper=taper)
        if of:  # as in an assessment
            total = Moments.of(truth, error).frequency_power(total, 2.0)
        found = measures.frequency_power_without(total, removed, 2.0, truth, *of)
        assert found.k == pytest.approx(expected.k) and found.taper == taper
        assert found.power[1:] == pytest.approx(expected.power[1:], rel=1e-5)


def test_line_errors_are_those_of_the_cube(truth, error):
    assert measures.line_errors(error) == pytest.approx(line_errors(recovered(truth, error), truth))


class TestDifference:
    def test_of_two_cubes(self, truth, error, mask):
        """With a mask, what it leaves out may be anything."""
        cube, kept = recovered(truth, error), np.ones(3000, dtype=bool) if mask is None else mask
        cube[:, ~kept] = np.nan
        found = difference(cube, truth, mask=mask)
        assert found.spectra.shape == (6, 3)
        assert found.lines(slice(None)) == pytest.approx(error.lines(slice(None)) * kept, abs=1e-9)

    def test_faint_terms_are_left_out(self, truth, rng):
        size = np.sqrt(measures.FAINT * truth.var(axis=1).sum())  # channel means are no spectrum
        spectrum, truth = np.full((6, 1), 1 / np.sqrt(6)), truth.astype(float)
        for factor, n_terms in ((0.9, 0), (1.1, 1)):
            term = LowRankCube(spectra=spectrum, maps=factor * size * rng.choice([-1.0, 1.0], (1, 3000)))
            assert difference(recovered(truth, term), truth).spectra.shape[1] == n_terms


class TestLowRankCube:
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


def spectra_of(recovered, truth, *, mask=None, alms=None):
    """`recovered_power` and `masked_power` of two cubes."""
    alms, error = masked_alms(truth, mask=mask, alms=alms), difference(recovered, truth, mask=mask)
    return recovered_power(alms, error, mask=mask), masked_power(alms, mask)


@pytest.fixture(scope="module")
def pair():
    """(recovered, truth): three smooth spectra are left, and a tenth of the signal in them is lost."""
    rng, degree = np.random.default_rng(4), np.arange(LMAX + 1.0)
    red = np.where(degree <= 2 * NSIDE, 1 / (1 + degree) ** 2, 0)
    maps = [sphere.synthesise(sphere.gaussian_alm(red, rng), NSIDE) for _ in range(15)]
    truth, bright = np.array(maps[:12], dtype=np.float32), 5 * np.array(maps[12:])
    smooth = np.linspace(0.5, 1.5, 12)[:, None] ** np.arange(3)
    space = np.linalg.qr(smooth)[0]
    return (truth + smooth @ bright - 0.1 * space @ (space.T @ truth)).astype(np.float32), truth


class TestPair:
    """Both angular spectra from the coefficients of the truth, against those of the cubes."""

    @pytest.mark.parametrize("mask", [None, CUT, 0.5 + 0.5 * CUT, CUT * 0.5])
    def test_against_one_by_one(self, pair, mask):
        """And from coefficients of the unmasked truth, where little is masked, wholly or in part, or much."""
        alms = sphere.analyse(pair[1], n_iter=9)
        ways = spectra_of(*pair, mask=mask), spectra_of(*pair, mask=mask, alms=alms)
        for plain, found, maps in zip(*ways, pair, strict=True):
            expected = angular_power(maps, mask=mask)
            assert plain.degrees == pytest.approx(expected.degrees)
            assert plain.mean[1:] == pytest.approx(expected.mean[1:], rel=1e-3)
            assert plain.cl[:, 1:] == pytest.approx(expected.cl[:, 1:], rel=0.03)
            seen = slice(1, np.searchsorted(expected.degrees, 2 * NSIDE))
            assert found.degrees == pytest.approx(plain.degrees)
            assert found.mean[seen] == pytest.approx(plain.mean[seen], rel=2e-3)
            assert found.cl[:, seen] == pytest.approx(plain.cl[:, seen], rel=0.02)
            assert found.cl[:, 0] == pytest.approx(plain.cl[:, 0], abs=1e-3 * plain.cl[0, 1])

    def test_faint_differences(self, pair):
        """Terms that are minor in every channel are transformed roughly, and nobody can tell."""
        faint = (pair[1] + 0.03 * (pair[0] - pair[1])).astype(np.float32)
        found, expected = spectra_of(faint, pair[1])[0], angular_power(faint)
        assert found.cl[:, SEEN] == pytest.approx(expected.cl[:, SEEN], rel=0.03)
        assert found.mean[SEEN] == pytest.approx(expected.mean[SEEN], rel=1e-3)

    def test_a_function_does_as_the_coefficients_that_it_makes(self, pair, monkeypatch):
        alms, error = masked_alms(pair[1]), difference(*pair)
        made, true = alms.__getitem__, masked_power(alms)
        monkeypatch.setattr(measures, "_CHANNELS", 5)
        assert np.array_equal(recovered_power(made, error, true=true).cl, recovered_power(alms, error).cl)
        for options in ({}, {"true": true, "mask": CUT}):
            with pytest.raises(InputError, match="needs their spectrum, true=, and takes no mask"):
                recovered_power(made, error, **options)

    def test_coefficients_of_the_unmasked_truth_want_it_unmasked(self, pair):
        truth = np.where(CUT, pair[1], np.nan)
        spectra_of(pair[0], truth, mask=CUT)
        with pytest.raises(InputError, match="finite|NaN"):
            masked_alms(truth, mask=CUT, alms=np.zeros((12, 1)))

    @pytest.mark.parametrize(
        "shape", [(12, 1), (12, sphere.alm_size(9)), (11, sphere.alm_size(LMAX)), (sphere.alm_size(LMAX),)]
    )
    def test_coefficients_of_another_shape(self, pair, shape):
        expected = re.escape(f"= (12, {sphere.alm_size(LMAX)}), got {shape}; analyse")
        alms = np.zeros(shape, dtype=np.complex64)
        with pytest.raises(InputError, match=expected):
            masked_alms(pair[1], alms=alms)
        with pytest.raises(InputError, match=expected):
            recovered_power(alms, difference(*pair), mask=CUT)
        if len(shape) == 2 and len(alms) == 12:
            with pytest.raises(InputError, match=re.escape(f"got {shape}; analyse")):
                masked_power(alms, CUT)

    def test_a_small_mask_and_a_mean_leave_it_as_close(self, pair):
        """Whether a term is minor is judged on what the mask leaves, and without the means of channels."""
        mask = np.abs(sphere.pixel_latitude(NSIDE)) > 80
        faint = pair[1] + 0.1 * (pair[0] - pair[1])
        found, _ = spectra_of(faint + 100, pair[1] + 100, mask=mask)
        expected = angular_power(faint + 100, mask=mask)
        inside = (expected.degrees > 10) & (expected.degrees < 2 * NSIDE)
        assert found.mean[inside] == pytest.approx(expected.mean[inside], rel=5e-3)
