"""The transforms: against healpy, and the properties any transform must have."""

import ctypes
import random

import healpy as hp
import numpy as np
import pytest

from himap.maps import sphere
from himap.removal import harmonic

NSIDE = 16
LMAX = 3 * NSIDE - 1


@pytest.fixture
def pixels(rng):
    return rng.standard_normal(12 * NSIDE**2)


@pytest.mark.parametrize(
    ("options", "theirs"), [({}, {"iter": 3}), ({"lmax": 32, "n_iter": 6}, {"lmax": 32, "iter": 6})]
)
def test_against_healpy(pixels, options, theirs):
    """Of the second map of a cube, so that the first does not matter to it."""
    ours = sphere.analyse(np.stack([pixels[::-1], pixels]), **options)
    theirs = hp.map2alm(pixels, **theirs)
    assert ours[1] == pytest.approx(theirs, abs=1e-12)
    assert sphere.synthesise(ours, NSIDE)[1] == pytest.approx(hp.alm2map(theirs, NSIDE), abs=1e-11)
    assert sphere.power_spectrum(ours)[1] == pytest.approx(hp.alm2cl(theirs), rel=1e-10)


@pytest.mark.parametrize("n_iter", [0, 3])
def test_maps_of_a_few_pixels(pixels, rng, n_iter):
    """Only the rings that hold them are transformed at first; in a refinement all."""
    few = rng.choice(len(pixels), 20, replace=False)
    field = np.zeros_like(pixels)
    field[few] = pixels[few]
    theirs = hp.map2alm(field, iter=n_iter)
    assert sphere.analyse(field, n_iter=n_iter, pixels=few) == pytest.approx(theirs, abs=1e-12)


def test_float32_in_float32_out(pixels):
    alm32 = sphere.analyse(pixels.astype(np.float32))
    assert alm32.dtype == np.complex64
    assert sphere.synthesise(alm32, NSIDE).dtype == np.float32
    assert alm32 == pytest.approx(sphere.analyse(pixels), abs=1e-6)


def test_gaussian_alm_has_its_spectrum(rng):
    cl = 1 / (1 + np.arange(101.0)) ** 2
    mean = np.mean([sphere.power_spectrum(sphere.gaussian_alm(cl, rng)) for _ in range(50)], axis=0)
    scatter = np.sqrt(2 / (2 * np.arange(101) + 1) / 50)
    assert np.abs(mean / cl - 1).max() < 5 * scatter.max()
    assert (np.abs(mean / cl - 1) < 4.5 * scatter).all()


def test_a_cube_keeps_faint_signals_under_bright_ones(pixels):
    """The one rounding is that of the result to float32: nothing of a signal of 5e-7 is lost before."""
    total = 0.05 * pixels + 1e5 * (2 + pixels[::-1])
    alm = sphere.multiply_beam(sphere.analyse(total), hp.gauss_beam(np.deg2rad(10), LMAX))
    exact = sphere.synthesise(alm, NSIDE)
    half_digit = 0.5 * float(np.spacing(np.float32(np.abs(exact).max())))
    (cube,) = sphere.synthesise_cube([alm], NSIDE, n_channels=1, label="")
    assert cube.dtype == np.float32 and cube == pytest.approx(exact, rel=0, abs=half_digit)


def test_coupling_matrix_is_that_of_every_mode_times_a_mask(rng):
    """Pseudo-C_l of fields of one l', one mode after the other, all of them band-limited."""
    lmax = 10
    mask = sphere.synthesise(sphere.gaussian_alm(np.ones(2 * lmax + 1), rng), NSIDE)
    fields = mask * sphere.synthesise(harmonic.from_modes(np.eye((lmax + 1) ** 2)), NSIDE)
    powers = sphere.power_spectrum(sphere.analyse(fields, 2 * NSIDE, n_iter=9))[:, : lmax + 1]
    expected = np.stack([block.sum(axis=1) for block in harmonic.blocks(powers.T)], axis=1)
    found = sphere.coupling_matrix(sphere.power_spectrum(sphere.analyse(mask, 2 * lmax, n_iter=9)), lmax)
    assert found == pytest.approx(expected, rel=1e-5)


def test_closely_analysed_maps_come_back(rng):
    """Near l = 3 nside the quadrature of `analyse` leaves percents, least squares next to nothing."""
    alm = sphere.gaussian_alm(1 / (1.0 + np.arange(LMAX + 1)) ** 2, rng)
    pixels = sphere.synthesise(alm, NSIDE)
    errors = [
        (pixels - sphere.synthesise(analysed, NSIDE)).std() / pixels.std()
        for analysed in (sphere.analyse_closely(pixels, LMAX, 1e-5), sphere.analyse(pixels))
    ]
    assert errors[0] < min(3e-3, 0.1 * errors[1])


def test_what_no_coefficients_hold_is_not_searched_for(rng):
    """Of white noise a part lies beyond l = 3 nside, as of the edges of masked patches."""
    white = rng.standard_normal(12 * NSIDE**2)
    assert np.array_equal(sphere.analyse_closely(white, LMAX, 1e-5), sphere.analyse(white))


class TestSameBits:
    """The same numbers give the same, wherever the scratch of the transforms lies in memory."""

    @pytest.fixture
    def shuffle(self):
        """Takes and frees blocks of memory, about as large as that scratch, in a new order every time."""
        library, held, order = ctypes.CDLL(None), [], random.Random(1)
        library.malloc.restype, library.malloc.argtypes = ctypes.c_void_p, [ctypes.c_size_t]
        library.free.argtypes = [ctypes.c_void_p]

        def shuffle(lmax):
            near = [8 * (lmax + n) for n in range(1, 6)] + [4 * lmax, 16, 48, 256, 1000]
            held.extend(library.malloc(order.choice(near)) for _ in range(40))
            order.shuffle(held)
            while len(held) > 60:
                library.free(held.pop())

        yield shuffle
        for block in held:
            library.free(block)

    def test_on_the_grid_and_on_healpix(self, rng, shuffle):
        lmax = 63  # shows it within 400 times
        alm = sphere.gaussian_alm(np.ones(lmax + 1), rng)
        expected = None
        for _ in range(400):
            shuffle(lmax)
            field, maps = sphere.synthesise_grid(alm), sphere.synthesise(alm, 32)
            results = field, maps, sphere.analyse_grid(field, lmax), sphere.analyse(maps, lmax, n_iter=1)
            expected = expected or results
            assert all(map(np.array_equal, results, expected))


class TestGrid:
    @pytest.mark.parametrize("lmax", [2, 31, 200])
    def test_exact(self, lmax, rng):
        alm = sphere.gaussian_alm(np.ones(lmax + 1), rng)
        assert sphere.analyse_grid(sphere.synthesise_grid(alm), lmax) == pytest.approx(alm, abs=1e-10)

    def test_same_field_as_on_healpix(self, rng):
        """The mean square of a field, by quadrature on the grid and from its spectrum."""
        alm = sphere.gaussian_alm(np.ones(LMAX + 1), rng)
        square = sphere.analyse_grid(sphere.synthesise_grid(alm) ** 2, LMAX)[0].real / np.sqrt(4 * np.pi)
        degree = np.arange(LMAX + 1)
        assert square == pytest.approx((2 * degree + 1) @ sphere.power_spectrum(alm) / (4 * np.pi), rel=0.02)
