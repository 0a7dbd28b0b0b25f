"""GMCA: a plain twin with the whole cube in starlets, known sparse sources, and what it must survive."""

import healpy as hp
import numpy as np
import pytest
from gmca_twin import mixing_error, plain_gmca, similarity

from himap.maps import sphere
from himap.maps.starlets import starlet_filters, starlets
from himap.removal.base import SeparationWarning
from himap.removal.gmca import GMCA, SphereDetails
from himap.removal.pca import PCA

N_CHANNELS = 8
FREQS = np.linspace(905, 1395, N_CHANNELS)
NSIDE = 16
N_PIX = 12 * NSIDE**2


@pytest.fixture
def sources(rng):
    """Three maps of a few round blobs each, of one width per source: sparse in starlets; mK."""
    maps = []
    for width, n_blobs in ((8, 60), (12, 40), (16, 30)):
        spikes = np.zeros(N_PIX)
        spikes[rng.choice(N_PIX, n_blobs, replace=False)] = rng.standard_normal(n_blobs)
        beam = sphere.gaussian_beam(np.deg2rad(width), 3 * NSIDE - 1)
        blobs = sphere.synthesise(sphere.multiply_beam(sphere.analyse(spikes), beam), NSIDE)
        maps.append(1e3 * blobs / blobs.std())
    return np.array(maps)


@pytest.fixture
def mixing():
    columns = (FREQS / 1000)[:, None] ** np.array([-2.8, -1.0, 1.5])
    return columns / np.linalg.norm(columns, axis=0)


@pytest.fixture
def sky(mixing, sources, rng):
    return (mixing @ sources + 0.1 * rng.standard_normal((N_CHANNELS, N_PIX))).astype(np.float32)


def clean(maps, **parameters):
    return GMCA(**parameters).clean(maps, freqs=FREQS[: len(maps)])


@pytest.mark.parametrize("penalty", ["l1", "l0"])
def test_recovers_sparse_sources(sky, mixing, sources, penalty):
    found = clean(sky, penalty=penalty).separation
    assert found.converged
    assert mixing_error(found.mixing, mixing) < 0.03
    assert similarity(sources, found.sources).min() > 0.99
    assert similarity(sources, PCA(n_sources=3).clean(sky, freqs=FREQS).separation.sources).min() < 0.9


def phi(n_scales, nside):
    """The detail scales as dense matrices made with healpy, (n_scales, n_pix, n_pix)."""
    n_pix, lmax = 12 * nside**2, 3 * nside - 1
    filters = starlet_filters(n_scales, lmax)[1:]
    rest = np.empty((n_scales, n_pix, n_pix))
    for pixel, row in enumerate(np.eye(n_pix)):
        alm = hp.map2alm(row, lmax, iter=0)
        for scale, band in enumerate(filters):
            rest[scale, :, pixel] = hp.alm2map(hp.almxfl(alm, band), nside)
    return np.concatenate([np.eye(n_pix)[None] - rest.sum(axis=0), rest[:-1]])


@pytest.mark.parametrize("penalty", ["l1", "l0"])
def test_equals_its_plain_twin(penalty, rng):
    nside = 4
    amplitudes = rng.laplace(size=(2, 12 * nside**2)) * [[100], [20]]
    maps = (FREQS / 1000)[:, None] ** np.array([-2.8, 1.0]) @ amplitudes
    maps = (maps + rng.standard_normal(maps.shape)).astype(np.float32)
    centred = (maps - maps.mean(axis=1, dtype=float)[:, None]).astype(np.float32)
    twin = plain_gmca(centred.astype(float), 2, phi(2, nside), 6, 8, penalty == "l1")
    with pytest.warns(SeparationWarning):
        cleaned = clean(maps, n_sources=2, n_scales=2, penalty=penalty, n_falling=8, max_iterations=6)
    ours = cleaned.separation.mixing
    assert np.abs(twin.T @ ours).max(axis=0) == pytest.approx(1, abs=1e-12)
    # Ours keeps the faint rest of the cube in float32 (`SplitCube`): the mean of that rounding enters A.
    rounding = np.finfo(np.float32).eps / np.sqrt(maps.shape[1])
    assert np.abs(ours @ np.linalg.pinv(ours) - twin @ np.linalg.pinv(twin)).max() < rounding


def test_foreground_is_the_projection_on_the_span_of_the_mixing(sky):
    cleaned = clean(sky)
    centred = (sky - sky.mean(axis=1, dtype=float)[:, None]).astype(np.float32)
    axes = np.linalg.qr(cleaned.separation.mixing)[0]
    expected = centred - axes @ (axes.T @ centred)
    assert cleaned.residual == pytest.approx(expected, abs=1e-6 * float(np.abs(sky).max()))


def test_details_against_starlets_and_their_transpose(rng):
    smooth = np.where(np.arange(3 * NSIDE) < NSIDE, 1.0, 0.0)
    maps = sphere.synthesise(sphere.gaussian_alm(smooth, rng), NSIDE)[None]
    phi = SphereDetails(3, NSIDE)
    ours, theirs = phi.details(maps), starlets(maps, 3)[:-1]
    assert ours == pytest.approx(theirs, abs=5e-3 * float(maps.std()))
    scales = rng.standard_normal(ours.shape)
    backward = np.sum(maps * phi.details_adjoint(scales))
    assert np.sum(ours * scales) == pytest.approx(backward, abs=1e-9)


def test_as_many_sources_as_channels(sky):
    assert np.abs(clean(sky[:3], n_sources=3).residual).max() < 3e-7 * np.abs(sky).max()
