"""How well transfer functions correct what is lost: on a made-up sky, and on a small real one."""

import json
import math
import os
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from himap.errors import InputError
from himap.measures.transfer import CylindricalPower, Recovery, TransferFunction
from himap.paper import cleaned, corrections, pipeline
from himap.paper.corrections import Correction, cases_and_methods, evaluate, grouped, summary
from himap.paper.corrections_figures import record_figure
from himap.paper.mocks import Mock, own_recovery
from himap.paper.record_file import check_record, read_record, write_record
from himap.removal import PCA, SDecGMCA

TINY = {"preset": "ci", "survey": {"nside": 8, "n_channels": 16, "box_cells": 16}}
BANDS = ["C/C0, 2-4", "C/C0, 5-9", "C/C0, 10-19", "P/P0, 0-0.03", "P/P0, 0.03-0.1", "P/P0, k > 0.1"]


def made_up(kept, put_in=1.0):
    """Of 500 channels of 1 MHz, l up to 25, of which a share comes back."""

    def power(value):
        return CylindricalPower(power=np.full((26, 251), float(value)), n_channels=500, channel_width=1.0)

    return Recovery(
        put_in=power(put_in), came_back=power(kept * put_in), common=power(np.sqrt(kept) * put_in)
    )


class TestOneSky:
    def test_in_every_band(self):
        mocks = TransferFunction(recoveries=(made_up(0.81), made_up(0.81)))
        found = corrections.corrections(7, PCA(n_sources=3), made_up(0.9), mocks)
        assert [one.band for one in found] == BANDS
        for one in found:
            assert (one.seed, one.method, one.n_sources) == (7, "pca", 3)
            assert (one.raw, one.corrected, one.by_auto) == pytest.approx((0.9, 1.0, 0.9 / 0.81))
            assert one.sigma == pytest.approx(0, abs=1e-12)

    def test_error_bars_are_the_scatter_of_mocks(self):
        mocks = TransferFunction(recoveries=(made_up(1.0), made_up(0.64)))
        (one, *_) = corrections.corrections(7, PCA(), made_up(0.9), mocks)
        assert one.sigma == pytest.approx(np.sqrt((0.25**2 + 0.2**2) / 2))


