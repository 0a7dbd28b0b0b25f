"""Spectra of a cleaned cube corrected by its transfer function: remarks, tables, a page and a file."""

import warnings
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
import pandas as pd

from himap.core.errors import InputError
from himap.cubes.report import figure, panel
from himap.figures import plotting, styles
from himap.figures.tables import Table
from himap.measures.bootstrap import LEVEL, chance_of, covariance, sigma
from himap.measures.diagnostics import bands, plain_band
from himap.measures.spectra import decouple
from himap.measures.transfer import quotient

HEADER = ("band", "T", "corrected / residual", "error bar", "systematic", "sample")
"""Columns of `corrected_table`."""

HEADER_OF_TRUTH = ("residual / truth", "corrected / truth", "pull", "total pull")
"""Additional columns if the truth is known."""

_MOST = 0.5  # share of the residual power
_BRIGHTER = 100  # power of mocks over that of the residual, median of bands, far above a usual signal loss
_LOST = 0.01  # share of the power: with less signal loss, mocks that differ from the data do no harm


@dataclass(frozen=True, kw_only=True)
class Corrected:
    """One spectrum of a cleaned cube, corrected for signal loss and foreground residual.

    Attributes
    ----------
    x
        l, or k in 1/MHz, (n,).
    residual
        Residual spectrum, C_l averaged over channels in mK^2, or P(k) in mK^2 MHz.
    share
        The transfer function.
    corrected
        The corrected spectrum; NaN where T is zero.
    errors
        Relative errors of mocks corrected by each other, (n_mocks, n); empty, (0, n), for a single mock.
    sample
        For each mock, (n_mocks, n): sample variance and noise (`TransferFunction.sample`), in no error bar.
    expected
        Mean power of the mocks, comparable to `corrected`.
    systematic
        Subtracted estimate of the foreground residual, divided by the transfer function, in the unit of the
        spectrum; for P(k) also the power of pixels beyond the multipoles in a few k alone. Since the estimate
        depends on assumptions, it is the systematic error of `corrected`.
    truth
        The spectrum of the truth, NaN where unknown.
    drawn
        As in `CubeTransfer`: if False, the foreground residual is unknown, and `systematic` is no error.
    """

    x: np.ndarray
    residual: np.ndarray
    share: np.ndarray
    corrected: np.ndarray
    errors: np.ndarray
    sample: np.ndarray
    expected: np.ndarray
    systematic: np.ndarray
    truth: np.ndarray
    drawn: bool

    @property
    def knows_truth(self):
        """Whether the truth is known for any value."""
        return bool(np.isfinite(self.truth).any())

    @property
    def foreground(self):
        """The subtracted part of the residual, in its unit; approximate for bins of l."""
        return self.share * self.systematic

    def sigma(self, bins, of="errors"):
        """Relative error bars of means over bins, rows of weights (n_bins, n); NaN for a single mock.

        With `of` "sample", those of sample variance and noise.
        """
        relative = getattr(self, of)
        return sigma(relative @ np.transpose(bins)) if len(relative) > 1 else np.full(len(bins), np.nan)

    def errors_in(self, inside):
        """Relative error bar, systematic error and sample variance of the mean over `inside`, (n,) bool.

        The systematic error is a ratio of mean powers, the others are means of the ratios at each l or k.
        """
        bins, systematic = [inside / inside.sum()], self.systematic[inside].mean()
        systematic = abs(systematic / self.corrected[inside].mean())
        return self.sigma(bins)[0], systematic, self.sigma(bins, "sample")[0]


def correct(cleaned, transfer, spectra, truth=None):
    """Correct both spectra of a cleaned cube, {"angular": `Corrected`, "frequency": `Corrected`}.

    Parameters
    ----------
    cleaned
        The `CleanedCube`.
    transfer
        Its `CubeTransfer` (`measure_transfer`).
    spectra
        Its `PowerSpectra`, binned in l if there is a mask.
    truth
        The `Comparison` with the truth, if there is one.

    Raises
    ------
    InputError
        A transfer function of another cube.
    """
    n_seen = sum(map(len, transfer.parts.pixels))
    if (n_seen, transfer.powers.shape[-1]) != (cleaned.cube.maps.shape[1], len(spectra.frequency.k)):
        raise InputError(
            f"the transfer function belongs to another cube, with {n_seen} pixels and "
            f"{transfer.powers.shape[-1]} values of P(k): measure it for this one (measure_transfer)."
        )
    shown = {"angular": (spectra.angular.degrees, spectra.angular.mean)}
    shown["frequency"] = spectra.frequency.k, spectra.frequency.power
    true = dict.fromkeys(shown, ([0], [np.nan]))
    if truth is not None:
        true = {"angular": (truth.degrees, truth.true_angular), "frequency": (truth.k, truth.true_frequency)}
    return {kind: _corrected(kind, cleaned, transfer, shown[kind], true[kind]) for kind in shown}


