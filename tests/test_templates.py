"""What template files may be, and what a change of resolution does to them."""

import os

import healpy as hp
import numpy as np
import pytest
from astropy.io import fits
from skies import bands, lognormal, spectrum

from himap.core.errors import InputError
from himap.maps import sphere
from himap.sky import small_scales
from himap.sky.galaxy import Galaxy

# Templates: made with healpy, so that nothing here reads what himap wrote.


def write(folder, name, pixels, **options):
    options = {"nest": False, "column_units": "K_RJ", "coord": "G", "dtype": np.float64} | options
    hp.write_map(folder / name, pixels, overwrite=True, **options)


@pytest.fixture
def folder(tmp_path):
    """A good set of templates: synchrotron 20 K, index -3 with waves, free-free 0.1 mK."""
    write(tmp_path, "synchrotron_408MHz.fits", 20 * lognormal(16))
    index = -3 + 0.1 * np.log(lognormal(8, 3))
    write(tmp_path, "synchrotron_beta.fits", index, column_units=None)
    write(tmp_path, "free_free_30GHz.fits", 1e-4 * lognormal(32, 2))
    return tmp_path


def components(folder, nside=16, seed=0, **options):
    galaxy = Galaxy(source="templates", template_dir=str(folder), **options)
    return galaxy.components(nside, np.random.default_rng(seed))


def test_templates_are_what_the_files_say(folder):
    sync, free = components(folder)
    assert (sync.name, sync.freq_ref, free.name, free.freq_ref) == ("synchrotron", 408, "free-free", 30_000)
    assert sync.amplitude == pytest.approx(20e3 * lognormal(16), rel=1e-12)
    assert free.amplitude == pytest.approx(0.1 * hp.ud_grade(lognormal(32, 2), 16), rel=1e-12)
    assert free.index == -2.14
    assert sync.index.shape == (3072,)
    assert hp.ud_grade(sync.index, 8) == pytest.approx(-3 + 0.1 * np.log(lognormal(8, 3)), abs=0.02)


def test_in_another_unit_and_order_of_pixels(folder):
    """What may be written of units, names and orders is tested with the files."""
    (folder / "synchrotron_408MHz.fits").unlink()
    pixels = 1e6 * hp.reorder(20 * lognormal(16), r2n=True)
    write(folder, "SYNCHROTRON_0.408GHz_nside16.fits", pixels, nest=True, column_units="uk (RJ)")
    sync, _ = components(folder)
    assert sync.freq_ref == pytest.approx(408)
    assert sync.amplitude == pytest.approx(20e3 * lognormal(16), rel=1e-12)


def with_pixel(value, count=1):
    pixels = 20 * lognormal(16)
    pixels[100 : 100 + count] = value
    return pixels


@pytest.mark.parametrize(
    ("name", "pixels", "options", "message"),
    [
        ("synchrotron_408MHz.fits", with_pixel(np.nan, 3), {}, "3 of 3072 pixels that are NaN"),
        ("synchrotron_408MHz.fits", with_pixel(np.inf), {}, "1 of 3072 pixels"),
        ("synchrotron_408MHz.fits", with_pixel(hp.UNSEEN, 2), {"dtype": np.float32}, "2 of 3072 pixels"),
        ("synchrotron_408MHz.fits", with_pixel(-1.0, 40), {}, "40 of 3072 pixels"),
        ("synchrotron_408MHz.fits", with_pixel(hp.UNSEEN, 9), {"partial": True}, "9 of 3072 pixels"),
        ("synchrotron_408MHz.fits", with_pixel(1.0), {"coord": "C"}, r"healpy.Rotator\(coord=\['C', 'G'\]\)"),
        ("synchrotron_beta.fits", np.full(768, 3.0), {}, "between -5 and 0 .* got 3 to 3"),
        ("synchrotron_beta.fits", with_pixel(-6.0), {}, "got -6 to "),
        ("synchrotron_beta.fits", np.full(768, np.nan), {}, "768 of 768"),
        ("free_free_30GHz.fits", lognormal(32, 2), {"column_units": "K_CMB"}, "out of K, .*K_CMB"),
        ("free_free_30GHz.fits", lognormal(32, 2), {"column_units": None}, "got no TUNIT1"),
    ],
)
def test_bad_maps_are_refused(folder, name, pixels, options, message):
    write(folder, name, pixels, **options)
    with pytest.raises(InputError, match=message) as caught:
        components(folder)
    assert name in str(caught.value)


