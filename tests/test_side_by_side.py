"""Methods side by side: curves of a made-up sky, the record of a small one, and its figures."""

from dataclasses import replace

import numpy as np
import pytest

from himap.errors import InputError
from himap.measures.transfer import CylindricalPower, Recovery, TransferFunction
from himap.paper import corrections, pipeline, side_by_side
from himap.paper.corrections import cases_and_methods
from himap.paper.mocks import Mock
from himap.paper.record_file import check_record, read_record, write_record
from himap.paper.side_by_side import (
    Curve,
    band_means,
    curves,
    evaluate,
    furthest,
    grouped,
    skies_and_methods,
    summary,
)
from himap.paper.side_by_side_figures import labels_of, side_by_side_figure
from himap.paper.side_by_side_table import distance, overview, signed
from himap.removal import GNILC, PCA, SDecGMCA

TINY = {"preset": "ci", "survey": {"nside": 8, "n_channels": 16, "box_cells": 16}}


def made_up(kept):
    """Of 500 channels of 1 MHz, l up to 130, of which a share `kept` (n_l, n_k) comes back."""

    def power(value):
        return CylindricalPower(
            power=np.broadcast_to(value, (131, 251)).astype(float), n_channels=500, channel_width=1.0
        )

    return Recovery(put_in=power(1.0), came_back=power(kept), common=power(np.sqrt(kept)))


@pytest.fixture(scope="module")
def case():
    (case,), _ = cases_and_methods(**TINY, n_realisations=1)
    return case


class TestCurves:
    def test_means_over_bins(self, case):
        kept = np.linspace(0.1, 2, 131)[:, None]
        angular, frequency = curves(case, PCA(n_sources=3), made_up(kept))
        assert (angular.seed, angular.beam, angular.method, angular.n_sources) == (
            2025,
            "oscillating",
            "pca",
            3,
        )
        assert not angular.corrected and angular.step == 1
        assert frequency.step == pytest.approx(2 * np.pi / 500)
        assert frequency.edges[0] == 1  # no k = 0
        first, last = angular.edges[:-1], angular.edges[1:]
        expected = [kept[low:high].mean() for low, high in zip(first, last, strict=True)]
        assert angular.ratio == pytest.approx(expected)
        assert angular.at == pytest.approx(
            [(low + high - 1) / 2 for low, high in zip(first, last, strict=True)]
        )
        assert {2, 5, 10, 20, 40, 100} <= set(angular.edges)  # no bin is in two bands

    def test_bands_are_those_of_the_single_multipoles(self, case):
        kept = np.linspace(0.1, 2, 131)[:, None]
        own = made_up(kept)
        angular, frequency = curves(case, PCA(n_sources=3), own)
        by_band = {
            row.band: row.raw
            for row in corrections.corrections(
                1, PCA(n_sources=3), own, TransferFunction(recoveries=(own, own))
            )
        }
        assert angular.means | frequency.means == pytest.approx(by_band)

    def test_over_the_transfer_function(self, case):
        kept = np.linspace(0.1, 0.9, 251)[None]
        transfer = TransferFunction(recoveries=(made_up(kept),))  # what is common is the root of it
        for row in curves(case, PCA(n_sources=3), made_up(kept**0.5), transfer):
            assert row.corrected
            assert row.ratio == pytest.approx(np.ones(len(row.ratio)), rel=1e-6)


class TestSkies:
    def test_a_case_for_each_beam(self):
        methods = [["sdecgmca", [3, 5]], ["pca", [3, 5]], ["pca", [3, 6]], ["gnilc", None]]
        skies = skies_and_methods(
            **TINY, beams=["degraded", "oscillating"], methods=methods, reading="letter", n_realisations=2
        )
        assert [[case.survey.seed for case in sky] for sky in skies] == [[2025] * 2, [2026] * 2]
        first, second = skies[0].items()
        assert (first[0].beam.name, second[0].beam.name) == ("degraded", "oscillating")
        sdecgmca, *others = first[1]
        assert isinstance(sdecgmca, SDecGMCA) and (sdecgmca.n_sources, sdecgmca.thresholds) == (3, "mad")
        assert others == [PCA(n_sources=3), GNILC()]  # a method that is there already is not there again
        assert [getattr(one, "n_sources", None) for one in second[1]] == [5, 5, 6, None]

    @pytest.mark.parametrize(
        ("given", "told"),
        [
            ({"beams": []}, "each once"),
            ({"beams": ["degraded", "degraded"]}, "each once"),
            ({"beams": "degraded"}, "each once"),
            ({"methods": [["pca", [3]]]}, "pca has 1 numbers of sources for 2 beams"),
            ({"methods": [["pca"]]}, "[name, number of sources]"),
            ({"n_realisations": 0}, "between 1 and 1000"),
            ({"n_realisations": "2"}, "n_realisations"),
        ],
    )
    def test_refused(self, given, told):
        usual = {"beams": ["degraded", "oscillating"], "methods": [["pca", 3]]}
        with pytest.raises(InputError) as caught:
            skies_and_methods(**TINY, **usual | given)
        assert told in str(caught.value)


