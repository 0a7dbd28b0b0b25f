"""Experiments on a grid of skies and methods: bad settings, what is made and deleted, small tables."""

from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from skies import mock_power

from himap.core.errors import InputError
from himap.instrument.beams.paper import Degraded, Oscillating
from himap.instrument.noise import noise_sigma
from himap.measures.bootstrap import sigma
from himap.measures.transfer import TransferFunction
from himap.paper import cleaned, pipeline
from himap.paper.choice import minka
from himap.paper.experiment_figures import transfer_figure
from himap.paper.experiments import find_experiment, n_sources, transfer
from himap.paper.grid import Sky, cases_and_methods, measured_recoveries
from himap.paper.mocks import Mock, own_recovery

made_up = partial(mock_power, n_degrees=26)
TINY = {"preset": "ci", "survey": {"nside": 8, "n_channels": 16, "box_cells": 16}}
BANDS = ["C/C0, 2-4", "C/C0, 5-9", "C/C0, 10-19", "P/P0, 0-0.03", "P/P0, 0.03-0.1", "P/P0, k > 0.1"]
USUAL = {
    "authors": {},
    "beam_errors": {"methods": [["beam_subspace", 3]], "errors": {}},
    "boxes": {},
    "claims": {"survey": {}},  # with channels for the scan
    "methods": {"beams": ["degraded", "oscillating"], "methods": [["pca", 3]]},
    "n_sources": {"beams": ["degraded"], "noises": [1], "methods": ["pca"], "n_mocks": 1, "n_sources_max": 3},
    "restarts": {"survey": {}},
    "transfer": {"methods": [["pca", 3]], "n_mocks": 2},
}


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        *(
            (name, given, message)
            for name in ("transfer", "beam_errors", "methods")
            for given, message in (
                ({"methods": [["pca"]]}, "[name, number of sources]"),
                ({"methods": ["pca"]}, "[name, number of sources]"),
                ({"methods": [["pca", 17]]}, "at most the number of channels"),
                ({"methods": [["kpca", 3]]}, "unknown method"),
                ({"methods": []}, "there must be methods"),
                ({"n_realisations": 0}, "between 1 and 1000"),
                ({"n_realisations": "2"}, "n_realisations"),
            )
        ),
        ("authors", {"n_restarts": 0}, "n_restarts"),
        *(
            ("boxes", {"survey": {"box_cells": n}}, f"box_cells is {n}: take a multiple of 4 from 16 to 2048")
            for n in (12, 18, 4096)
        ),
        ("boxes", {"survey": {"box_cells": 16, "n_channels": 7}}, "n_channels is 7: take 8 or more"),
        ("claims", {"n_realisations": 0}, "n_realisations must be a whole number between 1"),
        ("claims", {"n_restarts": 0}, "n_restarts must be a whole number between 1"),
        ("claims", {"n_sources_min": 5, "n_sources_max": 4}, "the scan needs"),
        ("claims", {"n_sources_max": 101}, "up to the 100 channels"),
        ("claims", {"n_sources_min": 0}, "the scan needs"),
        ("claims", {"galaxy": "milky way"}, "unknown Galaxy 'milky way'"),
        ("claims", {"ripple": "square"}, "ripple"),
        ("claims", {"plane_weight": 2.0}, "at most 1"),
        ("claims", {"reading": "backwards"}, "got 'backwards'"),
        ("claims", {"method": "pca"}, "SDecGMCA can be replaced by"),
        ("restarts", {"reading": "words"}, "reading must be one of"),
        ("claims", {"average": "median"}, "average must be one of means, ratios, middle, got 'median'"),
        ("claims", {"polynomial": "log"}, "variable must be temperature or logarithm, got 'log'"),
        *(
            (name, {"survey": {"taper": "hann"}}, "no taper, got taper='hann'")
            for name in ("transfer", "methods", "n_sources", "beam_errors")
        ),
        ("transfer", {"beam": "square"}, "square"),
        *(
            (name, given | {"ripple": "additive"}, "ripple is a reading of the oscillating beam, and")
            for name, given in (
                ("transfer", {"beam": "evolving"}),
                ("methods", {"beams": ["degraded", "evolving"]}),
                ("n_sources", {"beams": ["degraded"]}),
            )
        ),
        *(
            (name, {"reading": "code"}, "the reading 'code' is of SDecGMCA, which is not among the methods")
            for name in ("transfer", "beam_errors", "methods")
        ),
        ("transfer", {"n_mocks": 1}, "between 2 and 1000"),
        ("beam_errors", {"errors": {"width": [0.1], "colour": [1]}}, "got 'colour'"),
        ("beam_errors", {"errors": {"width": 0.1}}, "a list, such as {'width': [0.01]}, got {'width': 0.1}"),
        ("methods", {"corrected": [["pca"]]}, "corrected names ['pca'], but the methods are pca"),
        ("n_sources", {"beams": [["degraded"]]}, "are lists of names, got [['degraded']]"),
        ("n_sources", {"methods": [["pca", 3]]}, "are lists of names, got ['degraded'] and [['pca'"),
        *(
            ("methods", {"beams": beams}, "beams must be a list of names, each once")
            for beams in ([], ["degraded", "degraded"], "degraded", [["degraded"]])
        ),
        ("methods", {"methods": [["pca", [3]]]}, "pca has 1 numbers of sources for 2 beams"),
        ("methods", {"corrected": ["gmca"]}, "corrected names gmca, but the methods are pca"),
        ("methods", {"n_mocks": 0}, "n_mocks"),
        *(("n_sources", {"noises": one}, "1 first") for one in ([], [3], [1, 0], [1, "much"], [1, True])),
        ("n_sources", {"beams": []}, "there must be beams"),
        ("n_sources", {"methods": []}, "there must be methods"),
        ("n_sources", {"methods": ["gnilc"]}, "no parameter 'n_sources'"),
        ("n_sources", {"n_sources_max": 1}, "between 2 and 100"),
        ("n_sources", {"n_sources_max": 17}, "at most the number of channels"),
        ("n_sources", {"n_mocks": 0}, "between 1 and 1000"),
    ],
)
def test_bad_settings_are_refused_before_any_work(name, given, message):
    with pytest.raises(InputError) as caught:
        find_experiment(name).skies(**TINY | USUAL[name] | given)
    assert message in str(caught.value)


