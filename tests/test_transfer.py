"""What comes back of mocks: against closed forms, and what a slow twin measures on the cubes."""

import numpy as np
import pytest
from scipy import fft

from himap.core.errors import InputError
from himap.maps import sphere
from himap.maps.low_rank import LowRankCube
from himap.measures.diagnostics import band_means, bands
from himap.measures.spectra import frequency_power
from himap.measures.transfer import HarmonicPower, MockPower, TransferFunction, harmonic_power, mock_power

NSIDE, N_CHANNELS, WIDTH = 16, 11, 2.5
LMAX = 12  # pixels hold this exactly enough


@pytest.fixture(params=[N_CHANNELS, N_CHANNELS + 1], ids=["odd", "even"])
def alms(rng, request):
    """A cube with another spectrum in every channel, no means, float32."""
    slopes = np.linspace(-1, -2, request.param)
    cls = [np.where(np.arange(LMAX + 1) > 0, (1.0 + np.arange(LMAX + 1)) ** slope, 0) for slope in slopes]
    return np.array([sphere.gaussian_alm(cl, rng) for cl in cls]).astype(np.complex64)


@pytest.fixture
def maps(alms):
    return sphere.synthesise_cube(alms, NSIDE, n_channels=len(alms), label="")


@pytest.fixture
def wrong(alms, rng):
    """Something that comes back besides, with maps that hold no more than the cube."""
    spectra = rng.standard_normal((len(alms), 3))
    more = [sphere.gaussian_alm(np.r_[0, np.ones(LMAX)], rng) for _ in range(3)]
    return LowRankCube(spectra=spectra, maps=0.1 * np.array([sphere.synthesise(alm, NSIDE) for alm in more]))


class TestSums:
    def test_over_k_is_the_angular_power(self, alms):
        power = harmonic_power(alms, WIDTH)
        assert power.angular == pytest.approx(sphere.power_spectrum(alms).mean(axis=0), rel=1e-5)

    def test_over_l_is_the_frequency_power(self, alms, maps):
        power, expected = harmonic_power(alms, WIDTH), frequency_power(maps, WIDTH)
        assert power.k == pytest.approx(expected.k)
        assert power.frequency == pytest.approx(expected.power, rel=1e-3)

    def test_one_wave_has_one_k(self):
        """A cosine along frequency of 2 periods, the same map in every channel."""
        alm = sphere.gaussian_alm(np.r_[0, np.ones(LMAX)], np.random.default_rng(1))
        wave = np.cos(2 * np.pi * 2 * np.arange(12) / 12)
        power = harmonic_power(wave[:, None] * alm, WIDTH)
        assert power.power[:, 2] == pytest.approx(sphere.power_spectrum(alm) * WIDTH * 12 / 4)
        assert np.delete(power.power, 2, axis=1) == pytest.approx(0, abs=1e-12)

    def test_bins_are_means_over_modes(self, alms):
        power = harmonic_power(alms, WIDTH)
        (one,) = power.binned([2, 5])
        assert one == pytest.approx((5 * power.power[2] + 7 * power.power[3] + 9 * power.power[4]) / 21)


def test_what_comes_back_is_that_of_the_cube(alms, maps, wrong):
    """Against the power of the cube that comes back, and the product of the two cubes mode by mode."""
    found = mock_power(alms, wrong, WIDTH)
    back = sphere.analyse(maps + wrong.cube(), LMAX, n_iter=8)
    assert found.input.power == pytest.approx(harmonic_power(alms, WIDTH).power)
    expected = harmonic_power(back, WIDTH).power[2:]
    assert found.output.power[2:] == pytest.approx(expected, rel=0.02, abs=2e-3 * float(expected.max()))
    waves, others = fft.fft(alms, axis=0), fft.fft(back, axis=0)
    degree = sphere.alm_degree(LMAX)
    for own in (2, 7, LMAX):
        products = (waves * others.conj()).real[:, degree == own]
        mean = (products[:, 0] + 2 * products[:, 1:].sum(axis=1)) / (2 * own + 1) * WIDTH / len(alms)
        both = (mean + mean[-np.arange(len(mean))])[: found.cross.power.shape[1]] / 2  # k and -k
        close = 2e-3 * float(np.abs(both).max())
        assert found.cross.power[own] == pytest.approx(both, rel=0.02, abs=close)


def test_what_is_wrong_with_other_channels_is_refused(alms, wrong):
    with pytest.raises(InputError, match=f"has {len(alms)} channels, the input {len(alms) - 1}"):
        mock_power(alms[1:], wrong, WIDTH)


def power_of(values):
    return HarmonicPower(power=np.asarray(values, dtype=float), n_channels=6, channel_width=1.0)