class TestEvaluate:
    @pytest.fixture
    def skies(self):
        return skies_and_methods(
            **TINY,
            beams=["degraded", "oscillating"],
            methods=[["pca", [2, 3]], ["gnilc", None]],
            n_realisations=1,
        )

    def test_rows_and_what_stays(self, skies, tmp_path, monkeypatch):
        monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))  # what was there before stays
        rows = evaluate(skies, [Mock(seed=1)], ["pca"])
        keys = list(dict.fromkeys((row.beam, row.method, row.n_sources, row.corrected) for row in rows))
        assert keys == [
            ("degraded", "pca", 2, False),
            ("degraded", "pca", 2, True),
            ("degraded", "gnilc", 0, False),
            ("oscillating", "pca", 3, False),
            ("oscillating", "pca", 3, True),
            ("oscillating", "gnilc", 0, False),
        ]
        assert not any(pipeline.observation.is_cached(case) for case in skies[0])
        monkeypatch.setattr(corrections.plan, "make_observations", lambda asked: [] if not asked else 1 / 0)
        assert evaluate(skies, [Mock(seed=1)], ["pca"]) == rows

    def test_those_of_the_other_record(self, skies):
        """Bands of the curves are the bands that `himap record corrections` tells of."""
        mocks = [Mock(seed=1), Mock(seed=2)]
        rows = evaluate(skies, mocks, ["pca"])
        case = list(skies[0])[1]
        other = corrections.evaluate([case], [PCA(n_sources=3)], mocks)
        for corrected, field in ((False, "raw"), (True, "corrected")):
            found = {
                band: value
                for row in rows
                if (row.beam, row.method, row.corrected) == ("oscillating", "pca", corrected)
                for band, value in row.means.items()
            }
            assert found == pytest.approx({row.band: getattr(row, field) for row in other})

    def test_what_is_not_there_is_not_corrected(self, skies):
        with pytest.raises(InputError, match="to be corrected is gmca, but the methods are gnilc, pca"):
            evaluate(skies, [Mock(seed=1)], ["gmca"])


ROW = Curve(
    seed=1,
    beam="degraded",
    method="pca",
    n_sources=3,
    corrected=False,
    kind="angular",
    step=1.0,
    edges=[2, 5, 10, 15, 20],
    ratio=[0.5, 1.0, 1.1, 1.3],
)
ALONG = replace(ROW, kind="frequency", step=0.02, edges=[1, 2, 5, 8], ratio=[0.4, 1.0, 0.9])
ROWS = [ROW, ALONG, replace(ROW, seed=2, ratio=[0.7, 1.0, 1.1, 1.1]), replace(ALONG, seed=2)]


class TestSummary:
    def test_bands(self):
        assert ROW.means == pytest.approx({"C/C0, 2-4": 0.5, "C/C0, 5-9": 1.0, "C/C0, 10-19": 1.2})
        assert list(ALONG.means) == ["P/P0, 0-0.03", "P/P0, 0.03-0.1", "P/P0, k > 0.1"]
        (found,) = band_means(ROWS).values()
        assert found["C/C0, 10-19"] == pytest.approx([1.2, 1.1])
        assert furthest(found, ["C/C0, 5-9", "C/C0, 10-19"]) == (
            "C/C0, 10-19",
            pytest.approx(1.15),
            pytest.approx(0.1 / np.sqrt(2)),
        )

    def test_lines(self):
        first, *_ = summary(ROWS)
        assert first == ("degraded", "pca 3", "as left", "C/C0, 2-4", "0.6000", "0.1414")
        assert summary([replace(ROW, corrected=True, n_sources=0)])[0][1:3] == ("pca", "corrected")
        assert summary([ROW])[0][-1] == "nan"

    def test_a_file(self, tmp_path):
        path = tmp_path / "side_by_side.json"
        write_record(ROWS, path, {"preset": "ci"})
        assert read_record(Curve, path) == (ROWS, {"preset": "ci"})
        close = replace(ROW, ratio=[0.5001, 1.0, 1.1, 1.3])
        check_record([close, ALONG], path, "b")
        with pytest.raises(InputError, match="1 of 2 rows"):
            check_record([replace(ROW, ratio=[0.51, 1.0, 1.1, 1.3]), ALONG], path, "c")
        with pytest.raises(InputError, match="1 of 2 rows"):
            check_record([replace(ROW, edges=ROW.edges[:-1], ratio=ROW.ratio[:-1]), ALONG], path, "c")