def test_few_pixels_that_are_not_positive_are_raised(folder):
    write(folder, "synchrotron_408MHz.fits", with_pixel(0.0, 3))
    with pytest.warns(UserWarning, match="3 of 3072 pixels are zero or negative"):
        sync, _ = components(folder)
    rest = np.delete(sync.amplitude, [100, 101, 102])
    assert sync.amplitude[100:103] == pytest.approx(rest.min())


@pytest.mark.parametrize(
    ("removed", "added", "message"),
    [
        ("synchrotron_408MHz.fits", None, "0 files for the synchrotron intensity: none"),
        ("synchrotron_beta.fits", None, "0 files for the synchrotron index"),
        ("free_free_30GHz.fits", None, "0 files for the free-free intensity"),
        (None, "synchrotron_23GHz.fits", "2 files for the synchrotron intensity: synchrotron_23GHz.fits"),
        (None, "synchrotron_index.fits", "2 files for the synchrotron index"),
        ("synchrotron_408MHz.fits", "synchrotron_1p5GHz.fits", "synchrotron intensity: none"),
        ("synchrotron_408MHz.fits", "synchrotron_408MHz_to_1GHz.fits", "states 408 MHz, 1000 MHz"),
    ],
)
def test_one_file_of_each_is_needed(folder, removed, added, message):
    if removed:
        (folder / removed).unlink()
    if added:
        write(folder, added, lognormal(8))
    with pytest.raises(InputError, match=message):
        components(folder)


def test_digest_follows_contents_and_names(folder):
    galaxy = Galaxy(source="templates", template_dir=str(folder))
    first = galaxy.digest()
    assert first == galaxy.digest()
    (folder / "free_free_30GHz.fits").rename(folder / "free_free_31GHz.fits")
    second = galaxy.digest()
    write(folder, "synchrotron_408MHz.fits", 21 * lognormal(16))
    assert len({first, second, galaxy.digest()}) == 3
    assert Galaxy().digest() == ""


# Change of resolution


def dusty(nside=32):
    """Three decades, one bright pixel and one faint: what makes a plain upgrade ring."""
    pixels = lognormal(nside, width=1.2)
    pixels[1000] = 1e3
    pixels[2000] = 1e-6
    return pixels


def check_pixels(fine, coarse, nside):
    """A fine map is positive, and its means over coarse pixels are those of the coarse map."""
    assert fine.min() > 0
    wrong = np.abs(np.log(hp.ud_grade(fine, nside) / small_scales.raise_faint(coarse)))
    assert np.median(wrong) < 0.01
    assert np.percentile(wrong, 99) < 0.1


@pytest.mark.parametrize("structure", [False, True])
def test_upgrade_is_positive_and_keeps_the_pixels(rng, structure):
    pixels = dusty()
    assert hp.alm2map(hp.map2alm(pixels), 64).min() < 0  # what is to be avoided
    fine = small_scales.refine(pixels, 64, rng, small_scales=structure)
    check_pixels(fine, pixels, 32)
    assert fine.mean() == pytest.approx(pixels.mean(), rel=2e-3)
    assert np.count_nonzero(small_scales.raise_faint(pixels) != pixels) < 0.02 * len(pixels)


def test_upgrade_of_a_smooth_map_is_that_map(rng):
    """A band-limited log map is known between its pixels."""
    alm = sphere.gaussian_alm(np.where(np.arange(25) > 1, 1e-3, 0), rng)
    coarse, truth = (np.exp(sphere.synthesise(alm, nside)) for nside in (32, 64))
    upgraded = small_scales.refine(coarse, 64, rng, small_scales=False)
    # The corrections make pixel means of what were samples: a difference of second order in the pixel size.
    assert upgraded == pytest.approx(truth, rel=0.04)
    assert np.std(upgraded / truth) < 0.1 * np.std(truth)


def test_small_scales_continue_the_spectrum_and_leave_the_large_ones(rng):
    """The template has a log spectrum ~ l^-2.703 up to its end; small scales go on with it."""
    degree = np.arange(384)
    cl = 0.1 * np.maximum(degree, 1.0) ** -2.703 * (degree > 0)
    truth = np.exp(sphere.synthesise(sphere.gaussian_alm(cl, rng), 128))
    template = hp.ud_grade(truth, 32)
    smooth, rough = (
        np.log(small_scales.refine(template, 128, rng, small_scales=structure)) for structure in (False, True)
    )
    # The truth smoothed by a coarse pixel, which is what any upgrade of a template can know.
    low = slice(2, 33)
    assert spectrum(rough)[low] == pytest.approx(spectrum(smooth)[low], rel=0.05)
    end = slice(100, 300)  # well beyond 2 nside of the template
    ratio = np.exp(np.mean(np.log(spectrum(rough)[end] / cl[end])))
    assert 0.6 < ratio < 1.5
    assert np.exp(np.mean(np.log(spectrum(smooth)[end] / cl[end]))) < 0.3
    assert np.exp(rough).mean() == pytest.approx(template.mean(), rel=1e-3)


