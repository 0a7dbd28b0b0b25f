"""GMCA on the sphere and in the plane: a plain twin with the whole cube in starlets, known sparse sources."""

import math

import healpy as hp
import numpy as np
import pytest
from cube_files import SKY, run, write_image
from scipy import ndimage
from sparse_problem import mixing_error, similarity

from himap.cubes import read_cube, suggest
from himap.maps import sphere
from himap.maps.starlets import PlaneStarlets, starlet_filters
from himap.removal.base import SeparationWarning
from himap.removal.compiled import deviation, median, ranked, sparse
from himap.removal.gmca import GMCA
from himap.removal.pca import PCA

NSIDE = 16
N_PIX = 12 * NSIDE**2
FREQS = 980 + 60.0 * np.arange(8)
SHAPE = 96, 80
AXES = (*SKY["SIN"], ("FREQ", 980e6, 1.0, 60e6, "Hz"))
MIXING = (FREQS / 1000)[:, None] ** np.array([-2.8, -1.0, 1.5])
MIXING /= np.linalg.norm(MIXING, axis=0)
Y, X = np.indices(SHAPE)
# All but a disc in the middle, a corner and two rows.
SEEN = (np.hypot(Y - 50, X - 30) > 12) & ((Y >= 15) | (X >= 20)) & (Y != 75) & (Y != 76)
EVERYWHERE = np.ones(SHAPE, dtype=bool)


def blobs_of(spikes, width, in_plane):
    if in_plane:
        return ndimage.gaussian_filter(spikes.reshape(SHAPE), width, mode="constant").ravel()
    beam = sphere.gaussian_beam(np.deg2rad(width), 3 * NSIDE - 1)
    return sphere.synthesise(sphere.multiply_beam(sphere.analyse(spikes), beam), NSIDE)


def make_sky(rng, in_plane):
    """Maps and three sources of a few round blobs each, of one width per source: sparse in starlets; mK."""
    kinds = ((1.0, 150), (1.4, 100), (1.9, 75)) if in_plane else ((8, 60), (12, 40), (16, 30))
    n_pix, sources = EVERYWHERE.size if in_plane else N_PIX, []
    for width, n_blobs in kinds:
        spikes = np.zeros(n_pix)
        spikes[rng.choice(n_pix, n_blobs, replace=False)] = rng.standard_normal(n_blobs)
        blobs = blobs_of(spikes, width, in_plane)
        sources.append(1e3 * blobs / blobs.std())
    noise = 0.1 * rng.standard_normal((len(FREQS), n_pix))
    return (MIXING @ sources + noise).astype(np.float32), np.array(sources)


@pytest.fixture
def sky(rng):
    return make_sky(rng, False)[0]


@pytest.fixture
def maps(rng):
    """Of an image."""
    return make_sky(rng, True)[0]


def clean(maps, image=None, *, mask=None, **parameters):
    return GMCA(**parameters).clean(maps, freqs=FREQS[: len(maps)], image=image, mask=mask)


@pytest.mark.parametrize("penalty", ["l1", "l0"])
@pytest.mark.parametrize("image", [None, EVERYWHERE, SEEN], ids=["sphere", "plane", "its seen pixels"])
def test_recovers_sparse_sources(rng, image, penalty):
    """Where PCA does not."""
    maps, sources = make_sky(rng, image is not None)
    if image is not None:
        maps, sources = maps[:, image.ravel()], sources[:, image.ravel()]
    found = clean(maps, image, penalty=penalty).separation
    assert found.converged
    assert mixing_error(found.mixing, MIXING) < 0.03
    assert similarity(sources, found.sources).min() > 0.99
    assert similarity(sources, PCA(n_sources=3).clean(maps, freqs=FREQS).separation.sources).min() < 0.9


def plain_gmca(maps, n_sources, matrices, n_iterations, n_falling, soft):
    """GMCA as in its definition: the starlets of the whole cube, pseudo-inverses, sorted coefficients."""
    starlets = np.concatenate([maps @ matrix.T for matrix in matrices], axis=1)
    mixing = np.linalg.svd(maps, full_matrices=False)[0][:, :n_sources]
    for iteration in range(n_iterations):
        coefficients = np.linalg.pinv(mixing) @ starlets
        for row in coefficients:
            for scale in np.split(row, len(matrices)):
                last = 3 * 1.4826 * np.median(np.abs(scale))
                size = np.sort(np.abs(scale)[np.abs(scale) > last])
                n_kept = int(np.ceil(min(1, (iteration + 1) / n_falling) * len(size)))
                limit = last if n_kept == len(size) else size[-n_kept - 1]
                kept = np.abs(scale) > limit
                scale[:] = np.where(kept, scale - limit * np.sign(scale) * soft, 0)
        mixing = starlets @ np.linalg.pinv(coefficients)
        mixing /= np.linalg.norm(mixing, axis=0)
    return mixing


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
@pytest.mark.parametrize("in_plane", [False, True])
def test_equals_its_plain_twin(in_plane, penalty, rng):
    if in_plane:
        rows = slice(4, 20), slice(6, 26)
        image = SEEN[rows]
        maps = make_sky(rng, True)[0].reshape(-1, *SHAPE)[:, *rows][:, image]
        matrices = PlaneStarlets(image, 2).details(np.eye(image.sum())).transpose(0, 2, 1)
    else:
        image, matrices = None, phi(2, 4)
        amplitudes = rng.laplace(size=(2, 12 * 4**2)) * [[100], [20]]
        maps = (FREQS / 1000)[:, None] ** np.array([-2.8, 1.0]) @ amplitudes
        maps = (maps + rng.standard_normal(maps.shape)).astype(np.float32)
    centred = (maps - maps.mean(axis=1, dtype=float)[:, None]).astype(np.float32)
    twin = plain_gmca(centred.astype(float), 2, matrices, 6, 8, penalty == "l1")
    short = {"n_sources": 2, "n_scales": 2, "n_falling": 8, "max_iterations": 6}
    with pytest.warns(SeparationWarning):
        ours = clean(maps, image, penalty=penalty, **short).separation.mixing
    assert np.abs(twin.T @ ours).max(axis=0) == pytest.approx(1, abs=1e-12)
    # Ours keeps the faint rest of the cube in float32 (`SplitCube`): the mean of that rounding enters A.
    rounding = 1e-9 if in_plane else np.finfo(np.float32).eps / np.sqrt(maps.shape[1])
    assert np.abs(ours @ np.linalg.pinv(ours) - twin @ np.linalg.pinv(twin)).max() < rounding


