"""GMCA on images in the plane: the same iteration on other starlets, of the seen pixels alone."""

import numpy as np
import pytest
from cube_files import himap
from gmca_twin import mixing_error, plain_gmca, similarity
from image_files import SKY, write_image
from scipy import ndimage

from himap.core.errors import InputError
from himap.cubes import clean_cube, read_cube, suggest
from himap.maps.starlets import PlaneStarlets
from himap.removal.base import SeparationWarning
from himap.removal.gmca import GMCA
from himap.removal.gnilc import GNILC
from himap.removal.pca import PCA

N_CHANNELS = 8
FREQS = 980 + 60.0 * np.arange(N_CHANNELS)
SHAPE = 96, 80
AXES = (*SKY["SIN"], ("FREQ", 980e6, 1.0, 60e6, "Hz"))
MIXING = (FREQS / 1000)[:, None] ** np.array([-2.8, -1.0, 1.5])
MIXING /= np.linalg.norm(MIXING, axis=0)


@pytest.fixture
def sources(rng):
    """Three images of a few round blobs each, of one width per source: sparse in starlets; mK."""
    images = []
    for width, n_blobs in ((1.0, 150), (1.4, 100), (1.9, 75)):
        spikes = np.zeros(SHAPE)
        spikes.flat[rng.choice(spikes.size, n_blobs, replace=False)] = rng.standard_normal(n_blobs)
        blobs = ndimage.gaussian_filter(spikes, width, mode="constant")
        images.append(1e3 * blobs.ravel() / blobs.std())
    return np.array(images)


@pytest.fixture
def maps(sources, rng):
    return (MIXING @ sources + 0.1 * rng.standard_normal((N_CHANNELS, sources.shape[1]))).astype(np.float32)


@pytest.fixture
def seen():
    """All but a disc in the middle, a corner and two rows."""
    y, x = np.indices(SHAPE)
    seen = np.hypot(y - 50, x - 30) > 12
    seen[:15, :20] = seen[75:77] = False
    return seen


def clean(maps, image, **options):
    parameters = options.pop("parameters", {})
    return GMCA(**parameters).clean(maps, freqs=FREQS, image=image, **options)


@pytest.mark.parametrize(("penalty", "all_seen"), [("l1", True), ("l0", True), ("l1", False)])
def test_recovers_sparse_sources(maps, sources, seen, penalty, all_seen):
    """Of all pixels, or from those that are seen; PCA does not."""
    image = seen | all_seen
    maps, sources = maps[:, image.ravel()], sources[:, image.ravel()]
    found = clean(maps, image, parameters={"penalty": penalty}).separation
    assert found.converged
    assert mixing_error(found.mixing, MIXING) < 0.03
    assert similarity(sources, found.sources).min() > 0.99
    assert similarity(sources, PCA(n_sources=3).clean(maps, freqs=FREQS).separation.sources).min() < 0.9


@pytest.mark.parametrize("penalty", ["l1", "l0"])
def test_equals_its_plain_twin(maps, seen, penalty):
    rows = slice(4, 20), slice(6, 26)
    image = seen[rows]
    part = maps.reshape(-1, *SHAPE)[:, *rows][:, image]
    centred = (part - part.mean(axis=1, dtype=float)[:, None]).astype(np.float32)
    phi = PlaneStarlets(image, 2).details(np.eye(image.sum())).transpose(0, 2, 1)
    twin = plain_gmca(centred.astype(float), 2, phi, 6, 8, penalty == "l1")
    short = {"n_sources": 2, "n_scales": 2, "penalty": penalty, "n_falling": 8, "max_iterations": 6}
    with pytest.warns(SeparationWarning):
        ours = clean(part, image, parameters=short).separation.mixing
    assert np.abs(ours @ np.linalg.pinv(ours) - twin @ np.linalg.pinv(twin)).max() < 1e-9
    assert np.abs(twin.T @ ours).max(axis=0) == pytest.approx(1, abs=1e-12)


def test_a_mask_of_an_image_is_the_image_of_what_it_keeps(maps, seen):
    """Whatever lies outside; and both together, of pixels that the maps have no more."""
    kept, everywhere = seen.ravel(), np.ones(SHAPE, dtype=bool)
    expected = clean(maps[:, kept], seen)
    masked = clean(np.where(kept, maps, np.nan), everywhere, mask=kept)
    assert np.array_equal(masked.residual[:, kept], expected.residual)
    assert not masked.residual[:, ~kept].any() and not masked.separation.sources[:, ~kept].any()
    left = np.indices(SHAPE)[1] < 60
    both = clean(maps[:, left.ravel()], left, mask=seen[left])
    assert np.array_equal(
        both.residual[:, seen[left]], clean(maps[:, (seen & left).ravel()], seen & left).residual
    )


def test_bad_images(maps):
    whole = np.ones(SHAPE, dtype=bool)
    for image in (whole[1:], whole.ravel(), whole.astype(int), whole[None]):
        with pytest.raises(InputError, match=r"image must be \(n_y, n_x\) bool, True at the 7680 pixels"):
            clean(maps, image)
    with pytest.raises(InputError, match="n_scales must be at most 7 for an image of"):
        clean(maps, whole, parameters={"n_scales": 8})
    with pytest.raises(InputError, match="gnilc looks at the sphere, by multipoles; image= must be left out"):
        GNILC().clean(maps, freqs=FREQS, image=whole)


class TestFiles:
    @pytest.fixture
    def path(self, maps, seen, tmp_path):
        images = maps.reshape(-1, *SHAPE).copy()
        images[3:5, ~seen] = np.nan  # of two channels: not seen in all
        return write_image(tmp_path / "a.fits", images, axes=AXES)

    def test_clean_cube(self, path, maps, seen):
        cleaned = clean_cube(read_cube(path), "gmca", peaks=False)
        expected = clean(maps[:, seen.ravel()], seen)
        assert np.array_equal(cleaned.residual, expected.residual)
        assert np.array_equal(cleaned.separation.sources, expected.separation.sources)

    def test_shell(self, path, maps, seen, tmp_path):
        words = ["--method", "gmca", "-p", "n_scales=3", "--keep-peaks", "-o", tmp_path / "c.fits"]
        done = himap("clean", path, *words)
        assert done.exit_code == 0, done.output
        found = read_cube(tmp_path / "c.fits")
        assert np.array_equal(found.image, seen)
        expected = clean(maps[:, seen.ravel()], seen, parameters={"n_scales": 3})
        assert np.array_equal(found.maps, expected.residual)

    def test_suggest(self, path):
        assert suggest(read_cube(path), "gmca", n_sources=range(2, 5), peaks=False).best == 3

    def test_weights_and_beams_are_refused(self, path, tmp_path):
        for words, said in (
            (["--beam", "evolving"], "is an image in the plane"),
            (["--flags", path], "no weights"),
        ):
            done = himap("clean", path, "--method", "gmca", *words, "-o", tmp_path / "c.fits")
            assert done.exit_code == 2 and said in done.output, words
