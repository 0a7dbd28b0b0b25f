"""HI in boxes of more and fewer cells: numbers against healpy, and the experiment on tiny boxes."""

from dataclasses import replace

import healpy as hp
import numpy as np
import pytest

from himap.measures.spectra import frequency_power
from himap.paper import pipeline
from himap.paper.experiments import boxes
from himap.paper.experiments.boxes import EXPERIMENT, measure, numbers_of, skies
from himap.store import cache

TINY = {"preset": "ci", "survey": {"nside": 16, "n_channels": 20, "box_cells": 32}}


@pytest.fixture(scope="module")
def rows():
    (case,) = skies(**TINY)
    return EXPERIMENT.frame([{"seed": case.survey.seed} | row for row in measure(case)])


def values(rows, n_cells, quantity):
    chosen = rows[(rows["box_cells"] == n_cells) & (rows["quantity"] == quantity)]
    return chosen.set_index(["band", "channels"])["value"]


def test_every_box_has_every_quantity(rows):
    assert list(rows.columns) == ["seed", *boxes.COLUMNS]
    assert rows["box_cells"].unique().tolist() == [16, 32, 64] and rows["value"].gt(0).mean() > 0.9
    assert set(rows["quantity"]) == set(boxes.QUANTITIES)
    assert not rows.duplicated(["box_cells", "quantity", "band", "channels"]).any()


def test_no_map_stays_in_the_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))
    (case,) = skies(preset="ci", survey=TINY["survey"] | {"box_cells": 16})
    measure(case)
    assert {entry.product for entry in cache.cache_info()} == {"measured_boxes"}


def test_the_least_maps():
    """Few channels, and an end before l = 20."""
    (case,) = skies(preset="ci", survey={"nside": 8, "n_channels": 8, "box_cells": 16})
    rows = numbers_of(case)
    assert np.isfinite([row["value"] for row in rows]).all()
    assert [row["band"] for row in rows if row["quantity"] == "C_l"] == 3 * ["2–15"]


def test_numbers_are_those_of_the_maps(rows):
    """Spectra by healpy, and P(k) by its definition at the k of a band."""
    (case,) = skies(**TINY)
    survey = replace(case.survey, box_cells=64)
    maps = pipeline.hi_of_sky(survey.sky).astype(float)
    assert values(rows, 64, "mean").item() == pytest.approx(maps.mean(), rel=1e-5)
    assert values(rows, 32, "brightest").item() == pytest.approx(pipeline.hi_seen(case).max())
    cl = np.array([hp.anafast(one, iter=3)[2:20].mean() for one in maps[-4:]]).mean()
    last = values(rows, 64, "C_l")["2–19"].iloc[-1]
    assert last == pytest.approx(cl, rel=2e-3)
    width, n = survey.channel_width, survey.n_channels
    modes = np.fft.rfft(maps - maps.mean(axis=1, keepdims=True), axis=0)
    power = width * np.mean(np.abs(modes) ** 2, axis=1) / n
    k = 2 * np.pi * np.fft.rfftfreq(n, width)
    band = values(rows, 64, "P")["0.03–0.3"].item()
    assert band == pytest.approx(power[(k > 0.03) & (k < 0.3)].mean(), rel=1e-4)


def test_spectra_have_the_taper_of_the_survey(rows):
    (case,) = skies(preset="ci", survey=TINY["survey"] | {"taper": "hann"})
    tapered_values = {(row["quantity"], row["band"]): row["value"] for row in numbers_of(case)}
    maps = {"P": pipeline.hi_of_sky(case.survey.sky), "P_beam": pipeline.hi_seen(case)}
    for quantity, cube in maps.items():
        power = frequency_power(cube, case.survey.channel_width, taper="hann")
        expected = power.power[(power.k > 0.03) & (power.k < 0.3)].mean()
        found = tapered_values[quantity, "0.03–0.3"]
        assert found == pytest.approx(expected)
        assert found != pytest.approx(values(rows, 32, quantity)["0.03–0.3"].item(), rel=1e-3)


def test_smaller_cells_have_more_structure(rows):
    for quantity in ("P", "P_beam", "brightest"):
        coarse, _, fine = (values(rows, n_cells, quantity) for n_cells in (16, 32, 64))
        assert (fine > coarse).all()


def test_spectra_in_the_table_are_relative_to_the_largest_box(rows):
    table = boxes.table_of(rows)
    assert list(table.columns)[3:] == ["16³", "32³", "64³", "value, 64³"]
    spectra = table["quantity"].isin([boxes.QUANTITIES[one] for one in ("C_l", "P", "P_beam")])
    assert set(table.loc[spectra, "64³"]) == {"1"}
    assert (table.loc[~spectra, "64³"] == table.loc[~spectra, "value, 64³"]).all()