def test_foreground_is_the_projection_on_the_span_of_the_mixing(sky):
    cleaned = clean(sky)
    centred = (sky - sky.mean(axis=1, dtype=float)[:, None]).astype(np.float32)
    axes = np.linalg.qr(cleaned.separation.mixing)[0]
    expected = centred - axes @ (axes.T @ centred)
    assert cleaned.residual == pytest.approx(expected, abs=1e-6 * float(np.abs(sky).max()))


def test_as_many_sources_as_channels(sky):
    assert np.abs(clean(sky[:3], n_sources=3).residual).max() < 3e-7 * np.abs(sky).max()


def test_a_mask_of_an_image_is_the_image_of_what_it_keeps(maps):
    """Whatever lies outside; and both together, of pixels that the maps have no more."""
    kept = SEEN.ravel()
    expected = clean(maps[:, kept], SEEN)
    masked = clean(np.where(kept, maps, np.nan), EVERYWHERE, mask=kept)
    assert np.array_equal(masked.residual[:, kept], expected.residual)
    assert not masked.residual[:, ~kept].any() and not masked.separation.sources[:, ~kept].any()
    left = X < 60
    both = clean(maps[:, left.ravel()], left, mask=SEEN[left])
    assert np.array_equal(
        both.residual[:, SEEN[left]], clean(maps[:, (SEEN & left).ravel()], SEEN & left).residual
    )


class TestFiles:
    @pytest.fixture
    def path(self, maps, tmp_path):
        images = maps.reshape(-1, *SHAPE).copy()
        images[3:5, ~SEEN] = np.nan  # of two channels: not seen in all
        return write_image(tmp_path / "a.fits", images, axes=AXES)

    @pytest.mark.usefixtures("no_pages")
    def test_shell(self, path, maps, tmp_path):
        words = ["--method", "gmca", "-p", "n_scales=3", "--keep-peaks", "-o", tmp_path / "c.fits"]
        run("clean", path, *words)
        found = read_cube(tmp_path / "c.fits")
        assert np.array_equal(found.image, SEEN)
        expected = clean(maps[:, SEEN.ravel()], SEEN, n_scales=3)
        assert np.array_equal(found.maps, expected.residual)

    def test_suggest(self, path):
        assert suggest(read_cube(path), "gmca", n_sources=range(2, 5), peaks=False).best == 3


@pytest.mark.parametrize("soft", [True, False])
@pytest.mark.parametrize("share", [0, 0.02, 0.5, 1])
@pytest.mark.parametrize("n", [1, 7, 1000, 1001])
def test_thresholds_are_those_of_numpy(rng, n, share, soft):
    values = rng.standard_normal(n) ** 3
    values[: n // 10] = 0
    sizes, after = np.abs(values), values.copy()
    limit = sparse(after, 3.0, share, soft=soft)
    floor = 3 * 1.4826 * np.median(sizes)
    above = np.sort(sizes[sizes > floor])
    n_kept = math.ceil(share * len(above))
    assert limit == (floor if n_kept == len(above) else above[len(above) - n_kept - 1])
    kept = sizes > limit
    assert np.count_nonzero(kept) == n_kept and not after[~kept].any()
    assert np.array_equal(after[kept], values[kept] - soft * np.sign(values[kept]) * limit)
    assert sparse(values, 2.0, 1.0, level=0.1, soft=soft) == 0.2


@pytest.mark.parametrize("decimals", [0, 9], ids=["with ties", "without"])
@pytest.mark.parametrize("n", [1, 2, 7, 1000, 1001])
def test_ranks_medians_and_deviations_are_those_of_numpy(rng, n, decimals):
    values = rng.standard_normal(n).round(decimals)
    assert median(values) == np.median(values)
    for rank in {0, n // 4, n // 2, n - 1}:
        assert ranked(values, rank) == np.sort(values)[rank]
    expected = np.median(np.abs(values - np.median(values))) / 0.6735
    assert deviation(values) == pytest.approx(expected, rel=1e-14)
    for refused, rank in ((values, n), (values, -1), (values.astype(np.float32), 0)):
        with pytest.raises(ValueError, match="rank|view"):
            ranked(refused, rank)
