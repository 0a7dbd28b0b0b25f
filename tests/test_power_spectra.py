"""Power spectra: closed forms, Parseval, and masks that change nothing on average."""

import re

import healpy as hp
import numpy as np
import pytest

from himap.core.errors import InputError
from himap.maps import masks, sphere
from himap.measures import low_rank_spectra as pairs
from himap.measures import spectra
from himap.measures.low_rank_spectra import difference, masked_alms

NSIDE = 32
LMAX = 3 * NSIDE - 1
N_PIX = 12 * NSIDE**2


def cut(width):
    return np.abs(hp.pix2ang(NSIDE, np.arange(N_PIX), lonlat=True)[1]) > width


@pytest.fixture(scope="module")
def red_cl():
    """A steep spectrum, band-limited: what a mask mixes most."""
    degree = np.arange(LMAX + 1.0)
    return np.where(degree <= 2 * NSIDE, 1 / (1 + degree) ** 2, 0)


def realisations(cl, n, rng):
    return np.stack([sphere.synthesise(sphere.gaussian_alm(cl, rng), NSIDE) for _ in range(n)])


def test_full_sky_against_healpy(rng):
    maps = rng.standard_normal((2, N_PIX))
    power = spectra.angular_power(maps)
    assert power.degrees == pytest.approx(np.arange(LMAX + 1))
    assert power.cl[1][1:] == pytest.approx(hp.anafast(maps[1], iter=3)[1:], rel=1e-6)
    assert power.mean == pytest.approx(power.cl.mean(axis=0))


def test_channel_means_do_not_count(rng):
    maps = rng.standard_normal((2, N_PIX)).astype(np.float32)
    shifted = maps + np.float32([[3], [-5]])
    assert spectra.angular_power(shifted).cl == pytest.approx(spectra.angular_power(maps).cl, abs=1e-7)
    before = spectra.frequency_power(maps, 1.0).power
    assert spectra.frequency_power(shifted, 1.0).power == pytest.approx(before, rel=1e-5)


@pytest.mark.parametrize("width", [5, 20])
def test_mask_is_decoupled_without_bias(red_cl, rng, width):
    maps = realisations(red_cl, 40, rng)
    masked = spectra.angular_power(maps, mask=cut(width))
    full = spectra.angular_power(maps).mean
    inside = (masked.degrees > 4) & (masked.degrees < 1.5 * NSIDE)
    expected = np.interp(masked.degrees[inside], np.arange(LMAX + 1), full)
    # Same skies, so only the modes lost to the mask scatter: 4 sigma of a tenth of all modes.
    modes = 40 * (2 * masked.degrees[inside] + 1)
    assert (np.abs(masked.mean[inside] / expected - 1) < 4 * np.sqrt(2 / modes) + 0.02).all()
    naive = sphere.power_spectrum(sphere.analyse(maps * cut(width))).mean(axis=0)
    assert naive[10] < 0.95 * full[10]  # the mask does something to be undone


def apodised(width):
    """Weights that rise from 0 at |b| = width to 1 at twice that."""
    latitude = np.abs(hp.pix2ang(NSIDE, np.arange(N_PIX), lonlat=True)[1])
    return np.clip(latitude / width - 1, 0, 1)


@pytest.mark.parametrize("weights", [cut(20).astype(float), apodised(15)], ids=["sharp", "apodised"])
def test_decoupling_inverts_the_coupling_exactly(weights):
    """Pseudo-spectra made by the coupling matrix itself, of a steep spectrum: no sample variance."""
    bins = masks.bin_matrix(LMAX, 2)
    steep = 1 / (1 + np.arange(len(bins))) ** 3.0
    coupling = sphere.coupling_matrix(sphere.power_spectrum(sphere.analyse(weights)), LMAX)
    decoupled = masks.decoupled((coupling @ (bins > 0).T @ steep)[None], weights, bins)[0]
    assert decoupled == pytest.approx(steep, rel=1e-6)


