"""The HI light cone against theory: closed forms in the box, projected spectra on the sky."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from scipy import fft
from scipy.special import spherical_jn

from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.maps import sphere
from himap.sky import box, hi, light_cone
from himap.sky.box import GaussianBox
from himap.sky.cosmology import Cosmology, HIModel, redshift

NARROW = Survey(nside=32, n_channels=4, freq_min=940, freq_max=960, box_cells=128, seed=7)


# Fluctuations a tenth of the real ones: linear theory holds to the per cent, so a wrong factor shows.
LINEAR = HIModel(cosmology=Cosmology(sigma_8=0.1))


@cache
def band_maps(rsd=True, seed=7, **options):
    survey = replace(NARROW, seed=seed)
    return hi.hi_maps(survey, survey.rng("hi"), rsd=rsd, **options)


def linear_spectrum(survey, channel, degrees, rsd, model=LINEAR):
    """C_l of one channel in linear theory, mK^2, projected without approximation.

    Times the windows of interpolation in the box and of a square pixel, to second order in l.

    C_l = 2/pi int k^2 P(k) [D int dchi W (b j_l - f j_l'')]^2 dk
    """
    cosmology = model.cosmology
    far, near = cosmology.comoving_distance(redshift(survey.freq_edges[channel : channel + 2]))
    nodes, weights = np.polynomial.legendre.leggauss(6)
    chi = 0.5 * (far + near) + 0.5 * (far - near) * nodes
    z = cosmology.redshift_at(chi)
    cell = survey.box_size / survey.box_cells
    k = np.geomspace(1e-4, np.pi / cell, 3000)
    growth, bias = cosmology.growth(z.mean()), model.bias(z.mean())
    window = np.sinc(k * cell / (2 * np.pi * np.sqrt(3))) ** 6  # of one interpolation, isotropic
    rate = cosmology.growth_rate(z.mean()) if rsd else 0.0
    cl = []
    for degree in degrees:
        x = k[:, None] * chi
        bessel = spherical_jn(degree, x)
        second = (degree * (degree - 1) / x**2 - 1) * bessel + 2 / x * spherical_jn(degree + 1, x)
        kernel = (bias * bessel - rate * second) @ weights / 2
        integrand = k**2 * cosmology.linear_power(k) * (window * growth * kernel) ** 2
        cl.append(2 / np.pi * np.trapezoid(integrand, k))
    pixel = 1 - degrees * (degrees + 1) * 4 * np.pi / survey.n_pix / 24
    return np.array(cl) * (pixel * model.mean_temperature(z.mean())) ** 2


def band_power(maps, degrees):
    cl = sphere.power_spectrum(sphere.analyse(maps.astype(float)))[:, degrees]
    return ((2 * degrees + 1) * cl).sum(axis=-1)


def gaussian_box(power, n, size, seed=3, **options):
    return GaussianBox(power, n, size, np.random.default_rng(seed), **options)


def length(along):
    """Of vectors with these components along each axis, (n, n, n)."""
    return np.sqrt(along[:, None, None] ** 2 + along[:, None] ** 2 + along**2)


def wave_numbers(n, size):
    """|k| of all modes of a box."""
    return length(2 * np.pi / size * np.fft.fftfreq(n, 1 / n))


def test_modes_have_the_requested_spectrum():
    cosmology = Cosmology()
    n, size = 64, 3000.0
    box = gaussian_box(cosmology.linear_power, n, size)
    variances = []
    field = box.density(lambda i, plane, variance: variances.append(variance) or plane)
    power = np.abs(fft.fftn(field.astype(float))) ** 2 * size**3 / n**6
    k = wave_numbers(n, size)
    shell = (k > 0.02) & (k < 0.06)
    ratio = power[shell] / cosmology.linear_power(k[shell])
    assert ratio.mean() == pytest.approx(1, abs=4 * np.sqrt(2 / shell.sum()))
    assert variances == pytest.approx(np.full(n, field.var(dtype=float)), rel=1e-5)


def test_displacement_of_plane_waves():
    """cos(q x) moves matter by -sin(q x) / q along x, sin(q x) by cos(q x) / q; here on the line of sight."""
    n, size = 32, 600.0
    q = 2 * np.pi / size

    def longest(k):
        return np.where((k > 0.5 * q) & (k < 1.2 * q), 1e6, 0.0)

    moved = gaussian_box(longest, n, size).radial_displacement(lambda i: 2.0)
    field = gaussian_box(longest, n, size).density().astype(float)
    x, expected = box.cell_centres(n, size), 0
    for along in np.meshgrid(x, x, x, indexing="ij"):
        cosine, sine = (2 * np.mean(field * wave(q * along)) for wave in (np.cos, np.sin))
        expected = expected + (cosine * -np.sin(q * along) + sine * np.cos(q * along)) / q * along
    assert moved == pytest.approx(2 * expected / length(x), rel=1e-3, abs=1e-3)


def test_a_larger_box_has_the_modes_of_the_nested_one(monkeypatch):
    """Where both have them, the same function of place, with the observer at the centre of both."""
    monkeypatch.setattr(box, "NESTED_CELLS", 16)
    size, power = 600.0, Cosmology().linear_power
    for n in (32, 40):
        fields = [fft.fftn(gaussian_box(power, cells, size).density().astype(float)) for cells in (16, n)]
        modes = []
        for field in fields:
            cells = len(field)
            m = np.fft.fftfreq(cells, 1 / cells)
            turn = np.exp(-1j * np.pi * m / cells)  # from the first cell centre to the edge of the box
            modes.append(field * turn[:, None, None] * turn[:, None] * turn / cells**3)
        inside = np.r_[0:8, -7:0]
        one, other = (mode[np.ix_(inside, inside, inside)] for mode in modes)
        assert np.abs(other - one).max() < 1e-5 * np.abs(one).max()
        k = wave_numbers(n, size)
        beyond = (k > 2 * np.pi / size * 14) & (k < np.pi * n / size)
        ratio = np.abs(modes[1][beyond]) ** 2 * size**3 / power(k[beyond])
        assert ratio.mean() == pytest.approx(1, abs=4 * np.sqrt(2 / beyond.sum()))


@pytest.mark.parametrize("nested", [16, 1024])
def test_a_box_in_files_is_that_in_memory(tmp_path, monkeypatch, nested):
    monkeypatch.setattr(box, "NESTED_CELLS", nested)
    monkeypatch.setattr(box, "_BLOCK_IN_FILES", 10_000)  # several blocks of columns
    survey = replace(NARROW, box_cells=32, nside=8)
    maps, others = (hi.hi_maps(survey, survey.rng("hi"), folder=folder) for folder in (None, tmp_path))
    assert others == pytest.approx(maps, rel=1e-5)
    n_bytes = sum(file.stat().st_size for file in tmp_path.iterdir())
    assert n_bytes == pytest.approx(box.file_bytes(32), rel=0.1)


@pytest.mark.parametrize("array", ["displacement", "density"])
def test_a_box_in_files_goes_on_where_it_was_interrupted(tmp_path, monkeypatch, array):
    """Nothing that is complete is made again, and what is not is made anew."""
    survey = replace(NARROW, box_cells=32, nside=8)
    make = partial(hi.lognormal_box, 32, survey.box_size, folder=tmp_path)
    expected = [np.array(part) for part in make(survey.rng("hi"))]
    (tmp_path / "density.complete").unlink()
    (tmp_path / f"{array}.complete").unlink(missing_ok=True)
    (tmp_path / array).write_bytes(b"cut")
    passes = []
    monkeypatch.setattr(box, "progress", lambda planes, label, total: passes.append(label) or planes)
    assert all(map(np.array_equal, make(survey.rng("hi")), expected))
    assert len(passes) == (3 if array == "displacement" else 1)
    assert all(map(np.array_equal, make(survey.rng("hi")), expected))
    assert len(passes) == (3 if array == "displacement" else 1)


def test_displacements_of_a_large_box_are_whole_numbers_of_a_unit(monkeypatch):
    """So fine that maps are those of displacements in Mpc/h."""
    monkeypatch.setattr(box, "NESTED_CELLS", 16)
    survey = replace(NARROW, box_cells=32, nside=8)
    density, moved = hi.lognormal_box(32, survey.box_size, survey.rng("hi"))
    assert moved.dtype == np.int16 and moved.std() > 1000
    maps = hi.hi_maps(survey, survey.rng("hi"))
    in_mpc = (moved * box.unit_of(moved)).astype(np.float32)
    monkeypatch.setattr(hi, "lognormal_box", lambda *args, **options: (density, in_mpc))
    assert hi.hi_maps(survey, survey.rng("hi")) == pytest.approx(maps, rel=1e-5)


def test_a_displacement_that_has_no_room(monkeypatch):
    monkeypatch.setattr(box, "NESTED_CELLS", 8)
    with pytest.raises(InputError, match="displaced by .* up to 64: take fewer"):
        gaussian_box(lambda k: 1e7 + 0 * k, 16, 600.0).radial_displacement(lambda i: 1.0)


@pytest.mark.parametrize("r_smooth", [10.0, 30.0])
def test_smoothing_of_the_density_against_closed_forms(r_smooth):
    """delta_G loses exp(-k^2 r^2 / 2) of every mode, its variance is sum_k P(k) exp(-k^2 r^2) / L^3."""
    n, size, model = 64, 1000.0, HIModel(cosmology=Cosmology(sigma_8=0.01))  # where exp(x) is 1 + x
    (density, moved), (smooth, less_moved) = (
        hi.lognormal_box(n, size, np.random.default_rng(3), model=model, r_smooth=r) for r in (0.0, r_smooth)
    )
    z, k = model.cosmology.redshift_at(length(box.cell_centres(n, size))), wave_numbers(n, size)
    amplitude = model.bias(z) * model.cosmology.growth(z)
    before, after = (fft.fftn(np.log(one.astype(float)) / amplitude) / n**3 for one in (density, smooth))
    power = model.cosmology.linear_power(k) * np.exp(-((k * r_smooth) ** 2)) / size**3
    measured = np.sum(np.abs(after[k > 0]) ** 2)
    assert measured == pytest.approx(power.sum(), rel=5 * np.sqrt(2 * np.sum(power**2)) / power.sum())
    seen = (k > 0) & (k * r_smooth < 2)
    assert after[seen] / before[seen] == pytest.approx(np.exp(-0.5 * (k[seen] * r_smooth) ** 2), abs=0.03)
    # Along a line an isotropic displacement has a third of the variance of the density over k^2.
    weight = 1 / k[k > 0] ** 2
    expected = np.sqrt(weight @ power[k > 0] * size**3 / (weight @ model.cosmology.linear_power(k[k > 0])))
    assert less_moved.std() / moved.std() == pytest.approx(expected, rel=0.03)


def test_a_bias_of_the_density_contrast():
    """1 + delta = 1 + b (rho - 1), with rho that of matter; its mean is 1 and voids may be negative."""
    n, size = 32, 3000.0

    class Unbiased(HIModel):
        def bias(self, z):
            return np.ones_like(z)

    matter, _ = hi.lognormal_box(n, size, np.random.default_rng(5), model=Unbiased(), rsd=False)
    found, _ = hi.lognormal_box(n, size, np.random.default_rng(5), hi_bias="contrast", rsd=False)
    z = HIModel().cosmology.redshift_at(length(box.cell_centres(n, size)))
    assert found == pytest.approx(1 + HIModel().bias(z) * (matter - 1), abs=2e-4)
    assert not np.allclose(found, matter, rtol=0.02)
    surveys = (replace(NARROW, box_cells=32, nside=8, hi_bias=bias) for bias in ("exponential", "contrast"))
    usual, other = (hi.hi_maps(survey, survey.rng("hi"), rsd=False) for survey in surveys)
    assert np.corrcoef(usual[0], other[0])[0, 1] > 0.9 and not np.allclose(usual, other, rtol=1e-3)


def test_maps_are_smoothed_as_the_survey_says():
    surveys = (replace(NARROW, box_cells=32, nside=8, r_smooth=r_smooth) for r_smooth in (0.0, 100.0))
    plain, smooth = (hi.hi_maps(survey, survey.rng("hi"), rsd=False) for survey in surveys)
    assert smooth.std() < 0.7 * plain.std()
    assert np.corrcoef(plain[0], smooth[0])[0, 1] > 0.5


def test_growth_and_bias_along_the_light_cone():
    """The logarithm of the density is b(z) D(z) times one Gaussian field, shell by shell."""
    n, size = 64, 3000.0
    model = HIModel()
    density, _ = hi.lognormal_box(n, size, np.random.default_rng(5), rsd=False)
    gaussian = gaussian_box(model.cosmology.linear_power, n, size, seed=5).density()
    r = length(box.cell_centres(n, size))
    for near, far in ((300, 400), (1300, 1400)):
        shell = (r > near) & (r < far)
        slope = np.polyfit(gaussian[shell], np.log(density[shell]), 1)[0]
        z = model.cosmology.redshift_at(r[shell])
        assert slope == pytest.approx((model.bias(z) * model.cosmology.growth(z)).mean(), rel=1e-2)


def test_channels_are_in_the_order_of_frequency():
    """The lower half of a band is the same whether observed alone or with the rest."""
    half = replace(NARROW, n_channels=2, freq_max=950)
    maps = hi.hi_maps(half, half.rng("hi"))
    assert maps == pytest.approx(band_maps()[:2], rel=0.1, abs=0.01)
    correlation = np.corrcoef(maps[0], band_maps()[0])[0, 1]
    assert correlation > 0.999


def test_rays_see_the_cells_they_pass():
    """A density that rises along x, seen along x: the observer is at the centre, not half a cell off."""
    n, size = 32, 3200.0
    x = box.cell_centres(n, size).astype(np.float32)
    ramp = np.broadcast_to((x[:, None, None] + 2000) / 1000, (n, n, n)).astype(np.float32).copy()
    edges = np.array([500.0, 510, 1000, 1010])
    maps = light_cone.trace(ramp, None, edges, 8, size)
    direction = np.empty((768, 3))
    direction[sphere.nest_to_ring(8)] = sphere.pixel_vectors(8, nest=True)
    for channel, distance in ((0, 505), (2, 1005)):
        expected = (distance * direction[:, 0] + 2000) / 1000
        # Half a cell would be 0.05; the centre of gravity of a pixel's rays is not quite its centre.
        assert maps[channel] == pytest.approx(expected, abs=0.02)


def test_the_box_is_periodic_and_a_uniform_medium_stays_so():
    """A ray that leaves the box through a face sees the cell at the opposite one."""
    field, ones, edges = np.zeros((16, 16, 16), np.float32), np.ones((16, 16, 16), np.float32), [845.0, 855]
    field[0] = 1
    maps = light_cone.trace(field, None, edges, 8, 1600.0)
    assert maps[0, sphere.pixel_at(8, 0.0, 0.0)] > 0.8
    assert light_cone.trace(ones, None, edges, 8, 1600.0) == pytest.approx(1, rel=1e-5)


def test_trace_shifts_matter_by_the_displacement():
    """Matter displaced by exactly one channel shows up one channel further out, with all its mass."""
    n, size = 128, 1280.0
    r = length(box.cell_centres(n, size))
    shell = np.exp(-((r - 425) ** 2) / (2 * 15.0**2)).astype(np.float32)
    edges = np.arange(300, 600, 25.0)
    still = light_cone.trace(shell, None, edges, 8, size)
    moved = light_cone.trace(shell, np.full_like(shell, 25), edges, 8, size)
    assert moved[1:] == pytest.approx(still[:-1], abs=2e-3)
    assert moved.sum() == pytest.approx(still.sum(), rel=1e-4)


def test_mean_temperature_of_maps_and_against_the_textbook_constant():
    """T = 189 h Omega_HI (1 + z)^2 / E(z) mK, to the per cent its constants vary by in the literature."""
    maps, model = band_maps(), HIModel()
    assert maps.dtype == np.float32 and maps.min() >= 0
    expected = model.mean_temperature(redshift(NARROW.freqs))
    assert maps.mean(axis=1) == pytest.approx(expected, rel=0.03)
    z = np.array([0.0, 0.3, 0.6])
    textbook = 189 * 0.67 * model.omega(z) * (1 + z) ** 2 / np.sqrt(0.3 * (1 + z) ** 3 + 0.7)
    assert model.mean_temperature(z) == pytest.approx(textbook, rel=0.01)


@pytest.mark.parametrize("rsd", [False, True])
def test_angular_spectrum_against_linear_theory(rsd):
    """Band power of 10 <= l <= 40 in four seeds, within 4 sigma of their sample variance."""
    degrees = np.arange(10, 41)
    expected = ((2 * degrees + 1) * linear_spectrum(NARROW, 1, degrees, rsd)).sum()
    seeds = [3, 4, 5, 6]
    measured = np.mean([band_power(band_maps(rsd, seed, model=LINEAR), degrees)[1] for seed in seeds])
    n_modes = (2 * degrees + 1).sum() * len(seeds)
    assert measured / expected == pytest.approx(1, abs=4 * np.sqrt(2 / n_modes))


def test_redshift_space_boost_against_linear_theory():
    """Same seed with and without redshift space: the sample variance cancels."""
    degrees = np.arange(10, 41)
    moved, still = (band_power(band_maps(rsd, model=LINEAR), degrees) for rsd in (True, False))
    expected = np.divide(
        *((2 * degrees + 1) @ linear_spectrum(NARROW, 1, degrees, rsd) for rsd in (True, False))
    )
    assert (moved / still).mean() == pytest.approx(expected, rel=0.03)
    assert expected > 1.2


def test_result_does_not_depend_on_the_sampling():
    coarse, fine = band_maps(), band_maps(oversample=4.0)
    assert (coarse - fine).std() < 0.03 * fine.std()
    degrees = np.arange(2, 64)
    assert band_power(coarse, degrees) == pytest.approx(band_power(fine, degrees), rel=0.015)


def test_same_seed_same_maps_whatever_the_threads():
    import numba

    threads = numba.get_num_threads()
    first = band_maps()
    numba.set_num_threads(1)
    try:
        assert np.array_equal(first, band_maps.__wrapped__())
    finally:
        numba.set_num_threads(threads)
    assert not np.array_equal(first, band_maps(seed=8))
