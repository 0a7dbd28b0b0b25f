"""Starlets in the plane: a slow twin, pixel by pixel, and what any decomposition must do."""

import numpy as np
import pytest
from scipy import ndimage

from himap.core.errors import InputError
from himap.maps.starlets import PlaneStarlets

SHAPE = 19, 26
KERNEL = np.outer(*[np.array([1, 4, 6, 4, 1]) / 16] * 2)


@pytest.fixture
def seen(rng):
    """Three quarters of the pixels, a corner and a column of none among the others."""
    seen = rng.random(SHAPE) < 0.75
    seen[:6, :7] = seen[:, 11] = False
    return seen


def plain_smooth(image, seen, step):
    """The mean of an image (n_y, n_x) over the seen pixels under the dilated kernel, a pixel at a time."""
    out = np.zeros(image.shape)
    for y, x in np.argwhere(seen):
        total = weights = 0.0
        for (row, column), weight in np.ndenumerate(KERNEL):
            there = y + (row - 2) * step, x + (column - 2) * step
            inside = all(0 <= place < length for place, length in zip(there, image.shape, strict=True))
            if inside and seen[there]:
                total, weights = total + weight * image[there], weights + weight
        out[y, x] = total / weights
    return out


def plain_scales(line, seen, n_scales):
    """`PlaneStarlets.scales` of one map (n_pix,)."""
    smooth, scales = np.full(seen.shape, np.nan), []
    smooth[seen] = line
    for scale in range(n_scales):
        finer, smooth = smooth, plain_smooth(smooth, seen, 2**scale)
        scales.append((finer - smooth)[seen])
    return np.array([*scales, smooth[seen]])


def test_equals_its_plain_twin(seen, rng):
    maps = rng.standard_normal((2, np.count_nonzero(seen)))
    ours = PlaneStarlets(seen, 4).scales(maps)
    assert ours.shape == (5, *maps.shape)
    for n, line in enumerate(maps):
        assert ours[:, n] == pytest.approx(plain_scales(line, seen, 4), abs=1e-12)


def test_away_from_edges_is_the_textbook_convolution(rng):
    image, dilated = rng.standard_normal((40, 44)), np.zeros((9, 9))
    dilated[::2, ::2] = KERNEL
    once = ndimage.convolve(image, KERNEL)
    twice = ndimage.convolve(once, dilated)
    ours = PlaneStarlets(np.ones(image.shape, dtype=bool), 2).scales(image.reshape(1, -1))
    inner = (slice(6, -6),) * 2
    for scale, expected in zip(ours, (image - once, once - twice, twice), strict=True):
        assert scale.reshape(image.shape)[inner] == pytest.approx(expected[inner], abs=1e-12)


def test_scales_add_up_to_the_image(seen, rng):
    maps = 1e5 * rng.standard_normal((3, np.count_nonzero(seen)))
    starlets = PlaneStarlets(seen, 5)
    assert starlets.scales(maps).sum(axis=0) == pytest.approx(maps, rel=1e-12, abs=1e-9)
    assert np.array_equal(starlets.details(maps), starlets.scales(maps)[:-1])


def test_a_constant_has_no_details_wherever_the_edge(seen):
    maps = np.full((1, np.count_nonzero(seen)), 7.0)
    assert np.abs(PlaneStarlets(seen, 5).details(maps)).max() < 1e-13


def test_details_adjoint_is_the_transpose(seen, rng):
    n_pix = np.count_nonzero(seen)
    starlets = PlaneStarlets(seen, 4)
    matrix = starlets.details(np.eye(n_pix))  # (n_scales, column, row)
    scales = rng.standard_normal((4, 2, n_pix))
    expected = np.einsum("jcr,jmr->mc", matrix, scales)
    assert starlets.details_adjoint(scales) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(("shape", "most"), [((16, 3), 4), ((17, 3), 5), ((2, 2), 1)])
def test_scales_that_would_be_empty_are_refused(shape, most, rng):
    image = np.ones(shape, dtype=bool)
    coarsest = PlaneStarlets(image, most).details(rng.standard_normal((1, image.size)))[-1]
    assert np.abs(coarsest).max() > 0.01
    with pytest.raises(InputError, match=f"n_scales must be at most {most} for an image of .*{shape[0]}"):
        PlaneStarlets(image, most + 1)