def made_up(kept, noise=0.0, size=1.0, rng=None):
    """A mock of which a share of the amplitude comes back, and noise beside it."""
    put_in = size * np.ones((5, 4)) * (1 if rng is None else rng.uniform(0.5, 1.5, (5, 4)))
    return MockPower(
        input=power_of(put_in), output=power_of(kept**2 * put_in + noise), cross=power_of(kept * put_in)
    )


class TestTransferFunction:
    def test_of_what_is_kept_alike_everywhere(self, rng):
        mocks = tuple(made_up(0.9, size=size, rng=rng) for size in (1, 3))
        assert TransferFunction(mocks=mocks).definition == "cross"
        power, common = (TransferFunction(mocks=mocks, definition=name) for name in ("auto", "cross"))
        for kind in ("angular", "frequency"):
            assert getattr(power, kind) == pytest.approx(0.81)
            assert getattr(common, kind) == pytest.approx(0.9)
        assert power.cylindrical([2, 3, 5]) == pytest.approx(np.full((2, 4), 0.81))
        assert power.errors("angular") == pytest.approx(np.zeros((2, 5)), abs=1e-12)

    def test_what_is_kept_here_and_lost_there(self):
        """Half of the amplitude is lost at one k and one l, where twice the power of the rest is."""
        kept, put_in = np.ones((5, 4)), np.ones((5, 4))
        kept[3, 1], put_in[3, 1] = 0.5, 2
        one = MockPower(
            input=power_of(put_in), output=power_of(kept**2 * put_in), cross=power_of(kept * put_in)
        )
        found = TransferFunction(mocks=(one,), definition="auto")
        assert found.angular[3] == pytest.approx((1 + 2 * 0.5 + 2 + 1) / (1 + 2 * 2 + 2 + 1))
        assert found.frequency[1] == pytest.approx((1 + 3 + 5 + 7 * 0.5 + 9) / (1 + 3 + 5 + 7 * 2 + 9))
        assert found.cylindrical([3, 4])[0, 1] == pytest.approx(0.25)
        assert np.delete(found.angular, 3) == pytest.approx(1)

    def test_nothing_put_in_is_nothing_kept(self):
        found = TransferFunction(mocks=(made_up(0.9, size=0),))
        assert not found.angular.any() and not found.cylindrical([0, 5]).any()

    def test_errors_are_those_of_mocks_corrected_by_the_others(self):
        found = TransferFunction(mocks=(made_up(1.0), made_up(0.8)))
        assert found.errors("frequency")[:, 0] == pytest.approx([1 / 0.8 - 1, 0.8 - 1])

    def test_error_bars_need_two_mocks(self):
        with pytest.raises(InputError, match="two mocks or more"):
            TransferFunction(mocks=(made_up(1.0),)).errors("angular")

    @pytest.mark.parametrize(
        ("given", "told"), [({"mocks": ()}, "got none"), ({"definition": "both"}, "cross or auto")]
    )
    def test_refused(self, given, told):
        with pytest.raises(InputError, match=told):
            TransferFunction(**({"mocks": (made_up(1.0),)} | given))


class TestBands:
    K = np.arange(1, 20) * 0.0126

    def test_those_that_are_reached_to_their_end(self):
        found = bands(np.arange(30), self.K)
        assert list(found)[:3] == ["C/C0, 2-4", "C/C0, 5-9", "C/C0, 10-19"]
        assert found["C/C0, 2-4"][1].nonzero()[0].tolist() == [2, 3, 4]
        assert [self.K[found[name][1]].tolist() for name in list(found)[3:]] == [
            self.K[:2].tolist(),
            self.K[2:7].tolist(),
            self.K[7:].tolist(),
        ]

    def test_bins_that_hold_none_of_a_band(self):
        assert "C/C0, 2-4" not in bands(np.array([7.0, 12, 17, 22]), self.K)

    def test_means(self):
        known = {"angular": np.arange(60.0).reshape(2, 30), "frequency": self.K}
        found = band_means(known, np.arange(30), self.K)
        assert found["C/C0, 10-19"].tolist() == [14.5, 44.5]
        assert found["P/P0, k > 0.1"] == pytest.approx(self.K[7:].mean())
        assert list(found) == list(bands(np.arange(30), self.K))


class TestRatios:
    def test_of_what_came_back_and_of_what_is_common(self):
        found = made_up(0.8, noise=0.1)
        back, common = found.ratios(), found.ratios("cross")
        for kind in ("angular", "frequency"):
            assert np.isnan([back[kind][0], common[kind][0]]).all()
            assert back[kind][1:] == pytest.approx(0.74) and common[kind][1:] == pytest.approx(0.8)

    def test_no_power_to_divide_by(self):
        with pytest.raises(InputError, match="must be positive"):
            made_up(1.0, size=0).ratios()