def _averages(kind, cube, n_degrees, bins, known):
    """Function from relative errors (n, n_l or n_k), and the powers they refer to, to those in bins.

    Without a mask these are means over `bins` of the `known` l or k. With a mask C_l are decoupled, which
    increases their scatter.
    """
    if kind == "frequency" or cube.sky_mask is None:
        return lambda relative, power: relative[:, known] @ bins.T
    with warnings.catch_warnings(action="ignore"):  # already issued for its spectra
        matrix = decouple(np.eye(3 * cube.nside), cube.sky_mask.astype(float)).cl
    matrix = matrix[:n_degrees, 1 : 1 + len(bins)]
    return lambda relative, power: quotient((relative * power) @ matrix, power @ matrix)


def _corrected(kind, cleaned, transfer, shown, true):
    """The `Corrected` of one spectrum of a `CleanedCube`, from its `CubeTransfer`.

    `shown` and `true` are l or k in bins and the power there, of the residual and of the truth.
    """
    x, residual = shown
    known = slice(2, None) if kind == "angular" else slice(1, None)
    known_at = (transfer.degrees if kind == "angular" else transfer.k)[known]
    inside = (x >= known_at[0]) & (x <= known_at[-1])
    if kind == "angular":  # bins follow each other from l = 0 on, and in each every l counts the same
        ends = np.array([*accumulate(x, lambda end, middle: 2 * middle - end, initial=-0.5)])
        low, high = ends[:-1], ends[1:]
    else:
        low, high = x - (x[1] - x[0]) / 2, x + (x[1] - x[0]) / 2
    bins = (known_at > low[inside, None]) & (known_at < high[inside, None])
    bins = bins / np.maximum(bins.sum(axis=1, keepdims=True), 1)
    residual_power, share = getattr(transfer.residual, kind), getattr(transfer, kind)
    lost = share <= 0
    found = transfer.corrected(kind, getattr(transfer.without_foreground, kind))
    several = len(transfer.mocks) > 1
    powers = np.array([getattr(mock.input, kind) for mock in transfer.mocks])
    expected = powers.mean(axis=0)
    within, shares, lost_in = bins @ residual_power[known], bins @ share[known], bins @ lost[known] > 0
    # C_l of coefficients include the mask, equally for all spectra.
    scale, noise = residual[inside] / within, 0.0
    if kind == "frequency" and (transfer.drawn or cleaned.separation.lmax is None):
        # Pixels have power beyond lmax: HI and noise as in the mocks, unlike a foreground residual.
        in_pixels = bins @ transfer.in_pixels.mean(axis=0)[known]
        scale = 1.0 if transfer.drawn else quotient(in_pixels, bins @ expected[known])
        # Additional noise is white along frequency; excess power of pixels at some k is foreground.
        noise = np.median(residual[inside] - within * scale)
    corrected = bins @ np.where(lost, 0, found)[known] * scale + noise
    average = _averages(kind, cleaned.cube, len(expected), bins, known)
    return Corrected(
        x=x[inside],
        residual=residual[inside],
        share=shares,
        corrected=np.where(lost_in, np.nan, corrected),
        errors=average(transfer.errors(kind), powers) if several else np.empty((0, len(bins))),
        sample=average(transfer.sample(kind), expected),
        expected=bins @ expected[known] * scale + noise,
        systematic=np.where(lost_in, 0, quotient(residual[inside], shares) - corrected),
        truth=np.interp(x[inside], *true, left=np.nan, right=np.nan),
        drawn=transfer.drawn,
    )


def in_bands(corrected):
    """{band: (`Corrected`, mask of its values in the band)} for both spectra returned by `correct`."""
    reached = bands(corrected["angular"].x, corrected["frequency"].x)
    return {plain_band(name): (corrected[kind], inside) for name, (kind, inside) in reached.items()}


