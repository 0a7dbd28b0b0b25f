"""The products per l of beams, sources and data against loops over every (l, m)."""

import numpy as np
import pytest

from himap.removal import harmonic
from himap.removal.sdecgmca.mixture import BlurredMixture


@pytest.fixture
def small(rng):
    modes = rng.standard_normal((5, 16))
    beams = 0.5 + rng.random((5, 4))
    return BlurredMixture(modes, beams, rng.random(5)), rng.standard_normal((5, 2))


def test_sources_one_mode_at_a_time(small):
    channels, mixing = small
    found = harmonic.project(harmonic.safe_inverse(channels.matrices(mixing)), channels.modes)
    for mode, degree in enumerate(harmonic.degrees(3)):
        matrix = np.diag(channels.beams[:, degree]) @ mixing
        expected = np.linalg.lstsq(matrix, channels.modes[:, mode])[0]
        assert found[:, mode] == pytest.approx(expected)


def test_fit_one_channel_at_a_time(small, rng):
    channels, _ = small
    sources, window = rng.standard_normal((2, 16)), rng.random(4)
    degree = harmonic.degrees(3)
    for row, seen, beam in zip(channels.fit(sources, window), channels.modes, channels.beams, strict=True):
        expected = np.linalg.lstsq((beam[degree] * sources).T, window[degree] * seen)[0]
        assert row == pytest.approx(expected)


def test_correction_leaves_nothing_of_the_kept_sources(small, rng):
    channels, mixing = small
    sources, kept = rng.standard_normal((2, 2, 16))
    corrected = channels.corrected(mixing, channels.residual(mixing, sources), sources, kept)
    degree = harmonic.degrees(3)
    for row, seen, beam in zip(corrected, channels.modes, channels.beams, strict=True):
        left = seen - beam[degree] * (row @ sources)
        assert kept @ (beam[degree] * left) == pytest.approx(0, abs=1e-10)


def test_truth_is_a_fixed_point_of_the_correction_but_not_of_the_fit(rng):
    mixing, sources = rng.standard_normal((5, 2)), rng.standard_normal((2, 16))
    beams = 0.5 + rng.random((5, 4))
    channels = BlurredMixture(beams[:, harmonic.degrees(3)] * (mixing @ sources), beams, None)
    kept = np.where(np.abs(sources) > 0.7, sources, 0)
    left = channels.residual(mixing, sources)
    assert channels.corrected(mixing, left, sources, kept) == pytest.approx(mixing, abs=1e-12)
    assert np.abs(channels.fit(kept, np.ones(4)) - mixing).max() > 0.01


def test_noise_of_sources(small, rng):
    channels, mixing = small
    inverses = harmonic.safe_inverse(channels.matrices(mixing))
    expected = [np.diag(inverse @ np.diag(channels.noise) @ inverse.T) for inverse in inverses]
    assert channels.noise_of(inverses) == pytest.approx(np.array(expected))


def test_what_is_left(small, rng):
    channels, mixing = small
    sources = rng.standard_normal((2, 16))
    model = channels.beams[:, harmonic.degrees(3)] * (mixing @ sources)
    assert channels.residual(mixing, sources) == pytest.approx(channels.modes - model)


def test_residual_noise_is_the_variance_over_the_finer_half(small, rng):
    channels, mixing = small
    sources = rng.standard_normal((2, 16))
    degree = harmonic.degrees(3)
    left = channels.modes - channels.beams[:, degree] * (mixing @ sources)
    expected = np.mean(left[:, degree >= 2] ** 2, axis=1)
    assert channels.residual_noise(mixing, sources) == pytest.approx(expected)


def test_with_noise(small):
    channels, _ = small
    other = channels.with_noise(np.ones(5))
    assert other.noise.tolist() == [1] * 5
    assert other.modes is channels.modes
    assert other.beams is channels.beams
