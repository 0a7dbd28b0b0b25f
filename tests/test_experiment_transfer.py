"""How well transfer functions correct signal loss: on a made-up sky, and on a small real one."""

import numpy as np
import pytest

from himap.core.errors import InputError
from himap.measures.transfer import HarmonicPower, MockPower, TransferFunction
from himap.paper.experiment_figures import transfer_figure
from himap.paper.experiments.transfer import EXPERIMENT, corrected_bands, skies

TINY = {"preset": "ci", "survey": {"nside": 8, "n_channels": 16, "box_cells": 16}}
BANDS = ["C/C0, 2-4", "C/C0, 5-9", "C/C0, 10-19", "P/P0, 0-0.03", "P/P0, 0.03-0.1", "P/P0, k > 0.1"]


def made_up(share):
    """Of 500 channels of 1 MHz, l up to 25, of which a share of the power comes back."""

    def power(value):
        return HarmonicPower(power=np.full((26, 251), float(value)), n_channels=500, channel_width=1.0)

    return MockPower(input=power(1.0), output=power(share), cross=power(np.sqrt(share)))


class TestOneSky:
    def test_in_every_band(self):
        mocks = TransferFunction(mocks=(made_up(0.81), made_up(0.81)))
        found = corrected_bands(made_up(0.9), mocks)
        assert [row["band"] for row in found] == BANDS
        for row in found:
            ratios = [row[name] for name in ("uncorrected", "corrected", "corrected_auto")]
            assert ratios == pytest.approx([0.9, 1.0, 0.9 / 0.81])
            assert row["error_bar"] == pytest.approx(0, abs=1e-12)

    def test_error_bars_are_the_scatter_of_mocks(self):
        mocks = TransferFunction(mocks=(made_up(1.0), made_up(0.64)))
        row, *_ = corrected_bands(made_up(0.9), mocks)
        assert row["error_bar"] == pytest.approx(np.sqrt((0.25**2 + 0.2**2) / 2))


def test_table_of_a_small_sky():
    grid = skies(**TINY, methods=[["pca", 3], ["gnilc", None]], n_realisations=2, n_mocks=2)
    table = EXPERIMENT.table(grid)
    assert [sky.survey.seed for sky in grid] == [2025, 2026]
    assert table["band"].tolist() == 4 * BANDS
    assert table["seed"].tolist() == [2025] * 12 + [2026] * 12
    assert table["method"].tolist() == 2 * (["pca"] * 6 + ["gnilc"] * 6)
    assert set(table["n_sources"]) == {3, 0}
    assert table.select_dtypes("float").notna().all(axis=None)


def test_one_mock_is_too_few():
    with pytest.raises(InputError, match="n_mocks must be .* between 2 and 1000"):
        skies(**TINY, n_mocks=1)


def table(*rows):
    """Of (seed, band, uncorrected, corrected) of PCA 5."""
    names = ("seed", "band", "uncorrected", "corrected")
    more = {"method": "pca", "n_sources": 5, "corrected_auto": 1.02, "error_bar": 0.02}
    return EXPERIMENT.frame([dict(zip(names, row, strict=True)) | more for row in rows])


TABLE = table((1, BANDS[0], 0.9, 1.01), (2, BANDS[0], 0.9, 1.05), (1, BANDS[3], 0.3, 1.5))


class TestSummary:
    def test_of_each_band(self):
        first, second = EXPERIMENT.summary(TABLE).to_numpy().tolist()
        assert first == ["PCA 5", BANDS[0], "0.9000", "1.0300", "1.0200", "0.0283", "0.0200", "1 of 2"]
        assert second[2:] == ["0.3000", "1.5000", "1.0200", "nan", "0.0200", "0 of 1"]

    def test_figure_has_a_panel_for_each_kind(self):
        figure = transfer_figure({"one Galaxy": TABLE, "another": TABLE[:1]})
        titles = [axes.get_title() for axes in figure.axes if axes.get_visible()]
        assert titles == ["one Galaxy", "one Galaxy", "another"]
        uncorrected, corrected = figure.axes[0].get_lines()[-2:]
        assert uncorrected.get_ydata().tolist() == [0.9] and uncorrected.get_fillstyle() == "none"
        assert corrected.get_ydata() == pytest.approx([1.03])
        assert corrected.get_label() == "PCA 5"

    def test_a_method_without_a_number_of_sources_is_called_by_its_name(self):
        own = TABLE.assign(method="gnilc", n_sources=0)
        assert set(EXPERIMENT.summary(own)["method"]) == {"GNILC"}
        assert transfer_figure({"": own}).axes[0].get_legend_handles_labels()[1] == ["GNILC"]
