"""Draws of the foreground: the posterior of known covariances, and the power of what few spectra leave."""

from dataclasses import replace

import numpy as np
import pytest
from smooth_problem import BEAMS, FREQS, LMAX, NSIDE, check_mean, hi_covariance, make_sky

from himap.maps import sphere
from himap.removal import harmonic
from himap.removal.analysis import CubeModes
from himap.removal.data import Data
from himap.removal.separation import Separation
from himap.removal.smooth_posterior import SmoothForeground, foreground_given, products_of
from himap.removal.smooth_spectra import FilteredSeparation, multipole_bands, smooth_basis
from himap.removal.spectral_filter import filtered

ENDS = BEAMS[:, : LMAX + 1]
EDGES = multipole_bands(LMAX)


@pytest.fixture(scope="module")
def products():
    rng = np.random.default_rng(3)
    return products_of((make_sky(rng).hi for _ in range(12)), LMAX)


def data_of(maps):
    return Data.of(maps, freqs=FREQS, beams=ENDS)


def power(cube, low, high):
    """In multipoles from `low` to `high`, summed over channels, mK^2."""
    cl = sphere.power_spectrum(sphere.analyse(np.asarray(cube, dtype=float), LMAX)).sum(axis=0)
    return np.sum((2 * np.arange(low, high + 1) + 1) * cl[low : high + 1])


