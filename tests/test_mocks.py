"""Mocks in an observation: what they are, and what is said of a method whose loss is known."""

from dataclasses import replace

import numpy as np
import pytest

from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.instrument.beams import Oscillating
from himap.instrument.noise import noise_sigma
from himap.maps import sphere
from himap.measures.transfer import expected_power
from himap.paper import cleaned, pipeline
from himap.paper.mocks import (
    Mock,
    bootstrap,
    first_mocks,
    foreground_left,
    foreground_like,
    mock_alms,
    own_recovery,
    recovered,
    resampled,
)
from himap.removal import PCA, BeamSubspace, SDecGMCA, harmonic
from himap.removal.data import Data
from himap.removal.peaks import mask_peaks
from himap.removal.smooth_posterior import foreground_given, products_of
from himap.removal.smooth_spectra import multipole_bands

SURVEY = Survey.preset("ci", nside=8, n_channels=16, box_cells=16)
CASE = pipeline.Case(survey=SURVEY, beam=Oscillating())
USUAL = Mock(seed=7)


class TestMock:
    def test_is_the_truth_of_another_sky(self):
        other = pipeline.observation(replace(CASE, survey=replace(SURVEY, seed=7))).truth
        expected, low = sphere.analyse(other, 10), sphere.alm_degree(10) > 0
        found = sphere.alms_upto(mock_alms(CASE, USUAL), 10)
        assert np.std((found - expected)[:, low]) < 0.05 * np.std(expected[:, low])

    def _hi(self, **changed):
        """Without noise, (n_channels, n_alm)."""
        return mock_alms(CASE, Mock(seed=7, **changed)) - mock_alms(CASE, Mock(seed=7, abundance=1e-9))

    def test_abundance_is_a_factor_on_hi_alone(self):
        assert self._hi(abundance=2) == pytest.approx(2 * self._hi(), rel=1e-4, abs=1e-8)

    def test_bias_raises_the_power(self):
        """In linear theory by its square; of a lognormal field in coarse cells by somewhat more."""
        biased, usual = (
            sphere.power_spectrum(alms)[:, 2:12].mean() for alms in (self._hi(bias=1.2), self._hi())
        )
        assert 1.3 < biased / usual < 1.8

    def test_gaussian_ones_have_the_powers_but_no_peaks(self):
        """Of every channel and of every pair of channels."""
        usual, gaussian = self._hi(), self._hi(gaussian=True)
        for combine in (lambda alms: alms, lambda alms: alms[1:] + alms[:-1]):
            expected = sphere.power_spectrum(combine(usual))[:, 1:]
            assert sphere.power_spectrum(combine(gaussian))[:, 1:] == pytest.approx(expected, rel=1e-4)
        maps = [
            sphere.synthesise_cube(alms, SURVEY.nside, n_channels=16, label="") for alms in (usual, gaussian)
        ]
        skewness = [np.mean((one / one.std()) ** 3) for one in maps]
        assert abs(skewness[1]) < 0.3 * skewness[0]


@pytest.mark.parametrize("first", [1, 3, 4, 2025])
def test_first_mocks_are_of_no_sky_that_is_observed_however_many_there_are(first):
    cases = [replace(CASE, survey=replace(SURVEY, seed=first + n)) for n in range(20)]
    mocks = first_mocks(3, cases)
    assert mocks == first_mocks(3, cases[:1]) and len(mocks) == 3
    assert not {mock.seed for mock in mocks} & {case.survey.seed for case in cases}
    assert (mocks[0] == Mock(seed=1)) == (first > 3)


@pytest.mark.parametrize("remover", [PCA(n_sources=3), BeamSubspace(n_sources=3)])
def test_what_comes_back_is_that_of_the_cubes(remover):
    """Cleaned with the mock, less cleaned without it, as cubes in double precision."""
    observed, alms = pipeline.observation(CASE), mock_alms(CASE, USUAL)
    maps = sphere.synthesise_cube(alms, SURVEY.nside, n_channels=16, label="") + observed.maps
    options = {"freqs": observed.freqs, "beams": observed.beams}
    both, alone = (remover.separate(Data.of(one, **options)).foreground for one in (maps, observed.maps))
    back = sphere.analyse(
        maps.astype(float) - observed.maps - both.lines(slice(None)) + alone.lines(slice(None))
    )
    (found,) = recovered(CASE, (remover,), USUAL, False)
    low = slice(2, SURVEY.nside)
    expected = sphere.power_spectrum(back).mean(axis=0)[low]
    assert found.output.angular[low] == pytest.approx(expected, rel=5e-3)
    assert (found.output.angular < found.input.angular)[low].all()


def test_a_method_that_ends_is_compared_up_to_there():
    remover = SDecGMCA(n_sources=3, lmax=10, n_warmup=4, n_refinement=2, reading="instrument-noise")
    (found,) = recovered(CASE, (remover,), USUAL)
    assert found.input.degrees[-1] == own_recovery(CASE, remover).input.degrees[-1] == 10
    assert 0.3 < found.output.angular[5] / found.input.angular[5] < 1.3
    assert cleaned.cleaning(CASE, remover).data.noise == pytest.approx(noise_sigma(SURVEY))