@pytest.mark.filterwarnings("default")  # what NaMaster warns of is not ours
@pytest.mark.parametrize("weights", [cut(20).astype(float), apodised(15)], ids=["sharp", "apodised"])
def test_decoupling_against_namaster(red_cl, rng, weights):
    """The same pseudo-spectra, mask and bins, decoupled by NaMaster where it is installed."""
    nmt = pytest.importorskip("pymaster")
    maps = realisations(red_cl, 1, rng)
    kept = weights > 0
    centred = np.where(kept, maps[0] - np.average(maps[0][kept], weights=weights[kept]), 0)
    bins = masks.bin_matrix(LMAX, 2)
    bands = nmt.NmtBin(
        ells=np.arange(LMAX + 1), bpws=(bins > 0).argmax(axis=0), weights=np.ones(LMAX + 1), lmax=LMAX
    )
    field = nmt.NmtField(weights, [centred], n_iter=sphere.N_ITER, n_iter_mask=sphere.N_ITER)
    workspace = nmt.NmtWorkspace()
    workspace.compute_coupling_matrix(field, field, bands)
    expected = workspace.decouple_cell(nmt.compute_coupled_cell(field, field))[0]
    found = spectra.angular_power(maps, mask=weights, bin_width=2)
    inside = (found.degrees > 2) & (found.degrees < 2 * NSIDE)
    assert found.cl[0][inside] == pytest.approx(expected[inside], rel=1e-3)


def test_fallback_divides_by_the_mean_square_of_the_weights(rng, monkeypatch):
    """White noise under fractional weights: their mean square is what the pseudo-spectrum loses."""
    monkeypatch.setattr(masks, "_MAX_CONDITION", 0)
    with pytest.warns(UserWarning, match="divided by that fraction"):
        power = spectra.angular_power(rng.standard_normal((4, N_PIX)), mask=apodised(15))
    inside = (power.degrees > 20) & (power.degrees < 64)
    assert power.mean[inside].mean() == pytest.approx(4 * np.pi / N_PIX, rel=0.03)


def test_lmax_cuts_after_decoupling(red_cl, rng):
    """Power beyond lmax leaks into the last bins if it is cut before."""
    white = np.ones(LMAX + 1)
    maps = realisations(white, 2, rng)
    full = spectra.angular_power(maps, mask=cut(20))
    short = spectra.angular_power(maps, mask=cut(20), lmax=40)
    assert short.degrees[-1] <= 40
    assert short.cl == pytest.approx(full.cl[:, : short.cl.shape[1]])


def test_what_is_masked_does_not_move_the_mean(rng):
    """A bright masked region must not leave a step behind when the mean is removed."""
    maps = rng.standard_normal((1, N_PIX))
    bright = np.where(cut(20), maps, 1e6)
    expected = spectra.angular_power(maps, mask=cut(20)).cl
    assert spectra.angular_power(bright, mask=cut(20)).cl == pytest.approx(expected)


def test_what_the_mask_leaves_out_may_be_anything(rng):
    maps, mask = rng.standard_normal((6, N_PIX)), cut(20)
    holes = np.where(mask, maps, np.nan)
    assert np.array_equal(
        spectra.frequency_power(holes, 1.0, mask=mask).power,
        spectra.frequency_power(maps, 1.0, mask=mask).power,
    )
    assert np.array_equal(
        spectra.angular_power(holes, mask=mask).cl, spectra.angular_power(maps, mask=mask).cl
    )


def test_weights_count_once_in_the_frequency_spectrum(rng):
    maps = rng.standard_normal((8, N_PIX))
    weights = apodised(15)
    centred = maps - np.average(maps, axis=1, weights=weights)[:, None]
    lines = np.abs(np.fft.rfft(centred, axis=0)) ** 2 / 8
    expected = np.average(lines, axis=1, weights=weights)
    assert spectra.frequency_power(maps, 1.0, mask=weights).power == pytest.approx(expected)


def test_unmasked_mask_changes_nothing(red_cl, rng):
    maps = realisations(red_cl, 2, rng)
    masked = spectra.angular_power(maps, mask=np.ones(N_PIX, dtype=bool))
    assert masked.cl[:, 2:64] == pytest.approx(spectra.angular_power(maps).cl[:, 2:64], rel=1e-4)


def test_hopeless_mask_falls_back_with_a_warning(rng):
    pole = hp.pix2ang(NSIDE, np.arange(N_PIX), lonlat=True)[1] > 85
    with pytest.warns(UserWarning, match="divided by that fraction"):
        power = spectra.angular_power(rng.standard_normal((1, N_PIX)), mask=pole, bin_width=1)
    white = 4 * np.pi / N_PIX
    assert power.mean[20:90].mean() == pytest.approx(white, rel=0.2)