def test_products_are_those_of_the_field(products):
    for (first, last), product in zip(EDGES, products, strict=True):
        beams = BEAMS[:, (first + last + 1) // 2]
        expected = hi_covariance() * np.outer(beams, beams)
        _, vectors = np.linalg.eigh(expected)
        ratios = np.diag(vectors.T @ product @ vectors) / np.diag(vectors.T @ expected @ vectors)
        assert ratios.mean() == pytest.approx(1, abs=0.05)
        assert ratios == pytest.approx(np.ones(len(FREQS)), abs=5 * np.sqrt(2 / 12 / (2 * first + 6)))


def test_the_mean_is_that_of_the_foreground_given_the_data(products):
    data = data_of(make_sky(np.random.default_rng(8)).maps)
    check_mean(foreground_given(data, products)._filter(data))


@pytest.mark.parametrize(("brightness", "close"), [(50, 0.012), (300, 0.012), (3e3, 0.1)])
def test_draws_have_the_power_that_few_spectra_leave(products, brightness, close):
    """Of what two spectra leave, from 0.003 to 100 times HI, relative to HI."""
    rng = np.random.default_rng(11)
    errors = []
    for _ in range(6):
        sky = make_sky(rng, brightness=brightness)
        data = data_of(sky.maps)
        drawn = foreground_given(data, products).draw(data, rng).foreground.cube()
        first = np.linalg.svd(sky.foreground, full_matrices=False)[0][:, :2]
        pairs = [one - first @ (first.T @ one) for one in (drawn, sky.foreground)]
        bands = (5, 9), (10, 19), (20, LMAX)
        errors.append(
            [(power(pairs[0], *band) - power(pairs[1], *band)) / power(sky.truth, *band) for band in bands]
        )
    assert np.mean(errors, axis=0) == pytest.approx(np.zeros(3), abs=close)


def test_mocks_need_not_have_the_power_of_the_data(products):
    """Of HI and noise, in any band: only how it depends on k."""
    data = data_of(make_sky(np.random.default_rng(8), brightness=100).maps)
    factors = np.linspace(0.5, 2, len(products))[:, None, None]
    usual, other = (
        foreground_given(data, some).draw(data, np.random.default_rng(1)).foreground.cube()
        for some in (products, factors * products)
    )
    assert other == pytest.approx(usual, abs=1e-5 * float(usual.std()))


def certain(rng):
    """`SmoothForeground` of certain covariance, its `Data`, and its smooth functions, (n_channels, 6).

    Sources as bright as noise, and of a quarter.
    """
    basis, variances = smooth_basis(FREQS, 6), np.array([1, 0.25, *np.zeros(4)])
    shape = (len(basis), (3 * NSIDE) ** 2)
    alms = basis @ (np.sqrt(variances)[:, None] * rng.standard_normal((6, shape[1])))
    alms += rng.standard_normal(shape)
    alms[:, 0] = 0
    maps = sphere.synthesise(harmonic.from_modes(alms), NSIDE)
    data = Data.of(maps, freqs=FREQS, beams=np.ones((len(basis), 3 * NSIDE)))
    n_bands = len(multipole_bands(3 * NSIDE - 1))
    known = SmoothForeground(
        faint=np.array([np.eye(len(basis))] * n_bands),
        roots=np.array([np.eye(6)] * n_bands),
        axes=[np.diag(np.sqrt(variances))] * n_bands,
        n_modes=(10**9,) * n_bands,
        n_exact=n_bands,
        products=np.array([np.eye(len(basis))] * n_bands),
        n_mocks=1,
    )
    return known, data, basis


def mean_of(known, data):
    """The mean of the foreground given the data, a `FilteredSeparation`."""
    linear = known._filter(data)
    low_rank = filtered(linear.spectra, linear.estimators, data.project, data.modes)
    parts = {"mixing": low_rank.spectra, "sources": low_rank.maps, "low_rank": low_rank}
    return FilteredSeparation(filter=linear, means=data.means, **parts)


def test_draws_given_the_covariance_have_its_posterior(rng):
    """The means of its sources have 1 / 2 and 1 / 5 of their variance."""
    known, data, basis = certain(rng)
    variances = np.array([1, 0.25])

    def sources_of(found):
        modes = harmonic.to_modes(sphere.analyse(found.foreground.maps, 2 * NSIDE))
        return (basis[:, :2].T @ found.foreground.spectra) @ modes

    mean, drawn = sources_of(mean_of(known, data)), [sources_of(known.draw(data, rng)) for _ in range(10)]
    gain = variances / (variances + 1)
    assert np.cov(mean) == pytest.approx(np.diag(variances * gain), abs=0.06)
    assert np.cov(np.hstack(drawn)) == pytest.approx(np.diag(variances), abs=0.12)
    differences = [one - other for one, other in zip(drawn[::2], drawn[1::2], strict=True)]
    assert np.cov(np.hstack(differences)) == pytest.approx(np.diag(2 * gain), abs=0.12)
    assert np.mean(np.square([one[:, 0] for one in drawn])) < 0.05  # means are subtracted
    turned = replace(known, axes=[axes * [-1, *np.ones(5)] for axes in known.axes])
    both = (one.draw(data, np.random.default_rng(1)).foreground for one in (known, turned))
    assert np.ptp([one.cube() for one in both], axis=0).max() < 1e-4  # the sign of an axis is chance


def test_what_is_uncertain_is_drawn_where_the_foreground_is_bright(rng):
    """With its relative brightness, and as much in all as if it were the same everywhere."""
    known, data, _ = certain(rng)
    latitude = sphere.pixel_latitude(NSIDE)
    data = replace(data, maps=data.maps * np.where(latitude > 0, 1, 0.2), known={})
    added = known.draw(data, rng).foreground + -mean_of(known, data).foreground
    parts = latitude > 10, latitude < -10  # away from the edge
    north, south = (np.sqrt(np.mean(added.lines(part) ** 2)) for part in parts)
    assert 3.5 < north / south < 5.5  # not exactly 5: white noise beyond 2 nside has errors of HEALPix
    variances = np.array([1 / 2, 0.25 / 1.25])  # given the data
    expected = np.sum(variances) * (3 * NSIDE) ** 2 / (4 * np.pi) / len(FREQS)
    assert np.mean(added.cube() ** 2) == pytest.approx(expected, rel=0.1)


def found_with(mixing):
    """A `Separation` with these spectra, (n_channels, n_sources)."""
    return Separation(mixing=mixing, sources=np.zeros((mixing.shape[1], 12 * NSIDE**2)))


def test_what_a_method_leaves_of_a_known_foreground(rng):
    """Its variances v, those of other spectra, or v / (1 + v)^2 where its mean is removed."""
    known, data, basis = certain(rng)
    for separation, expected in (
        (found_with(np.zeros((len(basis), 1))), [1, 0.25]),
        (found_with(3 * basis[:, [0, 0]]), [0, 0.25]),
        (mean_of(known, data), [1 / 4, 0.25 / 1.25**2]),
    ):
        left = [*known.residual_spectra(data, separation)]
        powers = [np.sum((basis[:, :2].T @ one) ** 2, axis=1) for one in left[1 : 2 * NSIDE]]
        mean = np.average(powers, axis=0, weights=2 * np.arange(1, 2 * NSIDE) + 1)
        assert mean == pytest.approx(expected, abs=0.06)
        assert len(left) == 3 * NSIDE and not left[0].any()  # means are subtracted


def test_a_method_has_its_spectra_seen_through_its_beams(rng):
    """Which leaves nothing where they are those of the foreground, here at l = 10."""
    known, data, basis = certain(rng)
    beams = np.linspace(0.5, 1, len(basis))[:, None] ** np.linspace(0, 2, 3 * NSIDE)
    separation = found_with(basis[:, :1] / beams[:, 10:11])
    left = [np.sum((basis[:, 0] @ one) ** 2) for one in known.residual_spectra(data, separation, beams)]
    assert left[10] == pytest.approx(0, abs=1e-9)
    assert left[5] > 1e-4 < left[20]


def test_the_chance_correlation_of_what_is_left_with_hi_is_in_its_estimate(rng):
    """Of a spectrum as bright as noise what is estimated is the power of both, less that of noise alone."""
    axis, errors = smooth_basis(FREQS, 6)[:, 0], []
    for _ in range(12):
        noise, source = modes_in_bands(np.ones(65), 64, rng)
        data = data_of_modes(noise + np.outer(axis, source), 64)
        left = known_of(data).residual_spectra(data, found_with(np.zeros((len(axis), 1))))
        total = sum((2 * degree + 1) * np.sum((axis @ one) ** 2) for degree, one in enumerate(left))
        true, along = np.sum(source[1:] ** 2), (axis @ noise)[1:]
        errors.append([total - true, 2 * along @ source[1:] + np.sum(along**2 - 1)])
    assert np.corrcoef(np.transpose(errors))[0, 1] > 0.9


@pytest.mark.parametrize("n_mocks", [1, 2, 4])
def test_what_is_known_of_a_member_is_from_other_mocks(n_mocks):
    """And from the data of the member; from the same mock where there is one."""
    rng = np.random.default_rng(6)
    mocks = [make_sky(rng).hi for _ in range(n_mocks)]
    data, member = (data_of(make_sky(rng).maps) for _ in range(2))
    found = foreground_given(data, products_of(mocks, LMAX), n_mocks).of_member(member, mocks[0])
    expected = foreground_given(member, products_of(mocks[1:] or mocks, LMAX), max(n_mocks - 1, 1))
    assert found.n_mocks == expected.n_mocks
    assert found.products == pytest.approx(expected.products)
    assert found.faint == pytest.approx(expected.faint)
    for one, other in zip(found.axes, expected.axes, strict=True):
        assert one @ one.T == pytest.approx(other @ other.T, rel=1e-4, abs=1e-6 * np.max(other**2))


def test_draws_scatter_as_estimates_do(products):
    """In the power of what is faint: draws of one sky as their means do about the truth of several."""
    rng, errors, scatter = np.random.default_rng(3), [], []
    for _ in range(8):
        sky = make_sky(rng, brightness=60)
        data = data_of(sky.maps)
        known = foreground_given(data, products)
        first = np.linalg.svd(sky.foreground, full_matrices=False)[0][:, :2]
        true, *drawn = (
            power(one - first @ (first.T @ one), 5, LMAX)
            for one in (sky.foreground, *(known.draw(data, rng).foreground.cube() for _ in range(4)))
        )
        errors.append(np.mean(drawn) - true)
        scatter.append(np.std(drawn, ddof=1))
    assert 0.5 < np.sqrt(np.mean(np.square(scatter))) / np.std(errors) < 3


def modes_in_bands(variances, lmax, rng):
    """Of white noise, (n_channels, n_modes), and of one source with its `variances` by l, (n_modes,)."""
    scale = np.repeat(np.sqrt(variances), 2 * np.arange(lmax + 1) + 1)
    return rng.standard_normal((len(FREQS), len(scale))), scale * rng.standard_normal(len(scale))


def data_of_modes(modes, lmax):
    maps = np.zeros((len(FREQS), 12 * 32**2), np.float32)
    data = Data.of(maps, freqs=FREQS, beams=np.ones((len(FREQS), lmax + 1)))
    empty = np.zeros((len(FREQS), 0)), np.zeros((0, modes.shape[1]))
    data.known["modes"] = CubeModes(spectra=empty[0], bright=empty[1], rest=modes.astype(np.float32))
    return data


def known_of(data, products=None):
    """The `SmoothForeground` of data with white noise, unless HI and noise have other `products`."""
    white = [np.eye(len(FREQS))] * len(multipole_bands(data.beams.shape[1] - 1))
    return foreground_given(data, np.array(white if products is None else products))


def known_in_bands(variances, lmax, rng, products=None):
    """That of white noise and one faint smooth spectrum, with its `variances` by l."""
    noise, source = modes_in_bands(variances, lmax, rng)
    return known_of(data_of_modes(noise + np.outer(smooth_basis(FREQS, 6)[:, 0], source), lmax), products)


def in_bands(variances, lmax, rng):
    """The variance of its foreground over that of the noise, (n_bands,)."""
    return np.array([np.sum(axes**2) for axes in known_in_bands(variances, lmax, rng).axes])


@pytest.mark.parametrize(
    ("variance", "bands", "unseen", "close"), [(0.2, slice(3, 6), 0.45, 0.03), (1, slice(1), 0.1, 0.15)]
)
def test_bands_see_with_others_what_they_do_not_see_alone(rng, variance, bands, unseen, close):
    """What is faint everywhere, of which by themselves bands at l from 15 to 30 have none in 0.57 of skies.

    And a variance equal to that of the noise, which the lowest band by itself does not always see.
    """
    found = np.array([in_bands(np.full(65, variance), 64, rng)[bands] for _ in range(48)])
    assert np.mean(found == 0) < unseen
    assert np.mean(found) == pytest.approx(variance, abs=close)


@pytest.mark.parametrize("errors", [10, 1000])
@pytest.mark.parametrize("faint", [0, 0.2])
def test_errors_beyond_2_nside_are_no_foreground(rng, errors, faint):
    """However much brighter than the noise there; what is faint in the last band before holds."""
    found = in_bands(np.where(np.arange(96) > 64, errors, faint), 95, rng)
    assert found[-1] < 0.5


def test_beyond_2_nside_the_foreground_gets_fainter_as_in_the_data(rng):
    """But not brighter."""
    beyond = sum(first <= 64 for first, _ in multipole_bands(95))
    falling, rising = (in_bands(np.where(np.arange(96) > 64, one, 1000), 95, rng) for one in (50, 5000))
    assert falling[beyond:] == pytest.approx(50, rel=0.2)
    assert rising[beyond:] == pytest.approx(1000, rel=0.2)


def test_beyond_2_nside_the_spectra_of_the_foreground_are_those_below(rng):
    """Also where HI and noise have another covariance."""
    products = [np.diag(np.linspace(1, 1 + n, len(FREQS))) for n in range(len(multipole_bands(95)))]
    known = known_in_bands(np.full(96, 100), 95, rng, products)
    *_, last = (root @ axes @ axes.T @ root.T for root, axes in zip(known.roots, known.axes, strict=True))
    before = known.roots[known.n_exact - 1] @ known.axes[known.n_exact - 1]
    before = before @ before.T
    assert last / np.trace(last) == pytest.approx(before / np.trace(before), abs=1e-6)


@pytest.mark.parametrize("brightness", [1e-9, 1e9])
def test_a_foreground_may_be_nothing_or_as_bright_as_float64_holds(products, brightness):
    """Hardly anything is drawn then; and draws of its covariance need no Cholesky factor of it."""
    sky = make_sky(np.random.default_rng(5), brightness=brightness)
    data = data_of(sky.truth + sky.foreground)
    drawn = foreground_given(data, products).draw(data, np.random.default_rng(1)).foreground.cube()
    close = {"rel": 1e-3, "abs": 0.02 * power(sky.truth, 5, LMAX) if brightness < 1 else 0}
    assert power(drawn, 5, LMAX) == pytest.approx(power(sky.foreground, 5, LMAX), **close)


def test_beyond_2_nside_what_is_faint_is_that_of_the_last_band_before(rng):
    found = in_bands(np.full(96, 0.2), 95, rng)
    n_exact = sum(last <= 64 for _, last in multipole_bands(95))
    assert n_exact < len(found) and found[n_exact - 1] > 0
    assert found[n_exact:] == pytest.approx(found[n_exact - 1], rel=0.15)
