"""What the notebooks share, on a tiny sky, and what captions say of SDecGMCA."""

import re
from functools import partial

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from skies import comparison

from himap.core.errors import InputError
from himap.figures import plotting
from himap.instrument.beams import Degraded
from himap.maps.healpix_io import write_maps
from himap.paper import cleaned, pipeline
from himap.paper.captions import in_short, of_sdecgmca
from himap.paper.methods import TABLE_1, paper_beams
from himap.paper.study import Study
from himap.paper.study_figures import angular_figure, channel_figure, frequency_figure, mixing_figure
from himap.removal.pca import PCA
from himap.removal.peaks import mask_peaks
from himap.removal.polynomial import Polynomial
from himap.removal.sdecgmca import SDecGMCA

TINY = {"nside": 8, "box_cells": 16}


@pytest.fixture
def study():
    return Study(preset="ci", overrides=TINY)


def test_peaks_are_masked_unless_told_otherwise(monkeypatch):
    lower = partial(mask_peaks, n_sigma=3.0)  # so small a sky has no peaks of 5 sigma
    monkeypatch.setattr("himap.paper.pipeline.peaks.mask_peaks", lower)
    study = Study(preset="ci", overrides=TINY | {"seed": 7})
    assert pipeline.peak_masked(study.case(Degraded())).flagged.any()
    with_mask = study.residual(Degraded(), PCA(n_sources=2))
    without = study.residual(Degraded(), PCA(n_sources=2), mask_peaks=False)
    direct = PCA(n_sources=2).clean(
        study.observed(Degraded()).maps,
        freqs=study.survey.freqs,
        separate_on=pipeline.peak_masked(study.case(Degraded())).maps,
    )
    assert np.array_equal(with_mask, direct.residual)
    assert not np.array_equal(with_mask, without)


def test_the_line_under_a_figure_tells_the_nside_of_templates(tmp_path):
    for name, nside in (("synchrotron_408MHz", 8), ("synchrotron_beta", 4), ("freefree_30GHz", 8)):
        pixels = np.full((1, 12 * nside**2), 1.0)
        write_maps(tmp_path / f"{name}.fits", pixels, names=["T"], unit="K", nested=False)
    study = Study(preset="ci", galaxy="templates", template_dir=str(tmp_path))
    figure = study.stamped(plotting.lines([{"curves": [([0, 1], [0, 1], {})]}]))
    assert "ci · templates (nside 4, 8) Galaxy · seed 2025" in figure.get_supxlabel()


def test_figures_have_a_panel_for_each_beam_and_one_legend(study):
    removers = {beam: [PCA(n_sources=2), PCA(n_sources=3), Polynomial()] for beam in paper_beams().values()}
    for figure in (angular_figure(study, removers), frequency_figure(study, removers)):
        panels = figure.axes
        assert [axes.get_title() for axes in panels[:3]] == list(TABLE_1)
        assert len(figure.legends) == 1
        assert not any(axes.get_legend() for axes in panels)
    one = angular_figure(study, {Degraded(): [PCA(n_sources=3)]})
    assert one.axes[0].get_title() == "degraded, 3 components"
    assert one.axes[0].get_legend() is not None


def test_numbers_carry_a_tolerance(study):
    numbers = study.band_numbers({Degraded(): [PCA(n_sources=3)]}, tolerance=0.05)
    value, tolerance = numbers["degraded, PCA: P/P0, k > 0.1"]
    assert tolerance == 0.05 * max(1, value)


def test_a_reading_is_told_under_figures_unless_it_is_the_default(study):
    short = {"n_sources": 2, "n_warmup": 3, "n_refinement": 1}
    default, letter = (SDecGMCA(reading=name, **short) for name in ("default", "letter"))

    def told(*methods):
        return angular_figure(study, {Degraded(): list(methods)}).get_supxlabel()

    assert "reading" not in told(PCA(n_sources=2)) + told(default)
    assert "reading = letter" in told(PCA(n_sources=2), letter)
    assert "reading = default and letter" in told(default, letter)
    assert "reading = letter" in mixing_figure(study, Degraded(), letter).get_supxlabel()
    lines = mixing_figure(study, Degraded(), PCA(n_sources=7)).axes[0].get_lines()
    assert len({(to_hex(line.get_color()), line.get_linestyle()) for line in lines}) == len(lines) == 7
    empty = plotting.lines([{"curves": [([0, 1], [0, 1], {})]}])
    assert "reading" not in study.stamped(empty, reading="default").get_supxlabel()