def test_a_ripple_is_of_the_oscillating_beam_among_others():
    given = {"beams": ["degraded", "Oscillating"], "ripple": "additive"}
    (sky, *_) = find_experiment("methods").skies(**TINY | USUAL["methods"] | given)
    assert [case.beam for case in sky.methods] == [Degraded(), Oscillating(ripple="additive")]


class TestMaking:
    @pytest.fixture
    def sky(self, tmp_path, monkeypatch):
        """Of PCA and two mocks; nothing is in the cache."""
        monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))
        (case,), removers = cases_and_methods(**TINY, methods=[["pca", 3]], n_realisations=1)
        return Sky(methods={case: removers}, mocks=(Mock(seed=1), Mock(seed=2)))

    def test_observations_and_separations_are_deleted(self, sky, monkeypatch):
        before = measured_recoveries(sky)
        ((case, (pca,)),) = sky.methods.items()
        assert own_recovery.is_cached(case, pca) and not cleaned.separation.is_cached(case, pca)
        assert not any(made.is_cached(case) for made in (pipeline.observation, pipeline.peak_masked))
        assert not pipeline.hi_of_sky.is_cached(replace(case.survey, seed=1).sky)
        # And nothing is observed for what is there.
        monkeypatch.setattr(pipeline.observation, "_function", lambda case: 1 / 0)
        ((*_, own, transfers),) = measured_recoveries(sky)
        assert (own.output.power == before[0][2].output.power).all() and len(transfers.mocks) == 2