class TestEvaluate:
    @pytest.fixture
    def setting(self):
        return cases_and_methods(**TINY, methods=[["pca", 3]], n_realisations=2)

    def test_seeds_and_methods(self, setting):
        cases, removers = setting
        assert [case.survey.seed for case in cases] == [2025, 2026]
        assert removers == [PCA(n_sources=3)]
        cases, (remover,) = cases_and_methods(**TINY, methods=[["sdecgmca", 4]], reading="letter")
        assert len(cases) == 20 and isinstance(remover, SDecGMCA)
        assert (remover.n_sources, remover.thresholds) == (4, "mad")

    def test_rows_and_what_stays(self, setting, tmp_path, monkeypatch):
        monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))  # what was there before stays
        cases, removers = setting
        rows = evaluate(cases, removers, [Mock(seed=1), Mock(seed=2)])
        assert [row.seed for row in rows] == [2025] * 6 + [2026] * 6
        assert [row.band for row in rows[:6]] == BANDS
        assert own_recovery.is_cached(cases[0], removers[0])
        for made in (pipeline.observation, pipeline.peak_masked):
            assert not made.is_cached(cases[0])
        assert not cleaned.separation.is_cached(cases[0], removers[0])
        assert rows == evaluate(cases, removers, [Mock(seed=1), Mock(seed=2)])

    def test_each_method_separates_a_sky_once(self, setting, tmp_path, monkeypatch):
        monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))
        cases, removers = setting
        found, separate = [], PCA.separate
        monkeypatch.setattr(
            PCA, "separate", lambda *args, **own: found.append(args[0]) or separate(*args, **own)
        )
        evaluate(cases[:1], removers, [Mock(seed=1), Mock(seed=2)])
        assert found == 3 * removers  # the sky, and the sky with each mock

    def test_what_fails_leaves_no_cubes(self, setting, tmp_path, monkeypatch):
        monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))
        monkeypatch.setattr(corrections, "transfer_functions", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            evaluate(*setting, [Mock(seed=1), Mock(seed=2)])
        assert not pipeline.observation.is_cached(setting[0][0])

    def test_nothing_is_observed_for_what_is_there(self, setting, monkeypatch):
        cases, removers = setting
        mocks = [Mock(seed=1), Mock(seed=2)]
        evaluate(cases, removers, mocks)
        monkeypatch.setattr(corrections.plan, "make_observations", lambda asked: [] if not asked else 1 / 0)
        evaluate(cases, removers, mocks)

    @pytest.mark.parametrize(
        ("given", "told"),
        [
            ({"methods": [["pca"]]}, "[name, number of sources]"),
            ({"methods": ["pca"]}, "[name, number of sources]"),
            ({"methods": [["pca", 17]]}, "at most the number of channels"),
            ({"methods": [["kpca", 3]]}, "unknown method"),
            ({"n_realisations": 0}, "between 1 and 1000"),
            ({"beam": "square"}, "square"),
        ],
    )
    def test_refused(self, given, told):
        with pytest.raises(InputError) as caught:
            cases_and_methods(**TINY | given)
        assert told in str(caught.value)

    def test_one_mock_is_too_few(self, setting):
        with pytest.raises(InputError, match="two mocks or more, got 1"):
            evaluate(*setting, [Mock(seed=1)])


ROW = Correction(
    seed=1, method="pca", n_sources=5, band=BANDS[0], raw=0.9, corrected=1.01, by_auto=1.02, sigma=0.02
)
ROWS = [ROW, replace(ROW, seed=2, corrected=1.05), replace(ROW, band=BANDS[3], raw=0.3, corrected=1.5)]


class TestSummary:
    def test_of_each_band(self):
        first, second = summary(ROWS)
        assert first == ("PCA 5", BANDS[0], "0.9000", "1.0300", "1.0200", "0.0283", "0.0200", "1 of 2")
        assert second[2:] == ("0.3000", "1.5000", "1.0200", "nan", "0.0200", "0 of 1")
        assert [len(found) for found in grouped(ROWS).values()] == [2, 1]

    def test_figure_has_a_panel_for_each_kind(self):
        figure = record_figure({"one Galaxy": ROWS, "another": ROWS[:1]})
        titles = [axes.get_title() for axes in figure.axes if axes.get_visible()]
        assert titles == ["one Galaxy", "one Galaxy", "another"]
        left, corrected = figure.axes[0].get_lines()[-2:]
        assert left.get_ydata().tolist() == [0.9] and left.get_fillstyle() == "none"
        assert corrected.get_ydata() == pytest.approx([1.03])
        assert corrected.get_label() == "PCA 5"


FILE = {
    "format": 2,
    "about": {},
    "columns": list(asdict(ROW)),
    "corrections": [list(asdict(ROW).values())],
}


class TestFile:
    def test_a_file_by_hand(self, tmp_path):
        path = tmp_path / "corrections.json"
        path.write_text(json.dumps(FILE))
        assert read_record(Correction, path) == ([ROW], {})

    def test_there_and_back(self, tmp_path):
        path = tmp_path / "corrections.json"
        write_record(ROWS, path, {"preset": "ci"})
        assert read_record(Correction, path) == (ROWS, {"preset": "ci"})

    def test_what_is_no_number_is_not_written(self, tmp_path):
        with pytest.raises(ValueError, match="JSON"):
            write_record([replace(ROW, sigma=math.nan)], tmp_path / "corrections.json", {})
        assert not list(tmp_path.iterdir())

    @pytest.mark.parametrize(
        "content",
        [
            "{",
            "[]",
            json.dumps(FILE | {"format": 1}),
            json.dumps(FILE | {"corrections": []}),
            json.dumps(FILE | {"corrections": [[1]]}),
            json.dumps(FILE | {"columns": ["seed", "colour"]}),
            json.dumps(FILE | {"about": 3}),
            json.dumps({name: value for name, value in FILE.items() if name != "columns"}),
        ],
    )
    def test_other_files_are_refused(self, tmp_path, content):
        path = tmp_path / "corrections.json"
        path.write_text(content)
        with pytest.raises(InputError, match="is not a file that `himap record corrections` wrote"):
            read_record(Correction, path)

    def test_a_missing_file(self, tmp_path):
        with pytest.raises(InputError, match="`himap record corrections` writes it"):
            read_record(Correction, Path(tmp_path, "none.json"))

    def test_a_pipe_is_not_waited_for(self, tmp_path):
        os.mkfifo(tmp_path / "pipe")
        with pytest.raises(InputError, match="must be a file that is on disk, got a pipe"):
            read_record(Correction, tmp_path / "pipe")


def test_a_method_without_a_number_of_sources(tmp_path):
    """It is named by itself in tables and legends."""
    _, (remover,) = cases_and_methods(**TINY, methods=[["gnilc", None]], n_realisations=1)
    assert remover.name == "gnilc"
    (line,) = summary([replace(ROW, method="gnilc", n_sources=0)])
    assert line[0] == "GNILC"
    figure = record_figure({"one": [replace(ROW, method="gnilc", n_sources=0)]})
    assert figure.axes[0].get_legend_handles_labels()[1] == ["GNILC"]


class TestCheck:
    """One sky of a record, measured again."""

    @pytest.fixture
    def path(self, tmp_path):
        path = tmp_path / "corrections.json"
        write_record(
            [ROW, replace(ROW, band="C/C0, 5-9"), replace(ROW, seed=99)], path, {"preset": "ci", "code": "a"}
        )
        return path

    def test_the_same(self, path):
        close = ROW.raw * (1 + 5e-4)
        before = read_record(Correction, path)[0]
        check_record([replace(ROW, raw=close), replace(ROW, band="C/C0, 5-9")], path, "b")
        rows, about = read_record(Correction, path)
        assert rows == before and about["code"] == "a" and about["checked"]["code"] == "b"
        assert set(about["checked"]) == {"code", "commit", "dirty"}

    @pytest.mark.parametrize(
        ("rows", "message"),
        [
            (
                [replace(ROW, raw=ROW.raw + 0.01), replace(ROW, band="C/C0, 5-9")],
                "1 of 2 rows of one sky are not",
            ),
            ([ROW, replace(ROW, band="C/C0, 2-4 ")], "1 of 2 rows"),
            ([ROW], f"has 2 rows of the seed {ROW.seed}, 1 were measured: give the parameters"),
        ],
    )
    def test_not_the_same(self, path, rows, message):
        before = path.read_text()
        with pytest.raises(InputError, match=message):
            check_record(rows, path, "b")
        assert path.read_text() == before
