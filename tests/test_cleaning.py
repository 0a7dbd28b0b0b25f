"""Data and cleanings: what is computed once and in blocks, and what one with something changed is worth."""

from dataclasses import replace

import numpy as np
import pytest
from sparse_problem import BEAMS, NSIDE, make_problem

from himap.maps import low_rank, sphere
from himap.removal import PCA, BeamSubspace, FastICA, Parametric, Polynomial, SDecGMCA, analysis
from himap.removal.cleaning import Cleaning
from himap.removal.data import Data
from himap.removal.peaks import SPREADS, mask_peaks, smooth_baselines

FREQS = np.linspace(900, 1400, 8)
SDECGMCA = SDecGMCA(n_sources=2, thresholds="analytic", n_warmup=2, n_refinement=1)
KEPT = np.abs(sphere.pixel_latitude(NSIDE)) > 15


@pytest.fixture
def maps(rng):
    sky = make_problem(rng)[0]
    return (sky + 0.1 * rng.standard_normal(sky.shape)).astype(np.float32)


@pytest.fixture
def data(maps):
    return Data.of(maps, freqs=FREQS, beams=BEAMS, noise=0.1, rng=np.random.default_rng(1))


@pytest.fixture
def mock(maps, rng):
    return (0.1 * rng.standard_normal(maps.shape)).astype(np.float32)


@pytest.fixture
def spiked(maps):
    """`Data` of 64 channels, enough for peaks to stand out, of which 30 lines of sight have one."""
    many = np.repeat(maps, 8, axis=0)[:, :100]
    many[20, :30] += 1e3
    return Data.of(many, freqs=np.linspace(900, 1400, 64))


class TestData:
    def test_draws_the_same_numbers_each_time(self, data):
        assert np.array_equal(data.rng.standard_normal(4), data.rng.standard_normal(4))
        assert np.array_equal(*(FastICA().separate(data).sources for _ in range(2)))

    def test_what_is_computed_of_the_maps_is_shared_until_they_change(self, data, mock, monkeypatch):
        other = replace(data, beams=BEAMS**2, noise=None)
        modes, means = data.modes, other.means
        monkeypatch.setattr(analysis, "cube_modes", None)
        assert other.modes is modes and data.means is means
        assert data.with_mock(mock).means == pytest.approx(means + mock.mean(axis=1), rel=1e-5)
        with pytest.raises(TypeError):
            _ = data.with_mock(mock).modes

    @pytest.mark.parametrize("mask", [None, KEPT], ids=["sphere", "mask"])
    def test_projections_make_no_copy_of_the_maps(self, maps, mask, rng):
        """Of the maps less their means; of those that a mask keeps, continued to the sphere, as they are."""
        data, rows = Data.of(maps + 7, freqs=FREQS, mask=mask), rng.standard_normal((3, len(FREQS)))
        found = data.project(rows)
        assert "centred" not in data.known
        assert found == pytest.approx(rows @ data.centred.astype(float), abs=1e-12)
        full = data.on_sphere()
        assert full.project(rows) == pytest.approx(rows @ full.centred.astype(float), abs=1e-12)

    def test_a_mask_and_weights_of_nothing_are_the_same(self, maps):
        masked = Data.of(maps, freqs=FREQS, mask=KEPT)
        weighted = Data.of(np.where(KEPT, maps, np.nan), freqs=FREQS, weights=3.0 * KEPT)
        assert np.array_equal(masked.maps, weighted.maps) and np.array_equal(masked.grid, weighted.grid)
        assert weighted.weights is None and masked.missing is None

    def test_missing_voxels_stay_missing_with_a_mock(self, maps, mock, rng):
        flags = rng.random(maps.shape) < 0.1
        data = Data.of(np.where(flags, np.nan, maps), freqs=FREQS, weights=~flags)
        both = data.with_mock(mock)
        assert not both.maps[flags].any() and np.array_equal(both.missing, flags)
        assert np.array_equal(both.maps[~flags], (maps + mock)[~flags])