@pytest.mark.filterwarnings("ignore::himap.removal.base.SeparationWarning")
def test_a_chaotic_method_is_an_ensemble_of_restarts():
    study = Study(preset="ci", overrides=TINY, n_restarts=3)
    apart = {"reading": "code-rounding", "beyond": "regularised"}  # its restarts differ after few iterations
    chaotic, pca = SDecGMCA(n_sources=2, n_warmup=2, n_refinement=1, **apart), PCA(n_sources=2)
    assert [one.restart for one in study.members(chaotic)] == [0, 1, 2] and study.members(pca) == [pca]
    assert Study(preset="ci").members(chaotic) == [chaotic]
    figure = angular_figure(study, {Degraded(): [pca, chaotic]})
    _, labels = figure.axes[0].get_legend_handles_labels()
    (label,) = (label for label in labels if label.startswith("SDecGMCA"))
    assert re.fullmatch(r"SDecGMCA, median of 3 \(\d failed\)", label) and "PCA" in labels
    members = study.ensemble(Degraded(), chaotic)
    (median, _), name = study.band_entries(Degraded(), chaotic)["C/C0, 1 < l < 10"], "C/C0, 1 < l < 10"
    assert median == np.median([one.wide_band_means()[name] for one in members])
    case, far = study.case(Degraded()), []
    for member in study.members(chaotic):
        maps = [cleaned.separation(case, one).foreground.cube() for one in (member, *study.members(chaotic))]
        far.append(sum(np.sqrt(np.mean((maps[0] - other) ** 2)) for other in maps[1:]))
    # Two restarts that end alike are equally near to all; which comes first is rounding.
    assert far[study.medoid(Degraded(), chaotic).restart] <= min(far) * (1 + 1e-5)
    assert study.medoid(Degraded(), pca) == pca
    with pytest.raises(InputError, match="n_restarts"):
        Study(n_restarts=0)


def test_a_run_fails_by_its_mean_error_above_10():
    degrees = np.arange(2, 30)
    assert not comparison(degrees, np.where(degrees <= 10, 1e3, 0.95)).fails  # low l are not asked
    for wrong in (0.8, np.nan):
        assert comparison(degrees, np.where(degrees > 10, wrong, 1.0)).fails


@pytest.mark.filterwarnings("ignore::himap.removal.base.SeparationWarning")
@pytest.mark.parametrize("method", [PCA(n_sources=2), SDecGMCA(n_sources=2, n_warmup=2, n_refinement=1)])
def test_a_channel_is_that_of_the_cubes(study, method, monkeypatch):
    """Drawn from one channel alone, whatever the method does beyond some l."""
    drawn = {}
    monkeypatch.setattr(plotting, "sky_maps", lambda maps, **options: drawn.update(maps) or Figure())
    channel_figure(study, Degraded(), method)
    middle = study.survey.n_channels // 2
    left = study.residual(Degraded(), method)[middle]
    lmax = study.separation(Degraded(), method).lmax
    true = pipeline.truth(study.case(Degraded()), lmax)[middle]
    assert (lmax is not None) == (getattr(method, "beyond", None) == "cut")
    assert drawn["cleaned"] == pytest.approx(left - left.mean(dtype=float), rel=1e-5, abs=1e-7)
    assert drawn["cleaned minus truth"] == pytest.approx(drawn["cleaned"] - drawn["truth"])
    assert drawn["truth"] == pytest.approx(true - true.mean(dtype=float), rel=1e-5, abs=1e-7)


ENDS = "; it ends at ℓ = 128 and is compared with the truth at all multipoles"
SILENT = (
    "and, where it is silent, noise of the thresholds (that of the instrument, carried through the inversion)"
)


@pytest.mark.parametrize(
    ("reading", "options", "words"),
    [
        ("instrument-noise", {}, f"has the reading “instrument-noise”: the paper's text {SILENT}{ENDS}"),
        ("letter", {"sign": "free"}, f"“letter”: the paper's text except for sign of A (as it comes){ENDS}"),
        ("letter", {"last": "repeated"}, "the paper's text and, where it is silent, the last S (Eq. 23 with"),
        ("code", {}, "“code”: the paper's text except for 5 choices and, where it is silent, smallest eigen"),
        ("follow-up", {}, "its regularised inversion is continued beyond ℓ = 128"),
        ("letter", {"beyond": "projection"}, "it is continued beyond ℓ = 128 without regularisation"),
    ],
)
def test_words_of_a_caption(reading, options, words):
    said = of_sdecgmca(SDecGMCA(reading=reading, **options), 64)
    assert said.startswith("SDecGMCA has the reading “") and words in said


LETTER, BOTH = {"reading": "letter"}, {"reading": "instrument-noise", "beyond": "projection"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"reading": "follow-up"}, "(the text except for 6 choices, with 4 choices), continued beyond ℓ = "),
        ({}, "reading “default” (the text except for beyond = projection), continued beyond"),
        (LETTER | {"sign": "free", "lmax": 30}, "(the text except for sign = free), up to ℓ = 30"),
        (BOTH, "except for beyond = projection, with thresholds = analytic), continued beyond"),
    ],
)
def test_words_in_short(options, words):
    assert words in in_short(SDecGMCA(**options), 64)


def test_a_failure_is_judged_as_far_as_the_maps_go():
    for nside, end in ((64, "10 < ℓ ≤ 128"), (128, "10 < ℓ < 200")):
        assert f"|C/C0 - 1| at {end} exceeds 10 %" in in_short(SDecGMCA(), nside, n_restarts=4)