def test_bins(rng):
    maps = rng.standard_normal((1, N_PIX))
    fine, coarse = spectra.angular_power(maps), spectra.angular_power(maps, bin_width=10)
    assert coarse.degrees[:2] == pytest.approx([0, 5.5])
    assert coarse.cl[0, 1] == pytest.approx(fine.cl[0, 1:11].mean())
    assert spectra.angular_power(maps, lmax=20).cl.shape == (1, 21)


def test_frequency_power_of_a_wave(rng):
    """cos(k nu) on every line of sight, with random phases: half its power times the bandwidth, at one k."""
    n_channels, width, n = 50, 2.0, 7
    phase = rng.uniform(0, 2 * np.pi, N_PIX)
    nu = width * np.arange(n_channels)
    maps = np.cos(2 * np.pi * n * nu[:, None] / (n_channels * width) + phase)
    power = spectra.frequency_power(maps, width)
    assert power.k[n] == pytest.approx(2 * np.pi * n / 100)
    assert power.power[n] == pytest.approx(n_channels * width / 4, rel=0.01)
    assert np.delete(power.power, n) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("n_channels", [20, 21])
def test_parseval_along_the_line_of_sight(rng, n_channels):
    """sum over all k of P / bandwidth is the variance."""
    width = 4.0
    maps = rng.standard_normal((n_channels, N_PIX))
    maps -= maps.mean(axis=1, keepdims=True)
    power = spectra.frequency_power(maps, width)
    twice = np.full(len(power.k), 2.0)  # k and -k
    twice[0] = 1
    if n_channels % 2 == 0:
        twice[-1] = 1
    assert (twice * power.power).sum() / (n_channels * width) == pytest.approx((maps**2).mean())


def test_white_noise_has_flat_frequency_power(rng):
    power = spectra.frequency_power(3 * rng.standard_normal((40, N_PIX)), 5.0).power
    assert power == pytest.approx(9 * 5.0, rel=0.05)


def test_masked_frequency_power_sees_only_kept_lines(rng):
    maps = rng.standard_normal((20, N_PIX))
    mask = cut(10)
    dirty = np.where(mask, maps, 1e6)
    clean = spectra.frequency_power(maps[:, mask], 1.0).power
    assert spectra.frequency_power(dirty, 1.0, mask=mask).power == pytest.approx(clean)


@pytest.mark.parametrize(
    ("mask", "message"),
    [
        (np.ones(12), "must have shape"),
        (np.zeros(N_PIX), "keeps no pixel"),
        (np.full(N_PIX, 2.0), "between 0 and 1"),
        (np.full(N_PIX, np.nan), "between 0 and 1"),
    ],
)
def test_bad_masks(mask, message):
    with pytest.raises(InputError, match=message):
        spectra.angular_power(np.ones((2, N_PIX)), mask=mask)


def test_bad_bin_width():
    with pytest.raises(InputError, match="bin_width"):
        spectra.angular_power(np.ones((2, N_PIX)), bin_width=0)


def angular_pair(recovered, truth, *, mask=None, alms=None):
    """`angular_power_pair` of two cubes."""
    truth_alms = masked_alms(truth, mask=mask, alms=alms)
    return pairs.angular_power_pair(truth_alms, difference(recovered, truth, mask=mask), mask=mask)