class TestFigure:
    def test_labels(self):
        rows = [
            replace(ROW, beam=beam, method=method, n_sources=n)
            for beam, method, n in (
                ("degraded", "pca", 3),
                ("oscillating", "pca", 5),
                ("oscillating", "pca", 6),
                ("degraded", "gnilc", 0),
                ("oscillating", "gnilc", 0),
                ("oscillating", "gmca", 5),
            )
        ]
        assert labels_of(rows) == {
            ("degraded", "pca", 3): ("pca", "3/5"),
            ("oscillating", "pca", 5): ("pca", "3/5"),
            ("oscillating", "pca", 6): ("pca", "3/6"),
            ("degraded", "gnilc", 0): ("gnilc", ""),
            ("oscillating", "gnilc", 0): ("gnilc", ""),
            ("oscillating", "gmca", 5): ("gmca", "5"),
        }

    def test_mean_and_range(self):
        figure = side_by_side_figure({"one": ROWS, "another": ROWS[:2]}, "angular", columns=2)
        first, second = figure.axes
        assert (first.get_title(), second.get_title()) == ("one", "another")
        *_, line = first.get_lines()
        assert line.get_ydata() == pytest.approx([0.6, 1.0, 1.1, 1.2])
        (shade,) = first.collections
        heights = shade.get_paths()[0].vertices[:, 1]
        assert heights.min() == pytest.approx(0.5 + 0.16 * 0.2) and first.get_yscale() == "function"

    def test_no_such_curves(self):
        with pytest.raises(InputError, match="nothing was corrected"):
            side_by_side_figure({"one": ROWS}, "frequency", corrected=True)

    def test_only_some(self):
        rows = [ROW, replace(ROW, method="gmca")]
        figure = side_by_side_figure({"": rows}, "angular", methods=["gmca"])
        (legend,) = figure.legends
        assert [text.get_text() for text in legend.get_texts()] == ["GMCA 3"]


class TestTable:
    REAL = [replace(row, ratio=[1.0] * len(row.ratio)) for row in ROWS]

    def test_worst_band_of_the_worst_galaxy(self):
        judged = ("C/C0, 10-19", "P/P0, 0.03-0.1", "P/P0, k > 0.1")
        assert distance([ROWS, self.REAL], "degraded", "pca", 3, of=judged) == pytest.approx(0.15)
        assert distance([ROWS], "degraded", "pca", 3, of=["C/C0, 2-4"]) == pytest.approx(-0.4)
        assert np.isnan(distance([ROWS], "degraded", "pca", 4))

    def test_cells(self):
        more = replace(ROW, beam="oscillating", n_sources=5, ratio=[1.0, 1.0, 3.0, 3.0])
        header, (line,) = overview([[*ROWS, more, replace(more, corrected=True)]], of=["C/C0, 10-19"])
        assert header == [
            "method",
            *("degraded", "oscillating"),
            *("degraded, corrected", "oscillating, corrected"),
        ]
        assert line == tuple(
            text.replace(" %", "\N{NO-BREAK SPACE}%")
            for text in ("PCA 3/5", "+15 %", "+200 %", "–", "+200 %")
        )

    @pytest.mark.parametrize(
        ("value", "text"), [(-0.0344, "−3.4 %"), (0.002, "+0.2 %"), (-0.12, "−12 %"), (np.nan, "–")]
    )
    def test_texts(self, value, text):
        assert signed(value) == text.replace(" ", "\N{NO-BREAK SPACE}")


def test_order_of_groups():
    assert list(grouped(ROWS)) == [
        ("degraded", "pca", 3, False, "angular"),
        ("degraded", "pca", 3, False, "frequency"),
    ]


def test_width_of_bins():
    edges = np.array(side_by_side._edges([np.arange(200) >= 40]))
    assert edges[0] == 40 and edges[-1] == 200
    assert np.min(edges[1:] / edges[:-1]) > 1.1 and np.max(edges[1:] / edges[:-1]) < 1.25
