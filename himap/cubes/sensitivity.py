"""Sensitivity of the residual of a cube to the assumed beam, without the truth."""

import numpy as np
import pandas as pd

from himap.core.errors import InputError
from himap.core.progress import progress
from himap.cubes.cleaning import beams_of
from himap.cubes.report import figure, write_page
from himap.cubes.transfer import alms_of, mock_power_of_change
from himap.figures import plotting, styles
from himap.figures.tables import Table
from himap.instrument.beams import named
from himap.instrument.beams.base import Beam
from himap.instrument.beams.others import PerturbedBeam
from himap.measures.diagnostics import plain_band

WIDTHS, RIPPLES = (-1e-2, -1e-3, 1e-3, 1e-2), (1e-5, 1e-4, 1e-3)
"""Default errors of the FWHM, relative: the same in all channels, and oscillating."""

_FAR = np.log(2)  # a ratio that needs a logarithmic axis


def beam_sensitivity(cleaned, beam, *, widths=WIDTHS, ripples=RIPPLES, period=20.0, dish=None):
    """Change of the residual of a cleaned cube if another beam is assumed.

    The truth is not needed: if the residual power is sensitive to a beam error that cannot be excluded, the
    residual contains foreground or HI is lost.

    Parameters
    ----------
    cleaned
        The `CleanedCube`, from a method that uses the beam.
    beam, dish
        The beam used for cleaning, as in `beams_of`.
    widths
        Relative errors of the FWHM of all channels.
    ripples, period
        Relative amplitudes of an error that oscillates with frequency, and its period in MHz.

    Returns
    -------
    DataFrame
        A row per beam, with `kind` ("width" or "ripple") and `error` (relative to the FWHM); a column per
        band, such as "C/C0, 10-19", of power with that beam relative to power with the assumed beam.

    Raises
    ------
    InputError
        A method that does not use the beam, no error, an error outside its range, or a ripple that is nearly
        constant over the channels of the cube.
    """
    cube, method = cleaned.cube, cleaned.method
    if "beams" not in method.uses:
        raise InputError(f"{method.name} does not use the beam, so beam errors do not affect the result.")
    assumed = perturbed_beams(beam, cube.freqs, widths, ripples, period)
    known = [(one, beams_of(cube, one, dish=dish)) for one in assumed]  # fails early
    alms = alms_of(cube, cleaned.residual, cleaned.separation.lmax)
    ratios = {}
    for one, beams in progress(known, "beams"):
        other = cleaned.with_beams(beams).separation
        power = mock_power_of_change(cube, cleaned.residual, alms, cleaned.separation, other)
        ratios["width" if one.width else "ripple", one.width or one.ripple] = power.band_means()
    return pd.DataFrame(ratios).T.astype(float).rename_axis(["kind", "error"])


def perturbed_beams(beam, freqs, widths=WIDTHS, ripples=RIPPLES, period=20.0):
    """`PerturbedBeam` list for channels at `freqs`, MHz; other parameters as in `beam_sensitivity`."""
    beam = beam if isinstance(beam, Beam) else named(beam)
    assumed = [PerturbedBeam(beam=str(beam), width=width) for width in widths]
    assumed += [PerturbedBeam(beam=str(beam), ripple=ripple, period=period) for ripple in ripples]
    if not assumed or not all(one.width or one.ripple for one in assumed):
        raise InputError("beam errors must be given and nonzero: widths, ripples or both.")
    for one in assumed:
        if np.ptp(one.error(freqs)) < abs(one.ripple):  # the range is at most twice the amplitude
            raise InputError(
                f"a ripple of {period:g} MHz is nearly constant over the channels, which are "
                f"{np.diff(freqs).min():g} MHz apart: give another period= (--period), or only widths."
            )
    return assumed


def sensitivity_table(sensitivity, period=20.0):
    """A `Table` with a row per beam of `beam_sensitivity`: the band whose ratio deviates most from 1."""
    far = np.log(sensitivity.clip(lower=np.finfo(float).tiny)).abs().idxmax(axis=1)
    wrong = {"width": "FWHM of all channels", "ripple": f"ripple of {period:g} MHz"}
    rows = [
        (wrong[kind], f"{100 * error:+.3g} %", f"{ratios[band]:.4g}", plain_band(band))
        for ((kind, error), ratios), band in zip(sensitivity.iterrows(), far, strict=True)
    ]
    return Table(("what is wrong", "by", "furthest from 1", "in the band"), rows, align="lrrl")


def sensitivity_figure(sensitivity):
    """Figure of the ratios of all bands for each beam error, one panel per kind."""
    panels = []
    for kind, title in {"width": "error of the FWHM [%]", "ripple": "ripple of the FWHM [%]"}.items():
        if kind not in sensitivity.index:
            continue
        several = sensitivity.loc[kind].sort_index()
        at = range(len(several))
        looks = styles.sequence(list(map(plain_band, several)))
        curves = [((-0.5, len(several) - 0.5), (level, level), {"color": "0.75"}) for level in (0.99, 1.01)]
        curves += [
            (at, several[band], look | {"marker": "o", "markersize": 3})
            for band, look in zip(several, looks, strict=True)
        ]
        panels.append(
            {
                "curves": curves,
                "yscale": "log" if np.log(several).abs().max(axis=None) > _FAR else "linear",
                "xticks": at,
                "xticklabels": [f"{100 * error:+.3g}" for error in several.index],
                "xlabel": title,
                "ylabel": "power relative to the assumed beam",
                "legend": {"fontsize": 7, "ncols": 2},
            }
        )
    return plotting.lines(panels, size=(4.8, 3.8))


def write_sensitivity(sensitivity, path, *, period=20.0, said=()):
    """Write a page with the table and figure of `beam_sensitivity`, and the assumptions."""
    text = (
        "Power of the residual with an erroneous beam, relative to that with the assumed beam, in bands of l "
        "and k. If it leaves the grey 1 % lines for an error that cannot be excluded, constrain the beam "
        "better or remove one more source."
    )
    picture = figure(sensitivity_figure(sensitivity), "Power of the residual for other beams", text)
    parts = [sensitivity_table(sensitivity, period), picture]
    write_page(path, "Sensitivity to the beam", parts, said=said)