def remarks_on(corrected):
    """Remarks on the result of `correct`, a list of sentences."""
    places, most, ratios = in_bands(corrected), [], []
    brighter = np.median(
        [
            quotient(np.sum(one.expected[inside]), np.sum(one.residual[inside]))
            for one, inside in places.values()
        ]
    )
    if brighter > _BRIGHTER:
        return [
            f"The mocks have about {brighter:.2g} times the power of the residual (median of bands), so the "
            "corrected spectra are wrong: mocks must be HI and noise only, in the unit that the file states."
        ]
    for name, (one, inside) in places.items():
        if np.sum(one.foreground[inside]) > _MOST * np.sum(one.residual[inside]):
            most.append(name)
        # Significant at `LEVEL` with all errors; where signal loss is small, only an excess counts.
        n_mocks = len(one.sample)
        bar, systematic, sample = one.errors_in(inside)
        expected = 1 / np.mean(one.corrected[inside] / one.expected[inside])  # like the errors
        sigma = np.linalg.norm([bar, systematic, sample * expected * np.sqrt(1 + 1 / n_mocks)])
        chance = len(places) * chance_of(abs(1 - expected) / sigma, n_mocks)
        if chance < LEVEL and (expected < 1 or one.share[inside].mean() < 1 - _LOST):
            ratios.append(f"{name}: {1 / expected:.2g}")
    remarks = []
    if most:
        remarks.append(
            f"Most of the residual in {', '.join(most)} is not explained by the mocks: foreground residual, "
            "to be reduced by more sources (`himap suggest` recommends a number), unless the beam is wrong "
            "or the mocks are too faint, such as without noise (--mock-noise) or in another unit."
        )
    if ratios:
        remarks.append(
            f"The corrected power differs from that of the mocks (ratio in {', '.join(ratios)}). An excess "
            "may be foreground residual that the mocks do not have. Where all signal is lost, the correction "
            "relies on the mocks alone, and is wrong if their spectrum has another shape. Use mocks similar "
            "to the data (--mocks FILE)."
        )
    return remarks


def corrected_table(corrected):
    """A `Table` with a row for each band of l and k, from the result of `correct`; see `HEADER`.

    Error bar, systematic error and sample variance are relative to the corrected power. The pull is
    (corrected - truth) / error bar; the total pull includes the systematic error, in quadrature. Both are for
    the part of the band where the truth is known. Without drawn foregrounds (`CubeTransfer`) the systematic
    error is unknown.
    """
    knows = corrected["angular"].knows_truth
    rows, truncated, header = [], [], HEADER + (HEADER_OF_TRUTH if knows else ())
    for name, (one, inside) in in_bands(corrected).items():
        bar, systematic, sample = one.errors_in(inside)
        row = [name, f"{one.share[inside].mean():.4f}"]
        row += [f"{one.corrected[inside].mean() / one.residual[inside].mean():.4f}"]
        row += [f"{bar:.2%}" if np.isfinite(bar) else "needs two mocks"]
        row += [f"{systematic:.2%}" if one.drawn else "not known", f"{sample:.2%}"]
        if knows:
            known = inside & np.isfinite(one.truth)
            truncated += [name] * bool(known.any() and (known != inside).any())
            ratios, bar, systematic = [np.nan] * 2, np.nan, np.nan
            if known.any():
                ratios = [np.mean(power[known] / one.truth[known]) for power in (one.residual, one.corrected)]
                bar, systematic, _ = one.errors_in(known)
            total = np.hypot(bar, systematic) if one.drawn else np.nan
            pulls = [(ratios[1] - 1) / sigma for sigma in (bar, total)]
            row += [*map("{:.4f}".format, ratios), *map("{:+.1f}".format, pulls)]
        rows.append(row)
    note = f"Truth known only in part of {', '.join(truncated)}: up to l = 2 nside." if truncated else ""
    return band_table(header, rows, note)


def correlation_table(corrected):
    """A `Table` of the correlations of the band errors of `corrected_table`; see `covariance`."""
    columns = {
        name: one.errors @ (inside / inside.sum()) for name, (one, inside) in in_bands(corrected).items()
    }
    matrix = covariance(np.transpose(list(columns.values())))
    bars = np.sqrt(np.diag(matrix))
    rows = [
        [name, *map("{:+.2f}".format, row)]
        for name, row in zip(columns, matrix / bars / bars[:, None], strict=True)
    ]
    note = "Correlations of the error bars of bands."
    return Table(["", *columns], rows, align="l" + "r" * len(columns), note=note)