class TestTransfer:
    @pytest.mark.parametrize("left", [0, 0.05])
    def test_in_every_band(self, left):
        """0.8 of the amplitude of mocks comes back; the residual of the data has the power 0.9.

        Of which some is left of the foreground, as far as that is known from the data.
        """
        mocks = TransferFunction(mocks=(made_up(0.64), made_up(0.64)))
        found = transfer.corrected_bands(made_up(0.9), made_up(left).output, mocks)
        assert [row["band"] for row in found] == BANDS
        for row in found:
            unlike = left + 0.64 - 0.8
            both = [row[name] for name in ("uncorrected", "corrected")]
            assert both == pytest.approx([0.9, (0.9 - unlike) / 0.8])
            assert row["foreground"] == pytest.approx(unlike / 0.8)
            assert row["error_bar"] == pytest.approx(0, abs=1e-12)

    def test_error_bars_are_the_scatter_of_mocks(self):
        found = TransferFunction(mocks=(made_up(1.0), made_up(0.64)))
        row, *_ = transfer.corrected_bands(made_up(0.9), made_up(0.1).output, found)
        first, second = found.errors("angular")[:, 5]
        assert row["error_bar"] == pytest.approx(sigma(np.array([first, second])))

    @pytest.mark.parametrize("trials", [2, 20])
    def test_how_often_an_interval_holds_what_is_right(self, rng, trials):
        """As drawn: of two trials always."""
        hits = rng.binomial(trials, 0.68, size=2000)
        ends = [stats.binomtest(int(n), trials).proportion_ci() for n in hits]
        drawn = np.mean([one.low <= 0.68 <= one.high for one in ends])
        assert transfer.chance_of_right(trials) == pytest.approx(drawn, abs=0.015)
        assert trials > 2 or drawn == 1

    def test_no_two_skies_share_a_mock(self):
        several = transfer.skies(**TINY, methods=[["pca", 3]], n_realisations=3, n_mocks=4)
        mocks = [mock.seed for sky in several for mock in sky.mocks]
        assert len(set(mocks)) == 12 and not set(mocks) & {sky.survey.seed for sky in several}

    @pytest.mark.filterwarnings("ignore::himap.removal.base.SeparationWarning")
    def test_table_of_a_small_sky(self):
        methods = [["pca", 3], ["gnilc", None]]
        more = TINY | {"survey": TINY["survey"] | {"n_channels": 32}}  # enough for smooth spectra
        grid = transfer.skies(**more, methods=methods, n_realisations=2, n_mocks=2)
        table = transfer.EXPERIMENT.table(grid)
        keys = table.drop_duplicates(["seed", "method"])[["seed", "method", "n_sources"]]
        expected = [[seed, *pair] for seed in (2025, 2026) for pair in (["pca", 3], ["gnilc", 0])]
        assert keys.to_numpy().tolist() == expected and table["band"].tolist() == 4 * BANDS
        assert table.select_dtypes("float").notna().all(axis=None)

    @pytest.fixture
    def table(self):
        names = ("seed", "band", "uncorrected", "corrected")
        more = {"method": "pca", "n_sources": 5, "error_bar": 0.02, "foreground": 0.03}
        rows = (1, BANDS[0], 0.9, 1.01), (2, BANDS[0], 0.9, 1.05), (1, BANDS[3], 0.3, 1.5)
        return transfer.EXPERIMENT.frame([dict(zip(names, row, strict=True)) | more for row in rows])

    def test_summary(self, table):
        first, second = transfer.EXPERIMENT.summary(table).to_numpy().tolist()
        numbers = ["0.9000", "1.0300", "0.0283", "0.0200", "0.0300"]
        assert first == ["PCA 5", BANDS[0], *numbers, "1 of 2 (1 to 99 %)", "3.25"]
        assert second[2:5] == ["0.3000", "1.5000", "nan"]
        assert second[-2:] == ["0 of 1 (0 to 98 %)", "625.00"]

    @pytest.mark.parametrize("hits", [0, 4, 28])
    def test_coverage_has_the_interval_of_its_tails(self, hits):
        """At the ends of the interval 2.5 % of binomial draws are as far out, or it ends at 0 or 1."""
        table = pd.DataFrame({"corrected": [1.01] * hits + [1.1] * (28 - hits), "error_bar": 0.02})
        found, trials, low, high = transfer.coverage(table)
        assert (found, trials) == (hits, 28)
        assert low == 0 if hits == 0 else stats.binom.sf(hits - 1, 28, low) == pytest.approx(0.025)
        assert high == 1 if hits == 28 else stats.binom.cdf(hits, 28, high) == pytest.approx(0.025)

    def test_the_systematic_error_is_what_was_subtracted(self, table):
        """In quadrature, whatever its sign; without it the truth is as often within the bar as before."""
        table["foreground"] = [0.0, -0.05, 0.5]
        bars = np.sqrt(table["error_bar"] ** 2 + table["foreground"] ** 2)
        assert transfer.with_systematic(table)["error_bar"].tolist() == pytest.approx(bars.tolist())
        assert [transfer.coverage(one)[0] for one in (table, transfer.with_systematic(table))] == [1, 3]

    def test_figure_has_a_panel_for_each_kind(self, table):
        figure = transfer_figure({"one Galaxy": table, "another": table[:1]})
        titles = [axes.get_title() for axes in figure.axes if axes.get_visible()]
        assert titles == ["one Galaxy", "one Galaxy", "another"]
        uncorrected, corrected = figure.axes[0].get_lines()[-2:]
        assert uncorrected.get_ydata().tolist() == [0.9] and uncorrected.get_fillstyle() == "none"
        assert corrected.get_ydata() == pytest.approx([1.03]) and corrected.get_label() == "PCA 5"

    def test_axes_hold_all_that_is_corrected(self, table):
        """And 20 % in any case; what is not corrected, or to no number, moves none of them."""
        angular, frequency = transfer_figure({"": table}).axes
        assert angular.get_ylim() == (0.8, 1.2)
        low, high = frequency.get_ylim()
        assert low == 0.8 and 1.5 < high < 1.6
        endless = transfer_figure({"": table.assign(corrected=[0.6, np.nan, np.inf])}).axes
        assert 0.5 < endless[0].get_ylim()[0] < 0.6 and endless[1].get_ylim() == (0.8, 1.2)

    def test_a_method_without_a_number_of_sources_goes_by_its_name(self, table):
        own = table.assign(method="gnilc", n_sources=0)
        assert set(transfer.EXPERIMENT.summary(own)["method"]) == {"GNILC"}
        assert transfer_figure({"": own}).axes[0].get_legend_handles_labels()[1] == ["GNILC"]


