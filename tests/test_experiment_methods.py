"""Methods side by side: curves of a made-up sky, the table of a small one, and its figures."""

from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest
from skies import mock_power

from himap.core.errors import InputError
from himap.measures.transfer import TransferFunction
from himap.paper.experiment_figures import labels_of, methods_figure, methods_table, signed
from himap.paper.experiments import methods, transfer
from himap.paper.experiments.methods import EXPERIMENT, METHOD, curves, distances, in_bands, skies
from himap.paper.grid import measured_recoveries
from himap.removal import GNILC, PCA, SDecGMCA

made_up = partial(mock_power, n_degrees=131)
TINY = {"preset": "ci", "survey": {"nside": 8, "n_channels": 32, "box_cells": 16}}


def table_of(rows, **changed):
    """A table of the last columns, of PCA 3 through the degraded beam on the sky 1 unless changed."""
    first = {"seed": 1, "beam": "degraded", "method": "pca", "n_sources": 3, "corrected": False}
    return EXPERIMENT.frame([first | row | changed for row in rows])


class TestCurves:
    SHARE = np.linspace(0.1, 2, 131)[:, None]

    def test_means_over_bins(self):
        table = table_of(curves(made_up(self.SHARE)))
        angular, frequency = (table[table["kind"] == kind] for kind in ("angular", "frequency"))
        assert set(angular["step"]) == {1.0}
        assert frequency["step"].to_numpy() == pytest.approx(2 * np.pi / 500)
        assert frequency["low"].iloc[0] == 1  # no k = 0
        bins = list(zip(angular["low"], angular["high"], strict=True))
        means = [self.SHARE[low : high + 1].mean() for low, high in bins]
        assert angular["ratio"].tolist() == pytest.approx(means)
        assert methods.middles(angular).tolist() == [(low + high) / 2 for low, high in bins]
        assert {2, 5, 10, 20, 40} <= set(angular["low"]) and bins[-1][1] == 99  # no bin is in two bands

    def test_bins_follow_each_other_and_have_similar_logarithmic_widths(self):
        table = table_of(curves(made_up(self.SHARE)))
        for _, own in table.groupby("kind"):
            assert (own["low"].to_numpy()[1:] == own["high"].to_numpy()[:-1] + 1).all()
        wide = table[(table["kind"] == "angular") & (table["low"] >= 40)]
        ratio = (wide["high"] + 1) / wide["low"]
        assert (wide["high"] - wide["low"] + 1).sum() == 60 and ratio.min() > 1.1 and ratio.max() < 1.25

    def test_bands_are_those_of_the_single_multipoles(self):
        own = made_up(self.SHARE)
        found = in_bands(table_of(curves(own))).droplevel([*METHOD, "seed"]).to_dict()
        expected = own.band_means()
        assert found == pytest.approx(expected)

    def test_over_the_transfer_function(self):
        share = np.linspace(0.1, 0.9, 251)[None]
        mocks = TransferFunction(mocks=(made_up(share),))  # what is common is the root of it
        ratios = [row["ratio"] for row in curves(made_up(share**0.5), mocks)]
        assert ratios == pytest.approx(np.ones(len(ratios)), rel=1e-6)

    def test_over_a_transfer_function_below_zero(self):
        """As a run of a chaotic method that fails with the mocks can have it."""
        own = made_up(np.ones((1, 251)))
        against = replace(own, cross=replace(own.cross, power=-own.cross.power))
        ratios = [row["ratio"] for row in curves(own, TransferFunction(mocks=(against,)))]
        assert ratios == pytest.approx(-np.ones(len(ratios)))