def band_table(header, rows, note=""):
    """A `Table` with a row of formatted numbers for each band; "–" for unknown values."""
    rows = [["–" if "nan" in cell else cell for cell in row] for row in rows]
    return Table(header, rows, align="l" + "r" * (len(header) - 1), note=note)


def corrected_parts(corrected):
    """Parts of a page: both spectra, residual and corrected, their transfer functions, and a table."""
    n_mocks = len(corrected["angular"].sample)
    text = (
        f"Each of {n_mocks} mocks replaced the HI and noise of the cube and was cleaned with a foreground "
        "drawn from the distribution estimated for the cube; without the beam, on a part of the sky or with "
        "gaps, with the foreground estimated by the method. The recovered share of their power is the "
        "transfer function T. The remaining power of the residual is foreground residual and is subtracted: "
        "with a drawn foreground it is estimated from the cube itself, and the mocks measure the error of "
        "this estimate. Thin lines are one error bar, from mocks corrected by each other: the error of the "
        "cleaning of this sky. The accuracy depends on the foreground estimate: all that was subtracted is "
        "quoted as systematic error, to be added in quadrature; with the foreground estimated by the method "
        "it is unknown. Sample variance and noise are a column of the table, included in neither. Mocks must "
        "be similar to the data: their HI has the power assumed by himap, or that of the given files."
    )
    panels, shares = [], []
    for kind, one in corrected.items():
        bars = one.sigma(np.eye(len(one.x)))
        curves = [
            (one.x, one.residual, {"label": "residual", "color": styles.ORANGE, "linestyle": "--"}),
            (one.x, one.corrected, {"label": "corrected", "color": styles.INDIGO}),
        ]
        edges = ((one.corrected * (1 + sign * bars)) for sign in (-1, 1))
        thin = {"color": styles.INDIGO, "linewidth": 0.5, "label": "_error bar"}
        curves += [(one.x, edge, thin) for edge in edges if np.isfinite(edge).all()]
        if one.knows_truth:
            curves.append((one.x, one.truth, {"label": "truth", "color": "black", "linestyle": ":"}))
        curves.append((one.x, one.expected, {"label": "mocks", "color": styles.BLUE, "linewidth": 0.8}))
        panels.append(panel(kind, curves))
        share = [(one.x, one.share, {"color": styles.BLUE})]
        shares.append(panel(kind, share, ylabel="$T$", yscale="linear", ylim=(0, 1.1)))
    picture, alt = plotting.lines(panels + shares, size=(4.6, 3)), "Corrected spectra and transfer functions"
    tables = [corrected_table(corrected), *([correlation_table(corrected)] if n_mocks > 1 else [])]
    return [figure(picture, alt, text, title="Corrected spectra"), *tables]


def write_spectra(corrected, path, scatter=None):
    """Write both spectra as CSV, one row for each l or k; NaN for unknown values.

    Columns: ``spectrum`` (angular or frequency), ``x`` (l, or k in 1/MHz), and of `Corrected` ``residual``
    (mK^2, or mK^2 MHz), ``transfer_function``, ``corrected``, ``sigma`` and ``sample`` (both relative),
    ``expected``, ``systematic``, ``truth`` (as ``residual``); ``error_1`` and so on for each mock, from which
    `himap.measures.bootstrap.covariance` gives the relative covariance of rows or of means over them; for a
    `Scatter` of restarts also its `columns`.
    """
    tables = []
    for kind, one in corrected.items():
        each = np.eye(len(one.x))
        columns = {"residual": one.residual, "transfer_function": one.share, "corrected": one.corrected}
        columns |= {"sigma": one.sigma(each), "sample": one.sigma(each, "sample")}
        systematic = one.systematic if one.drawn else np.nan
        columns |= {"expected": one.expected, "systematic": systematic, "truth": one.truth}
        columns |= {f"error_{n}": errors for n, errors in enumerate(one.errors, 1)}
        columns |= {} if scatter is None else scatter.columns(kind, one.x)
        tables.append(pd.DataFrame({"spectrum": kind, "x": one.x, **columns}))
    pd.concat(tables).to_csv(path, index=False, float_format="%.8g", na_rep="nan")
