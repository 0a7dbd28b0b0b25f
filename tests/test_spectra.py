"""Power spectra: closed forms, Parseval, and masks that change nothing on average."""

import healpy as hp
import numpy as np
import pytest
from scipy import signal

from himap.maps import masks, sphere
from himap.measures import spectra
from himap.measures.spectra import angular_power, decouple, frequency_power

NSIDE = 32
LMAX = 3 * NSIDE - 1
N_PIX = 12 * NSIDE**2
LATITUDE = sphere.pixel_latitude(NSIDE)
CUT = np.abs(LATITUDE) > 20
APODISED = np.clip(np.abs(LATITUDE) / 15 - 1, 0, 1)  # from 0 at |b| = 15 deg to 1 at twice that
RED = np.where(np.arange(LMAX + 1) <= 2 * NSIDE, 1 / (1.0 + np.arange(LMAX + 1)) ** 2, 0)
"""A steep spectrum, band-limited: what a mask mixes most."""


def realisations(cl, n, rng):
    return np.stack([sphere.synthesise(sphere.gaussian_alm(cl, rng), NSIDE) for _ in range(n)])


def test_full_sky_against_healpy(rng):
    maps = rng.standard_normal((2, N_PIX))
    power = angular_power(maps)
    assert power.degrees == pytest.approx(np.arange(LMAX + 1))
    assert power.cl[1][1:] == pytest.approx(hp.anafast(maps[1], iter=3)[1:], rel=1e-6)
    assert power.mean == pytest.approx(power.cl.mean(axis=0))


def test_channel_means_do_not_count(rng):
    maps = rng.standard_normal((2, N_PIX)).astype(np.float32)
    shifted = maps + np.float32([[3], [-5]])
    assert angular_power(shifted).cl == pytest.approx(angular_power(maps).cl, abs=1e-7)
    before = frequency_power(maps, 1.0).power
    assert frequency_power(shifted, 1.0).power == pytest.approx(before, rel=1e-5)


@pytest.mark.parametrize("width", [5, 20])
def test_mask_is_decoupled_without_bias(rng, width):
    maps, mask = realisations(RED, 40, rng), np.abs(LATITUDE) > width
    masked, full = angular_power(maps, mask=mask), angular_power(maps).mean
    inside = (masked.degrees > 4) & (masked.degrees < 1.5 * NSIDE)
    expected = np.interp(masked.degrees[inside], np.arange(LMAX + 1), full)
    # Same skies, so only the modes lost to the mask scatter: 4 sigma of a tenth of all modes.
    modes, ratio = 40 * (2 * masked.degrees[inside] + 1), masked.mean[inside] / expected
    assert (np.abs(ratio - 1) < 4 * np.sqrt(2 / modes) + 0.02).all()
    assert ratio.mean() == pytest.approx(1, abs=0.01)
    naive = sphere.power_spectrum(sphere.analyse(maps * mask)).mean(axis=0)
    assert naive[10] < 0.95 * full[10]  # the mask does something to be undone


@pytest.mark.parametrize("weights", [CUT.astype(float), APODISED], ids=["sharp", "apodised"])
class TestDecoupling:
    def test_it_inverts_the_coupling_exactly(self, weights):
        """Pseudo-spectra made by the coupling matrix itself, of a steep spectrum: no sample variance."""
        bins = masks.bin_matrix(LMAX, 2)
        steep = 1 / (1 + np.arange(len(bins))) ** 3.0
        coupling = sphere.coupling_matrix(sphere.power_spectrum(sphere.analyse(weights)), LMAX)
        assert decouple((coupling @ (bins > 0).T @ steep)[None], weights, 2).cl[0] == pytest.approx(
            steep, rel=1e-6
        )

    @pytest.mark.filterwarnings("default")  # what NaMaster warns of is not ours
    def test_against_namaster(self, rng, weights):
        """The same pseudo-spectra, mask and bins, decoupled by NaMaster where it is installed."""
        nmt = pytest.importorskip("pymaster")
        maps = realisations(RED, 1, rng)
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
        found = angular_power(maps, mask=weights, bin_width=2)
        inside = (found.degrees > 2) & (found.degrees < 2 * NSIDE)
        assert found.cl[0][inside] == pytest.approx(expected[inside], rel=1e-3)


def test_fallback_divides_by_the_mean_square_of_the_weights(rng, monkeypatch):
    """White noise under fractional weights: their mean square is what the pseudo-spectrum loses."""
    monkeypatch.setattr(spectra, "_MAX_CONDITION", 0)
    with pytest.warns(UserWarning, match="divided by that fraction"):
        power = angular_power(rng.standard_normal((4, N_PIX)), mask=APODISED)
    inside = (power.degrees > 20) & (power.degrees < 64)
    assert power.mean[inside].mean() == pytest.approx(4 * np.pi / N_PIX, rel=0.03)


@pytest.mark.parametrize("outside", [1e6, np.nan])
def test_what_the_mask_leaves_out_may_be_anything(rng, outside):
    """Nor does a bright region that is masked leave a step behind when the mean is removed."""
    maps = rng.standard_normal((6, N_PIX))
    other = np.where(CUT, maps, outside)
    assert angular_power(other, mask=CUT).cl == pytest.approx(angular_power(maps, mask=CUT).cl)
    lines = frequency_power(maps[:, CUT], 1.0).power
    assert frequency_power(other, 1.0, mask=CUT).power == pytest.approx(lines)


def test_weights_count_once_in_the_frequency_spectrum(rng):
    maps = rng.standard_normal((8, N_PIX))
    centred = maps - np.average(maps, axis=1, weights=APODISED)[:, None]
    expected = np.average(np.abs(np.fft.rfft(centred, axis=0)) ** 2 / 8, axis=1, weights=APODISED)
    assert frequency_power(maps, 1.0, mask=APODISED).power == pytest.approx(expected)


def test_bins(rng):
    """They begin at l = 2, so that none that is compared has a lower l, and no l from 2 on is in none."""
    maps = rng.standard_normal((1, N_PIX))
    fine, coarse = angular_power(maps), angular_power(maps, bin_width=10)
    assert fine.degrees == pytest.approx(np.arange(LMAX + 1))
    assert coarse.degrees[:3] == pytest.approx([0.5, 6.5, 16.5])
    assert coarse.cl[0, 1] == pytest.approx(fine.cl[0, 2:12].mean())
    masked = angular_power(maps, mask=CUT)  # with 1 / f_sky of two
    assert masked.degrees[:3] == pytest.approx([0.5, 2.5, 4.5])


@pytest.mark.parametrize("n_channels", [20, 21])
@pytest.mark.parametrize("taper", ["none", "hann"])
def test_frequency_power_is_that_of_scipy(rng, taper, n_channels):
    """Hann's window with the same distance to both ends of the band; the mean square of a taper is 1."""
    lines = rng.standard_normal((n_channels, N_PIX)) + np.linspace(0, 5, n_channels)[:, None]
    window = "boxcar" if taper == "none" else signal.windows.hann(2 * n_channels + 1)[1::2]
    centred = lines - lines.mean(axis=1, keepdims=True)
    options = {"detrend": False, "return_onesided": False, "axis": 0}
    waves, density = signal.periodogram(centred, 0.25, window, **options)
    found, half = frequency_power(lines, 4.0, taper=taper), slice(n_channels // 2 + 1)
    assert found.k == pytest.approx(2 * np.pi * np.abs(waves[half]))
    assert found.power == pytest.approx(density.mean(axis=1)[half])
