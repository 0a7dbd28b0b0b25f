"""Facts about sky and masked peaks that claims are judged on: small, made once from cubes, and kept."""

import numpy as np

from himap.maps import sphere
from himap.maps.low_rank import blocks
from himap.paper import pipeline
from himap.removal.peaks import smooth_baselines
from himap.sky.emission import emission_maps
from himap.store.store import product

HIGH_LATITUDE = 30.0
"""Galactic latitude from which it is high, deg."""

STANDING_OUT = ("HI", "noise", "foreground")
"""What the peak of a line of sight can be made of, in the order of `masked_voxels`."""


@product
def sky_brightness(survey, galaxy):
    """Root mean square brightness temperature before the beam, over channels and pixels, mK, (2, 2) float64.

    Rows: all the sky, and |b| > 30 deg. Columns: all foregrounds together, and HI. Means are included.
    `survey` is that of the sky, as `Survey.sky` gives it.
    """
    components, hi = pipeline.components_of_sky(survey, galaxy), pipeline.hi_of_sky(survey)
    everywhere = np.ones(survey.n_pix, dtype=bool)
    regions = [everywhere, np.abs(sphere.pixel_latitude(survey.nside)) > HIGH_LATITUDE]
    squares = np.zeros((len(regions), 2))
    for freq, channel in zip(survey.freqs, hi, strict=True):
        (bright,) = emission_maps(components, [freq])
        for row, region in zip(squares, regions, strict=True):
            row += [np.mean(np.square(maps[region], dtype=np.float64)) for maps in (bright, channel)]
    return np.sqrt(squares / survey.n_channels)


@product
def masked_voxels(case, spread="line"):
    """How many voxels of a `Case` the peak masking replaces, by what stands out there most, (3,) int.

    `spread` is as in `pipeline.peak_masked`.

    A baseline is linear in the maps, so what stands out of the first one (paper, App. B) is the sum of what
    HI, noise and foreground leave of themselves, each through the beam and less its own baseline. A voxel
    belongs to the one that adds most to it; the order is that of `STANDING_OUT`.
    """
    observed, flagged = pipeline.observation(case), pipeline.peak_masked(case, spread).flagged
    lines = np.flatnonzero(flagged.any(axis=0))
    counts = np.zeros(len(STANDING_OUT), dtype=int)
    whole = _hi_through_beam(case, lines)
    for block in blocks(len(lines)):
        hi, truth = whole[:, block], observed.truth[:, lines[block]]
        parts = (hi, truth - hi, observed.maps[:, lines[block]] - truth)
        masked = flagged[:, lines[block]]
        out = np.array([_less_baseline(part, observed.freqs)[masked] for part in parts])
        largest = np.argmax(out * np.sign(out.sum(axis=0)), axis=0)
        counts += np.bincount(largest, minlength=len(STANDING_OUT))
    return counts


def _hi_through_beam(case, lines):
    """HI through the beam without the noise, on some lines of sight, mK, (n_channels, n_lines) float32."""
    survey, windows = case.survey, case.beam.of_survey(case.survey).total
    hi = np.empty((survey.n_channels, len(lines)), dtype=np.float32)
    for row, alm, window in zip(hi, pipeline.hi_alms_of_sky(survey.sky), windows, strict=True):
        row[:] = sphere.synthesise(sphere.multiply_beam(alm, window), survey.nside)[lines]
    return hi


def _less_baseline(cube, freqs):
    """Lines of sight less a fit to all channels, mK, of the shape of `cube`, float64."""
    baselines = smooth_baselines(cube, freqs)
    return cube - baselines.basis @ baselines.first