class TestCleaning:
    def test_with_a_mock_is_the_sum_cleaned_without_the_peaks_of_both(self, spiked):
        mock = np.zeros_like(spiked.maps)
        mock[40, 50:60] = 1e3
        changed, both = Cleaning.of(spiked, PCA(n_sources=2)).with_mock(mock), spiked.maps + mock
        masked = mask_peaks(both, spiked.freqs)
        assert masked.flagged[20, :30].all() and masked.flagged[40, 50:60].all()
        expected = PCA(n_sources=2).clean(both, freqs=spiked.freqs, separate_on=masked.maps).residual
        assert np.array_equal(changed.residual, expected)

    def test_a_member_of_a_bootstrap_is_the_foreground_found_with_a_mock(self, spiked, rng):
        """Cleaned anew, peaks masked anew."""
        cleaned, mock = Cleaning.of(spiked, PCA(n_sources=2)), rng.standard_normal(spiked.maps.shape)
        mock[40, 50:60] = 1e3
        found = cleaned.resampled(mock)
        own = cleaned.separation
        expected = own.foreground.cube() + own.means[:, None] + mock
        assert found.data.maps == pytest.approx(expected, rel=1e-5, abs=1e-6)
        assert np.array_equal(found.basis.maps, mask_peaks(found.data.maps, spiked.freqs).maps)
        assert found.flagged > 0
        other = cleaned.with_sources(1).separation
        expected = other.foreground.cube() + other.means[:, None] + mock
        assert cleaned.resampled(mock, other).data.maps == pytest.approx(expected, rel=1e-5, abs=1e-6)

    def test_the_modes_of_a_member_follow_from_those_of_its_mock(self, rng):
        """With its peaks and without: those of a transform of its maps, to a small share of the mock's."""
        freqs, cl = np.linspace(900, 1400, 64), 1e6 / (1 + np.arange(2 * NSIDE)) ** 3.0
        sources = np.array([sphere.synthesise(sphere.gaussian_alm(cl, rng), NSIDE) for _ in range(2)])
        bright = (freqs / 1000)[:, None] ** np.array([-2.1, -2.8]) @ sources
        mock = rng.standard_normal(bright.shape)
        data = Data.of((bright + rng.standard_normal(bright.shape)).astype(np.float32), freqs=freqs)
        cleaning = Cleaning.of(data, PCA(n_sources=2))
        mock[40, 50:60] = 40
        alms = sphere.analyse(mock - mock.mean(axis=1, keepdims=True), n_iter=sphere.N_ITER_FLAT)
        found, expected = cleaning.resampled(mock, None, alms), cleaning.resampled(mock)
        low, level = slice((2 * NSIDE + 1) ** 2), np.sqrt(4 * np.pi / bright.shape[1])
        for one, other in ((found.data, expected.data), (found.basis, expected.basis)):
            wrong = np.array(one.modes)[:, low] - np.array(other.modes)[:, low]
            assert np.sqrt(np.mean(wrong**2, axis=1)).max() < 0.03 * level
        peaks = np.array(found.data.modes)[40, low] - np.array(found.basis.modes)[40, low]
        assert np.sqrt(np.mean(peaks**2)) > level

    def test_with_other_settings(self, data, maps, mock):
        cleaning, given = Cleaning.of(data, PCA(n_sources=2), peaks=False), {"freqs": FREQS}
        fewer = cleaning.with_sources(1).residual
        assert np.array_equal(fewer, PCA(n_sources=1).clean(maps, **given).residual)
        assert cleaning.with_mock(mock).basis.noise == pytest.approx(0.1 * np.sqrt(2))

    @pytest.mark.parametrize("method", [BeamSubspace(n_sources=2), SDECGMCA])
    def test_with_other_beams_or_noise_nothing_is_kept_of_the_first(self, data, method):
        """But the modes of the maps; SDecGMCA has an A to be found, which depends on both."""
        cleaning = Cleaning.of(data, method, peaks=False)
        first = cleaning.separation.mixing
        expected = method.separate(replace(data, beams=BEAMS**1.1, known={})).mixing
        assert np.array_equal(cleaning.with_beams(BEAMS**1.1).separation.mixing, expected)
        noisier = method.separate(replace(data, noise=2.0)).mixing
        assert np.array_equal(noisier, method.separate(replace(data, noise=2.0, known={})).mixing)
        assert not np.array_equal(first, expected)
        assert np.array_equal(first, noisier) == (method is not SDECGMCA)

    @pytest.mark.parametrize("peaks", [True, False])
    def test_changes_add_up_in_any_order(self, data, mock, peaks):
        """Assumed beams and another Generator stay with other maps, and peaks as they are, masked or not."""
        beams, rng, cleaning = BEAMS**1.1, np.random.default_rng(2), Cleaning.of(data, PCA(), peaks=peaks)
        method = BeamSubspace(n_sources=2)
        first = cleaning.with_beams(beams).with_method(method, rng=rng).with_mock(mock).on(KEPT)
        last = cleaning.on(KEPT).with_mock(mock[:, KEPT]).with_method(method, rng=rng).with_beams(beams)
        assert np.array_equal(first.basis.beams, beams) and first.basis.seed is rng
        assert all((one.basis.maps is one.data.maps) != peaks for one in (first, last))
        assert first.residual == pytest.approx(last.residual, abs=1e-5)

    @pytest.mark.parametrize("spread", SPREADS)
    def test_peaks_are_masked_again_in_the_same_deviation(self, spiked, spread):
        masked = replace(spiked, maps=mask_peaks(spiked.maps, spiked.freqs, spread=spread).maps)
        cleaning = Cleaning(data=spiked, method=PCA(), basis=masked, spread=spread)
        again = cleaning.with_mock(np.zeros_like(spiked.maps))
        assert np.array_equal(again.basis.maps, masked.maps)

    @pytest.mark.parametrize("method", [PCA(n_sources=2), BeamSubspace(n_sources=2)])
    def test_on_a_mask(self, data, maps, method):
        changed = Cleaning.of(data, method, peaks=False).on(KEPT)
        expected = method.clean(maps, freqs=FREQS, beams=BEAMS, mask=KEPT).residual[:, KEPT]
        assert changed.residual == pytest.approx(expected, abs=1e-5)

    def test_on_a_mask_peaks_stay_masked(self, spiked):
        kept = np.arange(100) % 2 == 0
        masked, cleaning = mask_peaks(spiked.maps, spiked.freqs), Cleaning.of(spiked, PCA())
        expected = PCA().clean(spiked.maps, freqs=spiked.freqs, separate_on=masked.maps, mask=kept)
        assert np.array_equal(cleaning.on(kept).residual, expected.residual[:, kept])
        assert cleaning.flagged == masked.flagged.mean() > 0


