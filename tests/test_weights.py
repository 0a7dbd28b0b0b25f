"""Weights of pixels and voxels: closed forms, slow twins, and no weights where they are equal."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial as NumpyPolynomial
from scipy.optimize import minimize

from himap.core.errors import InputError
from himap.removal import available, create, using, weighted_pca
from himap.removal.data import Data
from himap.removal.pca import PCA
from himap.removal.polynomial import Polynomial

N_PIX = 300
FREQS = np.linspace(900, 1100, 16)
SPECTRA = (FREQS / 1000)[:, None] ** np.array([-2.1, -2.8])
TAKING = using("weights")
OPTIONS = {"polynomial": {"order": 3}}


@pytest.fixture
def foreground(rng):
    """Two power laws, mK, noise free."""
    return SPECTRA @ (1e3 * np.exp(rng.standard_normal((2, N_PIX))))


@pytest.fixture
def hits(rng):
    return rng.integers(1, 9, N_PIX)


@pytest.fixture
def sky(foreground, hits, rng):
    """With noise by hits."""
    return foreground + 3 * rng.standard_normal(foreground.shape) / np.sqrt(hits)


@pytest.fixture
def flags(rng):
    """A fifth of the voxels."""
    return rng.random((len(FREQS), N_PIX)) < 0.2


def model_of(found):
    """m + A S of what `weighted_components` found in voxels with weights of their own."""
    return found.mixing @ found.sources + found.means[:, None]


def clean(name, maps, weights=None, **given):
    method = create(name, **OPTIONS.get(name, {}))
    return method.clean(maps, freqs=FREQS, weights=weights, **given)


class TestPixelWeights:
    def test_whole_numbers_of_hits_are_pixels_that_are_there_as_often(self, sky, hits):
        """Of PCA without weights, means included; zero hits are pixels that are not there."""
        hits[:50] = 0
        weighted = PCA().clean(sky, freqs=FREQS, weights=hits)
        repeated = PCA().clean(np.repeat(sky, hits, axis=1), freqs=FREQS)
        assert np.repeat(weighted.residual, hits, axis=1) == pytest.approx(repeated.residual, abs=1e-3)
        assert weighted.separation.means == pytest.approx(repeated.separation.means, rel=1e-9)
        assert not weighted.residual[:, :50].any() and not weighted.separation.sources[:, :50].any()
        plain = PCA().clean(sky[:, 50:], freqs=FREQS)
        assert np.abs(weighted.residual[:, 50:] - plain.residual).max() > 0.1

    def test_polynomials_do_not_feel_them(self, sky, hits):
        one, two = (Polynomial(order=3).clean(sky, freqs=FREQS, weights=w) for w in (None, hits))
        assert np.array_equal(one.residual, two.residual)


@pytest.mark.parametrize("name", TAKING)
class TestAll:
    @pytest.mark.parametrize("shape", [(N_PIX,), (len(FREQS), N_PIX)])
    def test_equal_weights_are_none(self, name, sky, shape):
        plain = clean(name, sky)
        for weights in (np.full(shape, 3.0), np.ones(shape, bool)):
            weighted = clean(name, sky, weights)
            assert np.array_equal(weighted.residual, plain.residual)
            assert np.array_equal(weighted.separation.mixing, plain.separation.mixing)

    def test_only_ratios_matter(self, name, sky, hits, flags):
        weights = np.where(flags, 0, hits)
        one, two = (clean(name, sky, w) for w in (weights, 1e-9 * weights))
        assert one.residual == pytest.approx(two.residual, abs=1e-3)

    def test_what_is_missing_may_be_anything(self, name, sky, hits, flags):
        """It counts nothing, is 0 in the residual, and the foreground there is what was found."""
        weights = np.where(flags, 0, hits)
        one, two = (clean(name, np.where(flags, value, sky), weights) for value in (7, np.nan))
        assert np.array_equal(one.residual, two.residual) and np.array_equal(one.foreground, two.foreground)
        assert not one.residual[flags].any() and one.residual[~flags].all()
        found = one.separation.foreground.cube() + one.separation.means[:, None]
        assert one.foreground == pytest.approx(found, rel=1e-5)
        assert (one.residual + one.foreground)[~flags] == pytest.approx(sky[~flags], rel=1e-6)


class TestVoxelWeights:
    def test_a_low_rank_sky_is_recovered_where_it_is_missing(self, foreground, flags):
        """To the rounding of maps in float32."""
        maps = np.where(flags, np.nan, foreground)
        cleaned = PCA(n_sources=2).clean(maps, freqs=FREQS, weights=~flags)
        assert cleaned.separation.converged
        assert np.abs(cleaned.foreground - foreground).max() < 3e-7 * foreground.max()
        assert np.abs(cleaned.residual).max() < 3e-7 * foreground.max()

    @pytest.mark.parametrize("seed", range(3))
    def test_a_sky_whose_spectra_are_nearly_one(self, seed):
        """Three power laws: where all are looked for at once, the last would have gaps of the first."""
        rng, freqs = np.random.default_rng(seed), np.linspace(900, 1400, 30)
        sky = (freqs / 1000)[:, None] ** np.array([-2.1, -2.8, -3.3]) @ np.exp(rng.standard_normal((3, 400)))
        seen = rng.random(sky.shape) > 0.2
        found = weighted_pca.weighted_components(np.where(seen, sky, 0), seen.astype(float), 3)
        assert found.converged
        assert np.abs(model_of(found) - sky).max() < 1e-11 * sky.max()

    def test_against_a_minimiser(self, rng):
        """The least weighted squares that scipy finds from where himap ended, and from plain PCA."""
        n_channels, n_pix = 6, 20
        maps = np.outer(rng.random(n_channels) + 1, 10 * rng.standard_normal(n_pix)) + 5
        maps += rng.standard_normal(maps.shape)
        weights = rng.gamma(2, size=maps.shape) * (rng.random(maps.shape) > 0.2)
        found = PCA(n_sources=1).separate(Data.of(maps, freqs=FREQS[:6], weights=weights))

        def cost(x):
            offset, mixing, sources = np.split(x, [n_channels, 2 * n_channels])
            left = maps - offset[:, None] - np.outer(mixing, sources)
            pull = -2 * weights * left
            slope = np.concatenate([pull.sum(axis=1), pull @ sources, mixing @ pull])
            return np.sum(weights * left**2), slope

        plain = PCA(n_sources=1).separate(Data.of(maps, freqs=FREQS[:6]))
        own, unweighted = (np.sum(weights * (maps - model_of(one)) ** 2) for one in (found, plain))
        for start in (found, plain):
            x = np.concatenate([start.means, start.mixing[:, 0], start.sources[0]])
            least = minimize(cost, x, jac=True, method="BFGS", options={"maxiter": 5000})
            assert own == pytest.approx(least.fun, rel=1e-5)
        assert unweighted > 1.01 * own

    def test_weights_of_pixels_times_those_of_channels(self, sky, hits):
        """One eigenproblem: of the maps times the roots of the weights of channels."""
        of_channels = np.linspace(1, 30, len(FREQS))[:, None]
        sky -= np.average(sky, axis=1, weights=hits)[:, None]
        roots = np.sqrt(of_channels)
        found = weighted_pca.weighted_components(sky, of_channels * hits, 2)
        scaled = weighted_pca.weighted_components(roots * sky, hits.astype(float), 2)
        assert model_of(found) == pytest.approx(scaled.foreground.lines(slice(None)) / roots, abs=1e-8)
        assert found.n_iterations <= 3
        assert found.mixing.T @ found.mixing == pytest.approx(np.eye(2), abs=1e-12)
        variances = np.var(found.sources, axis=1)
        assert variances[0] > variances[1] and abs(np.corrcoef(found.sources)[0, 1]) < 0.01

    def test_blocks_of_pixels_change_nothing(self, sky, flags, monkeypatch):
        one = PCA().separate(Data.of(sky, freqs=FREQS, weights=~flags)).sources
        monkeypatch.setattr(weighted_pca, "_BLOCK", 7)
        assert PCA().separate(Data.of(sky, freqs=FREQS, weights=~flags)).sources == pytest.approx(
            one, abs=1e-3
        )

    def test_turns_that_do_not_settle_are_said(self, sky, flags, monkeypatch):
        monkeypatch.setattr(weighted_pca, "_MOST_TURNS", 2)
        with pytest.warns(match="pca: stopped after 2 iterations without converging"):
            PCA().separate(Data.of(sky, freqs=FREQS, weights=~flags))


class TestPolynomials:
    def test_against_numpy(self, sky, hits, flags, rng):
        """Line by line, without the channels that are missing."""
        weights = np.where(flags, 0, hits * rng.gamma(3, size=flags.shape))
        found = Polynomial(order=3, n_sigma=100).clean(sky, freqs=FREQS, weights=weights)
        for pixel in range(0, N_PIX, 10):
            seen = ~flags[:, pixel]
            fit = NumpyPolynomial.fit(
                FREQS[seen], sky[seen, pixel], 3, w=np.sqrt(weights[seen, pixel]), domain=[900, 1100]
            )
            assert found.foreground[:, pixel] == pytest.approx(fit(FREQS), rel=1e-6)

    def test_a_bright_sky_keeps_its_digits(self, flags, rng):
        """A polynomial of 1e9 mK is fitted to 1e-6 mK, the edge of the band missing."""
        line = NumpyPolynomial(rng.standard_normal(5))(np.linspace(-1, 1, 16))
        maps, weights = 1e9 * np.tile(line[:, None], (1, 40)), np.where(flags, 0, 1.0)[:, :40]
        weights[-3:, 1:] = 0
        found = Polynomial(order=4).separate(Data.of(maps, freqs=FREQS, weights=weights))
        seen = weights > 0
        assert np.abs(found.foreground.lines(slice(None)) - maps)[seen].max() < 2e-6


@pytest.mark.parametrize("name", sorted(set(available()) - set(TAKING)))
def test_methods_that_take_none_say_so(name, sky, hits):
    assert TAKING == ["parametric", "pca", "polynomial"]
    with pytest.raises(
        InputError, match=f"{name} takes no weights and no flags; parametric, pca and polynomial do"
    ):
        create(name).clean(sky, freqs=FREQS, beams=np.ones((16, 20)), weights=hits)