class TestNumberOfSources:
    GRID = TINY | USUAL["n_sources"]

    def test_rows(self):
        given = {"noises": [1, 10], "methods": ["pca", "beam_subspace"]}
        grid = n_sources.skies(**self.GRID | given, n_realisations=1)
        table = n_sources.EXPERIMENT.table(grid)
        assert len(table) == 2 * (6 + 5)
        assert not table.duplicated(["seed", "noise", "method", "criterion"]).any()
        assert table["noise"].round(6).unique().tolist() == [1, 10]
        assert set(table.loc[table["method"] == "pca", "criterion"]) == set(n_sources.CRITERIA)
        assert table["best"].between(1, 3).all()
        assert (table["bias"].notna() == table["recommended"].between(1, 3)).all()
        assert (table["bias"].dropna() >= table["least_bias"][table["bias"].notna()]).all()
        right = table[table["recommended"] == table["best"]]
        assert right["bias"].tolist() == right["least_bias"].tolist() and len(right)
        assert minka(next(iter(grid[0].methods))) in range(1, 17)

    def test_cases(self):
        given = {"beams": ["degraded", "evolving"], "noises": [1, 3]}
        found = n_sources.skies(**self.GRID | given, n_realisations=2)
        assert [[case.survey.seed for case in sky.methods] for sky in found] == [[2025] * 4, [2026] * 4]
        first, second, *others = found[0].methods
        assert [case.beam.name for case in (first, second, *others)] == ["degraded"] * 2 + ["evolving"] * 2
        assert noise_sigma(second.survey) == pytest.approx(3 * noise_sigma(first.survey))
        assert found[0].survey == first.survey

    def test_summary(self):
        first = {"seed": 7, "beam": "degraded", "noise": 1.0, "method": "pca", "criterion": "bic"}
        first |= {"best": 3, "least_bias": 0.1}
        pairs = [(4, 0.2), (3, 0.1), (9, None), (0, None), (2, 0.4), (1, 0.5)]
        rows = [first | {"recommended": number, "bias": bias} for number, bias in pairs]
        table = n_sources.EXPERIMENT.frame(rows)
        (row,) = n_sources.EXPERIMENT.summary(table).to_numpy().tolist()
        assert row == ["PCA", "information criterion (BIC)", "1", "1", "1", "1", "1", "1", "0.300", "0.100"]
        (row,) = n_sources.EXPERIMENT.summary(table[2:4]).to_numpy().tolist()
        assert row[-2:] == ["", ""]