def test_what_one_block_raises_is_raised(monkeypatch):
    monkeypatch.setattr(sphere, "n_threads", lambda: 3)

    def work(block):
        if block.start == 4:
            raise ZeroDivisionError("of the second block")

    with pytest.raises(ZeroDivisionError, match="second block"):
        low_rank.in_threads(work, 10, "", 4)


@pytest.mark.parametrize("step", ["peaks", "polynomial", "parametric", "projection"])
def test_threads_change_nothing(step, rng, monkeypatch):
    freqs = np.linspace(900, 1050, 24)
    sky = 1e3 * rng.lognormal(0, 1, 12 * 32**2)  # three blocks of the peak masking
    maps = (sky * (freqs[:, None] / 1000) ** -2.7).astype(np.float32)
    maps[10, ::7] += 500

    def found():
        match step:
            case "peaks":
                baselines = smooth_baselines(maps, freqs, order=3, n_sigma=4)
                return baselines.first, baselines.second, baselines.flagged
            case "projection":
                return (low_rank.projection(np.vander(freqs / 1000, 3).T, maps),)
            case _:
                method = Polynomial(order=3) if step == "polynomial" else Parametric()
                return (method.separate(Data.of(maps, freqs=freqs)).sources,)

    monkeypatch.setattr(sphere, "n_threads", lambda: 1)
    alone = found()
    monkeypatch.setattr(sphere, "n_threads", lambda: 3)
    monkeypatch.setattr(low_rank, "_BLOCK", 5000)
    assert all(map(np.array_equal, found(), alone))
