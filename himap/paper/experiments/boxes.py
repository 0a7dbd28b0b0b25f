"""HI of one seed in boxes of half as many, equally many and twice as many cells per side.

A box with more than 1024 cells per side has the modes of the box of 1024 with the same seed
(`himap.sky.box`); smaller boxes differ in resolution and in the draw, as for another seed.
"""

from dataclasses import replace

import numpy as np

from himap.core.errors import InputError
from himap.instrument.beams.paper import Degraded
from himap.maps import sphere
from himap.measures.spectra import frequency_power
from himap.paper import pipeline
from himap.paper.grid import cases_of
from himap.paper.record import Experiment
from himap.removal.peaks import smooth_baselines
from himap.store.store import product, temporary

COLUMNS = {"box_cells": int, "quantity": str, "band": str, "channels": str, "value": float}
"""Cells per side; one of `QUANTITIES`; its range of l or of k (1/MHz); the channels (MHz) over which it is
averaged; and the value."""

QUANTITIES = {
    "mean": "mean temperature, mK",
    "C_l": "C_ℓ, mK²",
    "P": "P(k), mK² MHz",
    "P_beam": "P(k) through the beam, mK² MHz",
    "flagged": "voxels beyond 5 σ, through the beam",
    "brightest": "brightest voxel through the beam, mK",
}
"""Quantities measured on HI, before the beam and through the degraded one."""

_K_BANDS = {"below 0.03": (0, 0.03), "0.03–0.3": (0.03, 0.3), "above 0.3": (0.3, np.inf)}
_LEAST, _MOST = 16, 2048  # box_cells for which half and twice as many are allowed
_LEAST_CHANNELS = 8  # needed by the fits of peaks


def skies(*, n_realisations=1, **settings):
    """A list of `pipeline.Case`, each with its own seed; settings as in `cases_of`.

    InputError if a box of half or twice as many cells per side is impossible, or channels are too few.
    """
    cases = cases_of(Degraded(), n_realisations=n_realisations, **settings)
    n_cells, n_channels = cases[0].survey.box_cells, cases[0].survey.n_channels
    if n_cells % 4 or not _LEAST <= n_cells <= _MOST:
        raise InputError(
            "boxes of half and of twice as many cells along a side are made too, and box_cells is "
            f"{n_cells}: take a multiple of 4 from {_LEAST} to {_MOST}."
        )
    if n_channels < _LEAST_CHANNELS:
        raise InputError(
            f"peaks are found by fits along the channels, and n_channels is {n_channels}: take "
            f"{_LEAST_CHANNELS} or more."
        )
    return cases


def numbers_of(case):
    """Rows with "quantity", "band", "channels" and "value" for the HI of a `pipeline.Case`."""
    survey = case.survey

    def row(quantity, value, *, band="", channels="all"):
        return {"quantity": quantity, "band": band, "channels": channels, "value": float(value)}

    def along(quantity, maps):
        power = frequency_power(maps, survey.channel_width, taper=survey.taper)
        inside = {band: (power.k > low) & (power.k < high) for band, (low, high) in _K_BANDS.items()}
        return [row(quantity, power.power[k].mean(), band=band) for band, k in inside.items() if k.any()]

    maps, seen = pipeline.hi_of_sky(survey.sky), pipeline.hi_seen(case)
    rows = [row("mean", maps.mean(dtype=float)), *along("P", maps), *along("P_beam", seen)]
    cl = sphere.power_spectrum(pipeline.hi_alms_of_sky(survey.sky))
    degrees = [*(n for n in (2, 20, 100, 200) if n < 2 * survey.nside), 2 * survey.nside]
    for channels in np.array_split(np.arange(survey.n_channels), 5)[::2]:
        first, last = survey.freqs[channels[[0, -1]]]
        for low, high in zip(degrees[:-1], degrees[1:], strict=True):
            value = cl[channels, low:high].mean()
            rows.append(row("C_l", value, band=f"{low}–{high - 1}", channels=f"{first:.0f}–{last:.0f}"))
    rows.append(row("flagged", smooth_baselines(seen, survey.freqs).flagged.mean()))
    return [*rows, row("brightest", seen.max())]


@product(name="measured_boxes")
def measure(case):
    """Rows with `COLUMNS` for a `pipeline.Case`."""
    half = case.survey.box_cells // 2
    rows = []
    for n_cells in (half, 2 * half, 4 * half):
        finer = replace(case, survey=replace(case.survey, box_cells=n_cells))
        with temporary(pipeline.hi_of_sky, pipeline.hi_alms_of_sky):
            rows += [{"box_cells": n_cells} | row for row in numbers_of(finer)]
    return rows


def table_of(rows):
    """A DataFrame of texts: a column for each box, spectra relative to those of the largest box.

    `rows` is a DataFrame with "seed" and `COLUMNS`; values are medians over skies.
    """
    by_box = rows.pivot_table("value", ["quantity", "band", "channels"], "box_cells", "median", sort=False)
    largest = by_box.iloc[:, -1]
    is_spectrum = by_box.index.get_level_values("quantity").isin(["C_l", "P", "P_beam"])
    texts = by_box.div(largest.where(is_spectrum, 1.0), axis=0).map("{:.3g}".format)
    texts.columns = [f"{n_cells}³" for n_cells in texts]
    texts[f"value, {texts.columns[-1]}"] = [f"{value:.3g}" for value in largest]
    texts = texts.reset_index()
    texts["quantity"] = texts["quantity"].map(QUANTITIES)
    return texts.rename(columns={"band": "ℓ, or k in 1/MHz", "channels": "MHz"})


EXPERIMENT = Experiment(
    name="boxes",
    chapter="01_simulations",
    columns=COLUMNS,
    key=("box_cells", "quantity", "band", "channels"),
    skies=skies,
    measure=measure,
    summary=table_of,
    defaults={"n_realisations": 1},
    without=("boxes",),
)
