"""Facts on sky, noise, peaks and errors by which claims are judged: small, computed once, and stored."""

from dataclasses import replace

import numpy as np

from himap.core.errors import InputError
from himap.maps import sphere
from himap.maps.low_rank import in_threads
from himap.measures import diagnostics
from himap.measures.low_rank_spectra import Moments, frequency_power_without, recovered_power
from himap.measures.spectra import AngularPower, PowerSpectra, frequency_power
from himap.paper import cleaned, leakage, pipeline
from himap.removal import harmonic
from himap.removal.cleaning import Cleaning
from himap.removal.peaks import baseline_basis
from himap.removal.spectral_filter import on_sky, seen_through
from himap.sky.emission import emission_maps, emission_modes
from himap.store.store import product

HIGH_LATITUDE = 30.0
"""Galactic latitude above which it is high, deg."""

STANDING_OUT = ("HI", "noise", "foreground")
"""Possible main components of the peak of a line of sight, in the order of `masked_voxels`."""

BRIGHTEST = (0.0, 0.01, 0.05, 0.1, 0.25)
"""Shares of the lines of sight with the brightest foreground that `peak_without_lines` excludes."""

CONTROL = 0.1
"""Share of the lines of sight with the faintest foreground that it excludes as a control."""


@product
def sky_brightness(survey, galaxy):
    """Root mean square brightness temperature before the beam, over channels and pixels, mK, (2, 2) float64.

    Rows: all sky, and |b| > 30 deg. Columns: all foregrounds together, and HI. Means are included.
    `survey` is a `Survey.sky`.
    """
    components, hi = pipeline.components_of_sky(survey, galaxy), pipeline.hi_of_sky(survey)
    regions = slice(None), np.abs(sphere.pixel_latitude(survey.nside)) > HIGH_LATITUDE
    squares = np.zeros((2, 2))
    for freq, channel in zip(survey.freqs, hi, strict=True):
        bright = np.square([*emission_maps(components, [freq]), channel], dtype=np.float64)
        squares += [bright[:, region].mean(axis=1) for region in regions]
    return np.sqrt(squares / survey.n_channels)


@product
def masked_voxels(case, spread=True):
    """Number of voxels of a `Case` replaced by peak masking, by the largest component there, (3,) int.

    `spread` is as in `pipeline.peak_masked`.

    A baseline is linear in the maps, so the deviation from the first one (paper, App. B) is the sum of the
    deviations of HI, noise and foreground, each through the beam and less its baseline. A voxel is assigned
    to the component that contributes most, in the order of `STANDING_OUT`.
    """
    observed, flagged = pipeline.observation(case), pipeline.peak_masked(case, spread).flagged
    lines = np.flatnonzero(flagged.any(axis=0))
    seen, basis = pipeline.hi_seen(case), baseline_basis(observed.freqs)

    def count(block):
        pixels = lines[block]
        masked, hi, truth = (cube[:, pixels] for cube in (flagged, seen, observed.truth))
        out = np.empty((len(STANDING_OUT), np.count_nonzero(masked)))
        parts = hi, truth - hi, observed.maps[:, pixels] - truth
        for part, row in zip(parts, out, strict=True):  # in float64, one at a time
            part = part.astype(np.float64)
            part -= basis @ (basis.T @ part)
            row[:] = part[masked]
        largest = np.argmax(out * np.sign(out.sum(axis=0)), axis=0)
        return np.bincount(largest, minlength=len(STANDING_OUT))

    return sum(in_threads(count, len(lines), "peaks"), np.zeros(len(STANDING_OUT), dtype=int))


@product
def noise_and_hi(case):
    """`PowerSpectra` of the noise and of HI, a pair: each alone, as in the truth of a `Case`."""
    survey, windows = case.survey, case.beam.of_survey(case.survey)
    hi = pipeline.hi_seen(case)
    cubes = pipeline.truth(case) - hi, hi
    alms = pipeline.noise_alms(survey), pipeline.hi_alms_of_sky(survey.sky)
    beams = np.ones_like(windows.total) if windows.resmoothing is None else windows.resmoothing, windows.total
    degrees = np.arange(survey.lmax + 1.0)
    return tuple(
        PowerSpectra(
            angular=AngularPower(degrees=degrees, cl=beam**2 * sphere.power_spectrum(alm)),
            frequency=frequency_power(cube, survey.channel_width, taper=survey.taper),
        )
        for cube, alm, beam in zip(cubes, alms, beams, strict=True)
    )