def test_a_case_for_each_beam():
    pairs = [["sdecgmca", [3, 5]], ["pca", [3, 5]], ["pca", [3, 6]], ["gnilc", None]]
    beams = ["degraded", "oscillating"]
    found = skies(**TINY, beams=beams, methods=pairs, reading="letter", n_realisations=2)
    assert [[case.survey.seed for case in sky.methods] for sky in found] == [[2025] * 2, [2026] * 2]
    first, second = found[0].methods.items()
    assert (first[0].beam.name, second[0].beam.name) == ("degraded", "oscillating")
    sdecgmca, *others = first[1]
    assert isinstance(sdecgmca, SDecGMCA) and (sdecgmca.n_sources, sdecgmca.thresholds) == (3, "mad")
    assert others == [PCA(n_sources=3), GNILC()]  # a method that is there already is not there again
    assert [getattr(one, "n_sources", None) for one in second[1]] == [5, 5, 6, None]


def test_of_a_small_sky():
    few = TINY | {"n_mocks": 2, "n_realisations": 1}
    given = {"methods": [["pca", [2, 3]], ["gnilc", None]], "corrected": ["pca"]}
    grid = skies(**few, **given, beams=["degraded", "oscillating"])
    table = EXPERIMENT.table(grid)
    assert list(table.groupby(METHOD, sort=False).groups) == [
        ("degraded", "pca", 2, False),
        ("degraded", "pca", 2, True),
        ("degraded", "gnilc", 0, False),
        ("oscillating", "pca", 3, False),
        ("oscillating", "pca", 3, True),
        ("oscillating", "gnilc", 0, False),
    ]
    # Its bands are those of the experiment on transfer functions, and of the ratios over these.
    other = transfer.EXPERIMENT.table(transfer.skies(**few, methods=[["pca", 3]])).set_index("band")
    measured = measured_recoveries(grid[0])
    ((power, kept),) = [row[2:] for row in measured if row[1] == PCA(n_sources=3)]
    ratios = {kind: ratio / getattr(kept, kind) for kind, ratio in power.ratios().items()}
    expected = other["uncorrected"].to_dict(), power.band_means(ratios)
    for corrected, bands in zip((False, True), expected, strict=True):
        own = in_bands(table).loc["oscillating", "pca", 3, corrected].droplevel("seed")
        assert own.to_dict() == pytest.approx(bands)


ANGULAR = [
    {"kind": "angular", "low": low, "high": high, "step": 1.0, "ratio": ratio}
    for low, high, ratio in ((2, 4, 0.5), (5, 9, 1.0), (10, 14, 1.1), (15, 19, 1.3))
]
ALONG = [
    {"kind": "frequency", "low": low, "high": high, "step": 0.02, "ratio": ratio}
    for low, high, ratio in ((1, 1, 0.4), (2, 4, 1.0), (5, 7, 0.9))
]
OTHER = [row | {"ratio": ratio} for row, ratio in zip(ANGULAR, (0.7, 1.0, 1.1, 1.1), strict=True)]


def test_two_beams_of_one_name_are_kept_apart():
    beams = ["rippled", "rippled:amplitude=0.3"]
    (sky,) = skies(**TINY, beams=beams, methods=[["pca", 3]], n_realisations=1, n_mocks=1, corrected=[])
    assert EXPERIMENT.table([sky])["beam"].unique().tolist() == beams


def two_skies(**changed):
    rows = [row | {"seed": 1} for row in ANGULAR + ALONG] + [row | {"seed": 2} for row in OTHER + ALONG]
    return EXPERIMENT.frame([table_of([row]).to_dict("records")[0] | row | changed for row in rows])