class TestPair:
    """Both spectra at once, against each by itself."""

    @pytest.fixture
    def pair(self, red_cl, rng):
        """(recovered, truth): three smooth spectra are left, and a tenth of the signal in them is lost."""
        truth = realisations(red_cl, 12, rng).astype(np.float32)
        bright = 5 * realisations(red_cl, 3, rng)
        smooth = np.linspace(0.5, 1.5, 12)[:, None] ** np.arange(3)
        space = np.linalg.qr(smooth)[0]
        return (truth + smooth @ bright - 0.1 * space @ (space.T @ truth)).astype(np.float32), truth

    @pytest.mark.parametrize("mask", [None, cut(10), cut(10) * 0.5])
    def test_against_one_by_one(self, pair, mask):
        found = angular_pair(*pair, mask=mask)
        for one, maps in zip(found, pair, strict=True):
            expected = spectra.angular_power(maps, mask=mask)
            assert one.degrees == pytest.approx(expected.degrees)
            assert one.mean[1:] == pytest.approx(expected.mean[1:], rel=1e-3)
            assert one.cl[:, 1:] == pytest.approx(expected.cl[:, 1:], rel=0.03)

    def test_faint_differences_roughly(self, pair, monkeypatch):
        """What is small in every channel is transformed without refinements, and nobody can tell."""
        truth = pair[1]
        recovered = (truth + 0.03 * (pair[0] - truth)).astype(np.float32)
        found, _ = angular_pair(recovered, truth)
        monkeypatch.setattr(pairs, "_MINOR", 0)
        closely, _ = angular_pair(recovered, truth)
        assert not np.array_equal(found.cl, closely.cl)
        seen = slice(1, 2 * NSIDE + 1)  # beyond, the quadrature of HEALPix is poor with refinements too
        assert found.cl[:, seen] == pytest.approx(closely.cl[:, seen], rel=0.01)
        assert found.mean[seen] == pytest.approx(closely.mean[seen], rel=1e-3)

    @pytest.mark.parametrize("mask", [None, cut(10), 0.5 + 0.5 * cut(10), cut(40), cut(10) * 0.5])
    def test_coefficients_of_the_whole_truth(self, pair, mask):
        """Little taken, wholly or in part, or much: as if the masked truth were transformed."""
        alms = sphere.analyse(pair[1], n_iter=9)
        found = angular_pair(*pair, mask=mask, alms=alms)
        expected = angular_pair(*pair, mask=mask)
        for one, other in zip(found, expected, strict=True):
            seen = slice(1, np.searchsorted(other.degrees, 2 * NSIDE))
            assert one.degrees == pytest.approx(other.degrees)
            assert one.mean[seen] == pytest.approx(other.mean[seen], rel=2e-3)
            assert one.cl[:, seen] == pytest.approx(other.cl[:, seen], rel=0.02)
            assert one.cl[:, 0] == pytest.approx(other.cl[:, 0], abs=1e-3 * other.cl[0, 1])

    def test_coefficients_of_the_whole_truth_want_it_whole(self, pair):
        truth, mask = pair[1].copy(), cut(10)
        truth[:, mask == 0] = np.nan
        angular_pair(pair[0], truth, mask=mask)
        with pytest.raises(InputError, match="finite|NaN"):
            angular_pair(pair[0], truth, mask=mask, alms=np.zeros((12, 1)))

    @pytest.mark.parametrize("shape", [(12, 1), (11, sphere.alm_size(LMAX)), (sphere.alm_size(LMAX),)])
    def test_coefficients_of_another_shape(self, pair, shape):
        expected = re.escape(f"= (12, {sphere.alm_size(LMAX)}), got {shape}; analyse")
        alms = np.zeros(shape, dtype=np.complex64)
        with pytest.raises(InputError, match=expected):
            angular_pair(*pair, alms=alms)

    @pytest.mark.parametrize("shape", [(12, sphere.alm_size(9)), (11, sphere.alm_size(LMAX)), (5,)])
    def test_coefficients_that_do_not_fit_an_error(self, pair, shape):
        alms = np.zeros(shape, dtype=np.complex64)
        with pytest.raises(InputError, match="coefficients must have shape"):
            pairs.angular_power_pair(alms, difference(*pair), mask=cut(10))

    def test_a_small_mask_and_a_mean_leave_it_as_close(self, pair):
        """Whether a term is minor is judged on what the mask leaves, and without the means of channels."""
        mask = cut(80)
        faint = pair[1] + 0.1 * (pair[0] - pair[1])
        found, _ = angular_pair(faint + 100, pair[1] + 100, mask=mask)
        expected = spectra.angular_power(faint + 100, mask=mask)
        inside = (expected.degrees > 10) & (expected.degrees < 2 * NSIDE)
        assert found.mean[inside] == pytest.approx(expected.mean[inside], rel=5e-3)

    def test_equal_cubes_have_equal_spectra(self, pair):
        found, true = angular_pair(pair[1], pair[1])
        assert np.array_equal(found.cl, true.cl)

    def test_a_difference_of_full_rank(self, rng):
        """Noise in every channel is no short sum of spectra: nothing is left out."""
        truth, noise = rng.standard_normal((2, 6, N_PIX)).astype(np.float32)
        found, _ = angular_pair(truth + noise, truth)
        assert found.cl[:, 2:] == pytest.approx(spectra.angular_power(truth + noise).cl[:, 2:], rel=1e-3)