@product
def spectra_without_sources(case, remover):
    """`PowerSpectra` of the residual of a `Case` without point sources; all else is the same.

    Its peaks are masked again. `remover` has no last l, and draws no random numbers. If it refuses the maps,
    as fits of positive brightness do if pixels ring around a bright Galaxy, the reason is returned instead.
    """
    survey, components = case.survey, pipeline.components_of_sky(case.survey.sky, case.galaxy)
    spectra, maps = emission_modes([one for one in components if one.name != "point sources"], survey.freqs)
    if case.dimming is not None:
        maps *= case.dimming.weights(survey.nside)
    modes, beams = harmonic.to_modes(sphere.analyse(maps)), case.beam.of_survey(survey).total
    try:
        return spectra_with(seen_through(modes, spectra, beams), case, remover)
    except InputError as error:
        return str(error)


@product
def dimmed_spectra(case, remover, dimming):
    """`PowerSpectra` of the residual of a `Case` with its foreground under another `Dimming`.

    Everything else is as in `spectra_with`.
    """
    return spectra_with(pipeline.foreground_seen(replace(case, dimming=dimming)), case, remover)


def spectra_with(foreground, case, remover):
    """`PowerSpectra` of the residual of a `Case` with another foreground through the beam, `HarmonicModes`.

    HI and noise are the same, and peaks are masked again.
    """
    survey, truth = case.survey, pipeline.truth(case)
    bright = on_sky(foreground, survey.nside)
    separation = Cleaning.of(cleaned.data_of(case, bright.cube() + truth), remover).separation
    true = pipeline.true_spectra(case)
    error = cleaned.difference(case, bright, separation.foreground)
    return PowerSpectra(
        angular=recovered_power(pipeline.truth_alms_of(case), error, true=true.angular),
        frequency=Moments.of(truth, error).frequency_power(true.frequency, survey.channel_width),
    )


@product
def error_of_flagged_lines(case, remover, mask_peaks=True):
    """Components of the error of a component method on the lines of sight that it flags.

    The foreground's spectra are those principal spectra of the true foreground through the beam that each
    have more variance than the truth in all channels together. Arguments as in `cleaned.assessment`.

    Returns a dict with "n_spectra", their number, and mean squares over the flagged lines
    (`diagnostics.flagged_lines`) and channels, mK^2, 0 if there is none: "error"; "in spectra", its part in
    these spectra; "foreground residual" and "signal loss" (`leakage.split_error`), whose difference is the
    error; "truth" and "truth in spectra".
    """
    lmax = cleaned.separation(case, remover, mask_peaks).lmax
    lines = diagnostics.flagged_lines(cleaned.assessment(case, remover, mask_peaks).line_errors)
    residual, loss = (part.lines(lines) for part in leakage.split_error(case, remover, mask_peaks))
    truth = _of_lines(pipeline.truth(case), lines)
    if lmax is not None:  # the truth beyond is signal loss
        loss += truth - _of_lines(pipeline.truth(case, lmax), lines)
    variance = float(pipeline.true_spectra(case).angular.variance.sum())
    axes = on_sky(pipeline.foreground_seen(case), case.survey.nside).truncate(variance).spectra
    error = residual - loss
    squares = {
        "error": error,
        "in spectra": axes.T @ error,
        "foreground residual": residual,
        "signal loss": loss,
        "truth": truth,
        "truth in spectra": axes.T @ truth,
    }
    n_voxels = max(truth.size, 1)
    means = {name: float(np.sum(part**2)) / n_voxels for name, part in squares.items()}
    return means | {"n_spectra": axes.shape[1]}


def _of_lines(cube, lines):
    """Some lines of sight of a cube less its channel means, (n_channels, n) float64."""
    return cube[:, lines] - cube.mean(axis=1, dtype=np.float64)[:, None]


@product
def peak_without_lines(case, remover, mask_peaks=True):
    """k above 0, 1/MHz, (n_k,), and P/P0 of a method without some lines of sight, (n_masks, n_k).

    The lines exclude each share of `BRIGHTEST`, and then the share `CONTROL` of the faintest. The brightness
    of a line is the mean over channels of the foreground through the beam; residual and truth have the same
    lines, less their means over these.
    """
    separation, width = cleaned.separation(case, remover, mask_peaks), case.survey.channel_width
    error, truth = cleaned.error_of(case, separation, mask_peaks), pipeline.truth(case)
    low = truth if separation.lmax is None else pipeline.truth(case, separation.lmax)
    bright = on_sky(pipeline.foreground_seen(case), case.survey.nside)
    place = np.argsort(np.argsort(bright.spectra.mean(axis=0) @ bright.maps)) / case.survey.n_pix
    known, ratios = cleaned.assessment(case, remover, mask_peaks).power_spectra.frequency, []
    total = pipeline.true_spectra(case).frequency
    for removed in (*(place >= 1 - share for share in BRIGHTEST), place < CONTROL):
        recovered = frequency_power_without(known, removed, width, low, error)
        true = frequency_power_without(total, removed, width, truth)
        ratios.append(diagnostics.ratio(recovered.power[1:], true.power[1:]))
    return total.k[1:], np.array(ratios)