class TestSummary:
    def test_bands(self):
        found = in_bands(two_skies()).droplevel(METHOD)
        assert found["C/C0, 10-19"].to_dict() == pytest.approx({1: 1.2, 2: 1.1})
        assert found["C/C0, 2-4"].to_dict() == pytest.approx({1: 0.5, 2: 0.7})
        assert found["P/P0, 0-0.03", 1] == pytest.approx(0.4)
        assert len(found) == 12

    def test_rows(self):
        first, *_ = EXPERIMENT.summary(two_skies()).to_numpy().tolist()
        assert first == ["degraded", "PCA 3", "uncorrected", "C/C0, 2-4", "0.6000", "0.5320", "0.6680"]
        other, *_ = EXPERIMENT.summary(table_of(ANGULAR, corrected=True, n_sources=0)).to_numpy().tolist()
        assert other[1:3] == ["PCA", "corrected"] and len(set(other[-3:])) == 1

    def test_worst_band_of_the_worst_table(self):
        key = ("degraded", "pca", 3, False)
        good = two_skies(ratio=1.0)
        assert distances([two_skies(), good]) == {key: pytest.approx(0.15)}  # not that of C/C0, 2-4
        assert distances([good, two_skies(ratio=0.6)]) == {key: pytest.approx(-0.4)}

    def test_failures_are_counted_over_all_tables(self):
        """Skies of one seed in two tables are two skies; what is corrected is not counted."""
        corrected = table_of(ANGULAR, ratio=2.0, corrected=True)
        tables = [two_skies(ratio=1.08), two_skies(ratio=1.11), corrected]
        assert methods.failures(tables) == {("degraded", "pca", 3): 2}

    def test_a_failure_on_one_sky_does_not_decide(self):
        failed = table_of(ANGULAR + ALONG, seed=3, ratio=1e3)
        (distance,) = distances([pd.concat([two_skies(), failed])]).values()
        assert distance == pytest.approx(0.2)


class TestFigure:
    def test_labels(self):
        expected = {
            ("degraded", "pca", 3): ("pca", "3/5"),
            ("oscillating", "pca", 5): ("pca", "3/5"),
            ("oscillating", "pca", 6): ("pca", "3/6"),
            ("degraded", "gnilc", 0): ("gnilc", ""),
            ("oscillating", "gnilc", 0): ("gnilc", ""),
            ("oscillating", "gmca", 5): ("gmca", "5"),
        }
        named = [dict(zip(METHOD[:3], key, strict=True)) for key in expected]
        tables = [table_of(ANGULAR, **names) for names in named]
        assert labels_of(pd.concat(tables, ignore_index=True)) == expected

    def test_median_and_range(self):
        """A sky on which a method fails moves the line to the next sky, not away."""
        failed = table_of(ANGULAR, seed=3, ratio=1e3)
        skies = {"one": pd.concat([two_skies(), failed]), "another": table_of(ANGULAR)}
        figure = methods_figure(skies, "angular")
        first, second = figure.axes
        assert (first.get_title(), second.get_title()) == ("one", "another")
        *_, line = first.get_lines()
        assert line.get_xdata() == pytest.approx([3, 7, 12, 17])
        assert line.get_ydata() == pytest.approx([0.7, 1.0, 1.1, 1.3])
        (shade,) = first.collections
        heights = shade.get_paths()[0].vertices[:, 1]
        assert heights.min() == pytest.approx(0.5 + 0.32 * 0.2) and first.get_yscale() == "function"

    def test_no_such_curves(self):
        with pytest.raises(InputError, match="nothing was corrected"):
            methods_figure({"one": two_skies()}, "frequency", corrected=True)

    def test_table(self):
        high = {"beam": "oscillating", "n_sources": 5, "ratio": 3.0}
        rows = [*two_skies().to_dict("records"), *table_of(ANGULAR, **high).to_dict("records")]
        rows += table_of(ANGULAR, **high, corrected=True).to_dict("records")
        header, (row,) = methods_table([EXPERIMENT.frame(rows)])
        through = ("degraded", "oscillating")
        assert header == ["method", *through, *(f"{beam}, corrected" for beam in through)]
        percents = [text and f"{text}\N{NO-BREAK SPACE}%" for text in ("+15", "+200", "", "+200")]
        assert row == ("PCA 3/5", *(text or "–" for text in percents))

    @pytest.mark.parametrize(
        ("value", "text"), [(-0.0344, "−3.4 %"), (0.002, "+0.2 %"), (-0.12, "−12 %"), (np.nan, "–")]
    )
    def test_texts(self, value, text):
        assert signed(value) == text.replace(" ", "\N{NO-BREAK SPACE}")
