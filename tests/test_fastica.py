"""FastICA: against scikit-learn, against PCA, and on sources that are known."""

import numpy as np
import pytest
from sklearn.decomposition import fastica
from sparse_problem import similarity

from himap.removal.fastica import FastICA
from himap.removal.pca import PCA

FREQS = np.linspace(902.5, 1397.5, 24)
N_PIX = 12 * 16**2


@pytest.fixture
def sources(rng):
    """Three independent sources far from Gaussian: two with long tails and one with none; mK."""
    shapes = [rng.laplace(size=N_PIX), rng.uniform(-1, 1, N_PIX), rng.exponential(size=N_PIX)]
    return np.array([[3e3], [1e3], [5e2]]) * np.array(shapes)


@pytest.fixture
def mixing():
    return (FREQS / 1000)[:, None] ** np.array([-2.8, -2.1, 1.0])


@pytest.fixture
def sky(mixing, sources, rng):
    return (mixing @ sources + 0.05 * rng.standard_normal((len(FREQS), N_PIX))).astype(np.float32)


def clean(maps, seed=1, **parameters):
    return FastICA(**parameters).clean(maps, freqs=FREQS, rng=np.random.default_rng(seed))


@pytest.mark.parametrize("contrast", ["logcosh", "exp", "cube"])
def test_equals_scikit_learn_on_the_same_white_data(sky, contrast):
    centred = sky - sky.mean(axis=1, dtype=float)[:, None]
    values, axes = np.linalg.eigh(centred @ centred.T / N_PIX)
    values, axes = values[:-4:-1], axes[:, :-4:-1]
    axes *= np.sign(axes[np.abs(axes).argmax(axis=0), range(3)])
    white = (axes / np.sqrt(values)).T @ centred
    start = np.random.default_rng(1).standard_normal((3, 3))
    options = {"whiten": False, "fun": contrast, "tol": 1e-6, "max_iter": 500}
    _, rotation, theirs, n_iterations = fastica(white.T, w_init=start, return_n_iter=True, **options)
    ours = clean(sky, contrast=contrast).separation
    assert ours.n_iterations == n_iterations
    assert similarity(theirs.T, ours.sources) == pytest.approx(1, abs=1e-9)
    columns = axes * np.sqrt(values) @ rotation.T
    assert similarity(columns.T, ours.mixing.T) == pytest.approx(1, abs=1e-9)


def test_foreground_is_that_of_pca_bit_for_bit(sky):
    ours = clean(sky)
    assert np.array_equal(ours.residual, PCA(n_sources=3).clean(sky, freqs=FREQS).residual)
    found = ours.separation
    centred = ours.foreground - sky.mean(axis=1, dtype=float)[:, None]
    assert found.mixing @ found.sources == pytest.approx(centred, abs=3e-7 * float(np.abs(sky).max()))


def test_recovers_independent_sources_where_pca_does_not(sky, sources):
    assert similarity(sources, clean(sky).separation.sources).min() > 0.999
    assert similarity(sources, PCA(n_sources=3).clean(sky, freqs=FREQS).separation.sources).min() < 0.99


def test_order_scale_and_sign_are_definite(sky):
    found = clean(sky).separation
    assert np.linalg.norm(found.mixing, axis=0) == pytest.approx(1)
    assert (found.mixing.max(axis=0) == np.abs(found.mixing).max(axis=0)).all()
    assert (np.diff(found.sources.var(axis=1)) < 0).all()
    other = clean(sky, seed=2, tolerance=1e-9).separation
    assert other.sources == pytest.approx(found.sources, abs=1e-2 * float(found.sources.std()))


def test_fewer_directions_than_sources(mixing, sources):
    """Noise-free maps of two sources: the third and the fourth found are zero."""
    maps = (mixing[:, :2] @ sources[:2]).astype(np.float32)
    cleaned = clean(maps, n_sources=4)
    found = cleaned.separation
    assert np.array_equal(found.sources[2:], np.zeros((2, N_PIX)))
    assert similarity(sources[:2], found.sources[:2]).min() > 0.999
    assert np.abs(cleaned.residual).max() < 3e-7 * np.abs(maps).max()