def test_the_truth_comes_back_as_it_was_assessed():
    remover = PCA(n_sources=3)
    own, assessed = own_recovery(CASE, remover), cleaned.assessment(CASE, remover)
    low = slice(2, 2 * SURVEY.nside)
    assert own.input.angular[low] == pytest.approx(pipeline.true_spectra(CASE).angular.mean[low], rel=1e-4)
    assert own.output.angular[low] == pytest.approx(assessed.power_spectra.angular.mean[low], rel=2e-3)


@pytest.mark.filterwarnings("ignore::himap.removal.base.SeparationWarning")
class TestBootstrap:
    CASE = pipeline.Case(survey=replace(SURVEY, nside=16, n_channels=40), beam=Oscillating())

    @pytest.mark.parametrize("others", [(), (Mock(seed=8),)])
    def test_members_have_a_foreground_drawn_from_smooth_spectra(self, others):
        """And the mock, from which each method finds it anew, without the peaks of both.

        What it leaves of the foreground is subtracted, as it is estimated from all this and other mocks, if
        there are any.
        """
        removers, freqs = (PCA(n_sources=3), BeamSubspace(n_sources=3)), self.CASE.survey.freqs
        rng = replace(self.CASE.survey, seed=USUAL.seed).rng("foreground")
        data = cleaned.data_of(self.CASE, pipeline.observation(self.CASE).maps)
        mocks = (USUAL, *others)
        model = foreground_like(self.CASE, mocks).draw(data, rng)
        alms = mock_alms(self.CASE, USUAL)
        maps = sphere.synthesise_cube(alms, 16, n_channels=40, label="")
        maps += model.foreground.cube() + model.means[:, None].astype(np.float32)
        given = {"freqs": freqs, "beams": pipeline.observation(self.CASE).beams}
        low, member = slice(2, 33), Data.of(maps, **given)
        known = foreground_given(
            member, products_of([mock_alms(self.CASE, one) for one in others] or [alms], 47)
        )
        for remover, found in zip(removers, resampled(self.CASE, removers, USUAL, mocks), strict=True):
            cleaned_one = remover.clean(maps, separate_on=mask_peaks(maps, freqs).maps, **given)
            expected = sphere.power_spectrum(sphere.analyse(cleaned_one.residual)).mean(axis=0)
            beams = given["beams"] if "beams" in remover.uses else None
            spectra = known.residual_spectra(member, cleaned_one.separation, beams)
            left = expected_power(spectra, np.ptp(freqs[:2])).angular
            assert left[low].min() > 0
            assert np.abs((found.output.angular - expected + left) / expected)[low].max() < 0.01

    def test_hi_and_noise_are_those_of_the_mocks(self):
        """In correlation, here in the third band; their power is that of the truth."""
        found = foreground_like(self.CASE, (USUAL,)).faint
        modes = (
            harmonic.to_modes(alms)[:, 10**2 : 15**2]
            for alms in (mock_alms(self.CASE, USUAL), pipeline.truth_alms(self.CASE))
        )
        mock, true = (some @ some.T / some.shape[1] for some in modes)
        for offset in (1, 2, 5):
            expected = np.trace(mock, offset=offset) / np.trace(mock)
            assert np.trace(found[2], offset=offset) / np.trace(found[2]) == pytest.approx(expected, abs=0.05)
        assert np.trace(found[2]) == pytest.approx(np.trace(true), rel=0.01)
        assert len(found) == len(multipole_bands(47))

    @pytest.mark.parametrize(("n_sources", "before", "close"), [(2, (1e3, 1e5), 20), (3, (0.8, 0.95), 0.04)])
    def test_loss_and_foreground_residual_are_corrected(self, n_sources, before, close):
        """Two spectra are too few: they leave thousands of times the power of HI and noise."""
        remover, middle = BeamSubspace(n_sources=n_sources), slice(5, 20)
        power = own_recovery(self.CASE, remover)
        mocks = tuple(first_mocks(8, [self.CASE]))
        found = bootstrap(self.CASE, [remover], mocks)[remover]
        true, residual = (getattr(power, part).angular for part in ("input", "output"))
        assert before[0] < (residual[middle] / true[middle]).mean() < before[1]
        less = power.output.less(foreground_left(self.CASE, remover, mocks)).angular
        after = found.corrected("angular", less)
        assert (after[middle] / true[middle]).mean() == pytest.approx(1, abs=close)

    def test_too_few_channels_are_refused_with_the_way_out(self):
        case = replace(CASE, survey=replace(SURVEY, n_channels=6))
        with pytest.raises(InputError, match="6 smooth functions.* got 6: take more channels"):
            resampled(case, (PCA(n_sources=3),), USUAL, (USUAL,), False)
