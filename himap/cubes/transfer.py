"""Signal loss of a method on a cube, from mocks put into it, and the spectra of the cube corrected for it."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from himap.core.checks import checked_cube
from himap.core.errors import InputError
from himap.cubes.report import figure, panel
from himap.figures import plotting, styles
from himap.figures.tables import Table
from himap.maps import sphere
from himap.maps.low_rank import LowRankCube
from himap.measures.diagnostics import bands
from himap.measures.low_rank_spectra import FAINT, masked_alms
from himap.measures.transfer import TransferFunction, mock_power, mock_power_of_cubes
from himap.removal.data import means_of

HEADER = ("band", "comes back", "error bar", "left / truth", "corrected / truth")
"""Columns of `corrected_table`; the last two where there is a truth."""


@dataclass(frozen=True, kw_only=True)
class Corrected:
    """One spectrum of a cleaned cube, corrected for what cleaning takes.

    Attributes
    ----------
    x
        l, or k in 1/MHz, (n,).
    residual
        As the method leaves it, C_l averaged over channels in mK^2, or P(k) in mK^2 MHz.
    share
        The transfer function.
    errors
        Relative errors of mocks that are corrected by each other, (n_mocks, n); of one mock none, (0, n).
    truth
        The spectrum of the truth, NaN where it is not known.
    """

    x: np.ndarray
    residual: np.ndarray
    share: np.ndarray
    errors: np.ndarray
    truth: np.ndarray

    @property
    def corrected(self):
        """residual / share; NaN where nothing comes back."""
        out = np.full(len(self.x), np.nan)
        return np.divide(self.residual, self.share, out=out, where=self.share > 0)

    @property
    def knows_truth(self):
        """Whether the truth is known anywhere."""
        return bool(np.isfinite(self.truth).any())

    def sigma(self, bins):
        """Relative error bars of means over bins, rows of weights (n_bins, n); NaN where one mock is all."""
        if not len(self.errors):
            return np.full(len(bins), np.nan)
        return np.sqrt(np.mean((self.errors @ np.transpose(bins)) ** 2, axis=0))


def measure_transfer(cleaned, mocks):
    """The `TransferFunction` of a method on a cube, from mocks that are cleaned with it as it was.

    Mocks go through the gaps of a cube and are cleaned with its weights. Where a voxel is missing both the
    mock and what comes back of it count as 0, as does what is left of the cube: gaps take the same of all
    three, so that the ratio is what the method loses, and what it makes up in a gap is not in it.

    Parameters
    ----------
    cleaned
        The `CleanedCube`.
    mocks
        Maps of mocks, (n_channels, n_seen) each, mK, seen through the beam of the cube; made one at a time if
        they are a generator. What they have where a voxel is missing counts nothing.

    Raises
    ------
    InputError
        No mock, or one of another shape than the cube.
    """
    cube, powers = cleaned.cube, []
    cube.check_sphere()
    for mock in mocks:
        mock = checked_cube("a mock", mock)
        if mock.shape != cube.maps.shape:
            raise InputError(
                f"a mock must have the channels and seen pixels of the cube, {cube.maps.shape}, got "
                f"{mock.shape}."
            )
        found = cleaned.with_mock(mock).separation
        if cube.missing is None:
            faint = FAINT * float(mock.var(axis=1, dtype=np.float64).sum())
            alms = alms_of(cube, mock, found.lmax)
            powers.append(mock_power_of_change(cube, alms, cleaned.separation, found, faint))
            continue
        # Both cubes have 0 in the gaps.
        change = found.foreground + -cleaned.separation.foreground
        back = change.subtract_from(mock, found.means - cleaned.separation.means)
        mock = (mock - means_of(mock, cube.weights)[:, None]).astype(mock.dtype)
        alms = (alms_of(cube, np.where(cube.missing, 0, maps)) for maps in (mock, back))
        powers.append(mock_power_of_cubes(*alms, cube.channel_width))
    return TransferFunction(mocks=tuple(powers))


def alms_of(cube, maps, lmax=None):
    """Coefficients of maps (n_channels, n_seen) of a cube, less their means, to `lmax` if one is given."""
    alms = masked_alms(cube.on_sphere(maps), mask=cube.sky_mask)
    return alms if lmax is None else sphere.alms_upto(alms, lmax)


def mock_power_of_change(cube, alms, before, after, faint):
    """The `MockPower` of what came back as more than it was by as much as the foreground changed.

    Parameters
    ----------
    cube
        The `Cube`, without missing voxels.
    alms
        Coefficients of what was put in (`alms_of`).
    before, after
        The `Separation` that the foreground is of, and the one that it is then of.
    faint
        Variance, mK^2, summed over channels, of terms of the change that are left out.
    """
    change = (before.foreground + -after.foreground).truncate(faint)
    if not len(change.maps):  # nothing moves
        change = LowRankCube(spectra=np.zeros((len(cube.freqs), 1)), maps=np.zeros((1, cube.maps.shape[1])))
    return mock_power(alms, replace(change, maps=cube.on_sphere(change.maps)), cube.channel_width)


def correct(spectra, transfer, truth=None):
    """Both spectra of a cleaned cube, corrected, {"angular": `Corrected`, "frequency": `Corrected`}.

    Parameters
    ----------
    spectra
        Its `PowerSpectra`, in bins of l where a mask asks for them.
    transfer
        The `TransferFunction` from `measure_transfer`.
    truth
        The `Comparison` with the truth, if there is one.
    """
    angular, frequency, found = spectra.angular, spectra.frequency, {}
    true = (
        {}
        if truth is None
        else {"angular": (truth.degrees, truth.true_angular), "frequency": (truth.k, truth.true_frequency)}
    )
    for kind, x, power, known_at in (
        ("angular", angular.degrees, angular.mean, transfer.degrees[2:]),
        ("frequency", frequency.k, frequency.power, transfer.k[1:]),
    ):
        half, known = (x[1] - x[0]) / 2, slice(-len(known_at), None)
        inside = (x >= known_at[0]) & (x <= known_at[-1])
        bins = np.abs(known_at - x[inside, None]) < half
        bins = bins / np.maximum(bins.sum(axis=1, keepdims=True), 1)
        several = len(transfer.mocks) > 1
        errors = transfer.errors(kind)[:, known] if several else np.empty((0, len(known_at)))
        found[kind] = Corrected(
            x=x[inside],
            residual=power[inside],
            share=bins @ getattr(transfer, kind)[known],
            errors=errors @ bins.T,
            truth=np.interp(x[inside], *true.get(kind, ([0], [np.nan])), left=np.nan, right=np.nan),
        )
    return found


def corrected_table(corrected):
    """A `Table` with a line for each band of l and k, of what `correct` gives; see `HEADER`."""
    rows, header = [], HEADER if corrected["angular"].knows_truth else HEADER[:3]
    for name, (kind, inside) in bands(corrected["angular"].x, corrected["frequency"].x).items():
        one = corrected[kind]
        (sigma,) = one.sigma([inside / inside.sum()])
        spread = f"{sigma:.2%}" if np.isfinite(sigma) else "needs two mocks"
        ratios = (np.mean(power[inside] / one.truth[inside]) for power in (one.residual, one.corrected))
        row = [plain_band(name), f"{one.share[inside].mean():.4f}", spread, *map("{:.4f}".format, ratios)]
        rows.append(row[: len(header)])
    return Table(header, rows, align="lrrrr")


def plain_band(name):
    """The name of a band of ratios as that of a band of the spectrum."""
    ratio, _, where = name.partition(", ")
    return f"C(l), l {where}" if ratio == "C/C0" else f"P(k), k {where.removeprefix('k ')}"


def corrected_parts(corrected, n_mocks):
    """Parts of a page: both spectra, as they are and corrected, their transfer functions, and a table."""
    text = (
        f"Each of {n_mocks} mocks was put into the cube and cleaned with it. The spectra are divided by the "
        "share of its power that comes back; thin lines are one error bar, from mocks that are corrected by "
        "each other. They know nothing of foreground that is left: where too few sources are removed, the "
        "corrected spectrum is too high. Where more are removed than the foreground has, its scatter grows."
    )
    panels, shares = [], []
    for kind, one in corrected.items():
        bars = one.sigma(np.eye(len(one.x)))
        curves = [
            (one.x, one.residual, {"label": "as it is left", "color": styles.ORANGE, "linestyle": "--"}),
            (one.x, one.corrected, {"label": "corrected", "color": styles.INDIGO}),
        ]
        edges = ((one.corrected * (1 + sign * bars)) for sign in (-1, 1))
        thin = {"color": styles.INDIGO, "linewidth": 0.5, "label": "_error bar"}
        curves += [(one.x, edge, thin) for edge in edges if np.isfinite(edge).all()]
        if one.knows_truth:
            curves.append((one.x, one.truth, {"label": "truth", "color": "black", "linestyle": ":"}))
        panels.append(panel(kind, curves))
        share = [(one.x, one.share, {"color": styles.BLUE})]
        shares.append(panel(kind, share, ylabel="share that comes back", yscale="linear", ylim=(0, 1.1)))
    picture, alt = plotting.lines(panels + shares, size=(4.6, 3)), "Corrected spectra and transfer functions"
    return [figure(picture, alt, text, title="Corrected for what was lost"), corrected_table(corrected)]


def write_spectra(corrected, path):
    """Write both spectra as CSV, one l or k a line; NaN where something is not known.

    Columns: ``spectrum`` (angular or frequency), ``x`` (l, or k in 1/MHz), ``left`` (mK^2, or mK^2 MHz),
    ``transfer_function``, ``corrected``, ``sigma`` (relative) and ``truth``.
    """
    tables = []
    for kind, one in corrected.items():
        columns = {"left": one.residual, "transfer_function": one.share, "corrected": one.corrected}
        columns |= {"sigma": one.sigma(np.eye(len(one.x))), "truth": one.truth}
        tables.append(pd.DataFrame({"spectrum": kind, "x": one.x, **columns}))
    pd.concat(tables).to_csv(path, index=False, float_format="%.8g", na_rep="nan")
