"""How far the residual of a user's cube depends on its beam, in Python and on the command line."""

import numpy as np
import pytest
from cube_files import FREQS, N_PIX, NSIDE, run, write_hdf5
from skies import maps_through

from himap.cubes import beam_sensitivity, beams_of, clean_cube, read_cube
from himap.cubes.sensitivity import sensitivity_figure, sensitivity_table
from himap.instrument.beams import Evolving, PerturbedBeam
from himap.maps import sphere
from himap.measures.low_rank_spectra import masked_alms
from himap.measures.transfer import harmonic_power


@pytest.fixture
def path(rng, tmp_path):
    """Two power laws with structure on all scales, seen through the evolving beam, and noise."""
    sources = np.array([sphere.gaussian_alm(1e8 / np.arange(1, 2 * NSIDE) ** 2, rng) for _ in range(2)])
    spectra = (FREQS / 1000)[:, None] ** np.array([-2.1, -2.8])
    windows = Evolving().windows(FREQS, lmax=3 * NSIDE - 1).total
    noise = rng.normal(scale=0.05, size=(len(FREQS), N_PIX))
    maps = maps_through(windows, spectra @ sources, NSIDE) + noise
    return write_hdf5(tmp_path / "cube.h5", maps.astype(np.float32))


def cleaned_with(cube, beam, method="beam_subspace", **parameters):
    return clean_cube(cube, method, n_sources=2, beams=beams_of(cube, beam), peaks=False, **parameters)


@pytest.mark.parametrize(
    ("lowest", "method"), [(0, "beam_subspace"), (20, "beam_subspace"), (20, "sdecgmca")]
)
def test_power_of_cubes_that_are_cleaned_with_that_beam(path, lowest, method):
    """Of a beam that is wider by 0.3, of the whole sky, and of the pixels from a latitude on.

    Of a chaotic method it is that of the same run: another one, of the same cube, has other rounding.
    """
    cube, beam = read_cube(path), PerturbedBeam(beam="evolving", width=0.3)
    cube = cube.within(np.abs(sphere.pixel_latitude(NSIDE)) >= lowest)
    cleaned = cleaned_with(cube, Evolving(), method=method, noise=0.05)
    if method == "sdecgmca":
        other = cleaned.with_beams(beams_of(cube, beam)).separation
        wrong = cleaned.residual + cleaned.separation.foreground.cube() - other.foreground.cube()
    else:
        wrong = cleaned_with(cube, beam, noise=0.05).residual
    found = beam_sensitivity(cleaned, "evolving", widths=[0.3], ripples=[]).loc["width", 0.3]
    before, after = (
        harmonic_power(masked_alms(cube.on_sphere(one), mask=cube.sky_mask), cube.channel_width)
        for one in (cleaned.residual, wrong)
    )
    ratio = np.mean(after.angular[10:20] / before.angular[10:20])
    assert found["C/C0, 10-19"] == pytest.approx(ratio, rel=0.02 if lowest else 0.01)
    assert abs(ratio - 1) > (0.1 if lowest else 1)
    if not lowest:
        ratio = np.mean(after.frequency[before.k > 0.1] / before.frequency[before.k > 0.1])
        assert found["P/P0, k > 0.1"] == pytest.approx(ratio, rel=0.01) and ratio > 1.2


def test_no_error_moves_nothing_and_more_moves_more(path):
    cube = read_cube(path)
    cleaned = cleaned_with(cube, Evolving())
    found = beam_sensitivity(cleaned, Evolving(), widths=[1e-9, 0.1], ripples=[1e-2], period=50)
    assert found.loc["width", 1e-9].to_numpy() == pytest.approx(1, abs=1e-3)
    rows = sensitivity_table(found, 50).rows
    assert [float(row[2]) > 1.2 for row in rows] == [False, True, True]
    assert rows[1][:2] == ["FWHM of all channels", "+10 %"] and rows[2][:2] == ["ripple of 50 MHz", "+1 %"]
    first, second = sensitivity_figure(found).axes
    assert len(first.get_lines()) == 2 + len(found.columns)
    assert [text.get_text() for text in second.get_xticklabels()] == ["+1"]


def test_command(path, tmp_path):
    command = ("--method", "beam_subspace", "--beam", "evolving", "-p", "n_sources=2", "--keep-peaks")
    page = tmp_path / "beam.html"
    done = run("sensitivity", path, *command, "--width", "0.01", "--ripple", "1e-4", "-o", page)
    header, width, ripple, files = done.stdout.splitlines()
    assert header.split()[:3] == ["what", "is", "wrong"]
    assert width.startswith("FWHM of all channels") and "+1 %" in width
    assert ripple.startswith("ripple of 20 MHz") and "+0.01 %" in ripple
    assert files.startswith(str(page))
    text = page.read_text()
    assert "Sensitivity to the beam" in text and text.count("<img") == 1 and "+0.01 %" in text