def test_small_scales_grow_less_than_the_intensity():
    """rms(dI) ~ I^0.782: the relative rms is I^-0.218."""
    coarse_z, z = (hp.pix2vec(nside, np.arange(12 * nside**2))[2] for nside in (32, 128))
    bright = np.where(coarse_z > 0, 100.0, 1.0) * lognormal(32, width=0.1)
    added = small_scales.add_structure(bright, 128, np.random.default_rng(3))
    ratio = added[z > 0.3].std() / added[z < -0.3].std()
    assert ratio == pytest.approx(100**-0.218, rel=0.08)


def test_small_scales_have_mean_one(rng):
    added = np.array([small_scales.add_structure(lognormal(16, width=2.0), 64, rng) for _ in range(16)])
    assert added.std() > 0.5  # without the variance, exp(added) would have a mean of 1.1 or more
    assert np.exp(added).mean() == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("level", [1.0, 3.0])  # the logarithm of the first is exactly 0
def test_flat_map_gets_no_structure(rng, level):
    assert small_scales.refine(np.full(768, level), 16, rng) == pytest.approx(level, rel=1e-4)


def test_components_of_templates_have_separate_streams(folder):
    """And none where they add no small scales."""
    first, other = components(folder, 64), components(folder, 64, 1)
    assert not np.array_equal(first[1].amplitude, other[1].amplitude)
    one, two = (components(folder, 64, seed, small_scales=False)[1].amplitude for seed in (0, 1))
    assert np.array_equal(one, two)
    write(folder, "synchrotron_408MHz.fits", 30 * lognormal(64, 7))  # needs no small scales, draws nothing
    second = components(folder, 64)
    assert not np.allclose(first[0].amplitude, second[0].amplitude)
    assert np.array_equal(first[1].amplitude, second[1].amplitude)


def test_index_stays_within_its_limits(folder):
    index = np.full(768, -3.0)
    index[300] = -2.5  # a step rings
    write(folder, "synchrotron_beta.fits", index, column_units=None)
    upgraded = components(folder, 64)[0].index
    assert upgraded.min() >= -3.0
    assert upgraded.max() <= -2.5


# The real templates


def test_real_templates(real_sky):
    sync, free = components(real_sky, 64)
    for component, name in ((sync, "synchrotron_408MHz_K_nside64"), (free, "freefree_30GHz_K_nside64")):
        kelvin = hp.read_map(real_sky / f"{name}.fits").astype(np.float64)
        assert component.amplitude == pytest.approx(1e3 * kelvin, rel=1e-7)
    assert sync.index == pytest.approx(hp.read_map(real_sky / "synchrotron_beta_nside64.fits"), rel=1e-7)
    assert np.median(bands(sync.amplitude)[5]) == pytest.approx(12e3, rel=0.05)


def test_small_scales_of_the_408_mhz_map_are_those_published(real_sky):
    """Remazeilles et al. (2015): rms 0.0599 I^0.782 with I in K, for structure below 56 arcmin."""
    amplitude = components(real_sky, 64)[0].amplitude
    added = small_scales.add_structure(amplitude, 256, np.random.default_rng(0))
    high = np.abs(hp.pix2ang(256, np.arange(12 * 256**2), lonlat=True)[1]) > 40
    assert 0.5 < added[high].std() / (0.0599 * 12 ** (0.782 - 1)) < 2


def test_what_the_header_says(folder):
    """The frequency, which may not contradict the name, and the order of pixels, which must be there."""
    path = folder / "synchrotron_408MHz.fits"
    fits.setval(path, "FREQ", value=4.08e8, ext=1)
    assert components(folder)[0].freq_ref == pytest.approx(408)
    fits.setval(path, "FREQ", value=1420.0, ext=1)
    with pytest.raises(InputError, match="408MHz.fits says 408 MHz, and FREQ in its header 1420"):
        components(folder)
    with fits.open(path, mode="update") as file:
        del file[1].header["ORDERING"]
    with pytest.raises(InputError, match="ORDERING"):
        components(folder)


def test_a_pipe_is_not_waited_for(folder):
    (folder / "synchrotron_408MHz.fits").unlink()
    os.mkfifo(folder / "synchrotron_408MHz.fits")
    galaxy = Galaxy(source="templates", template_dir=str(folder))
    for read in (galaxy.digest, lambda: components(folder)):
        with pytest.raises(InputError, match="must be a file that is on disk, got a pipe or a device"):
            read()
