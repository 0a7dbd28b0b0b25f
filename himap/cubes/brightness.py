"""Cross-check of corrected power: residual power by foreground brightness, extrapolated to no foreground.

Foreground residual increases with the foreground, HI and noise do not. The extrapolation needs neither an
estimate of the residual nor a beam. The brightest part dominates the linear fit, so a residual that is
equally bright in all other parts is not detected.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from himap.cubes.corrected import band_table, in_bands
from himap.maps.low_rank import blocks
from himap.measures.bootstrap import LEVEL, of_others, significance
from himap.measures.spectra import frequency_power

N_PARTS = 5
"""Number of parts of the sky, with equal numbers of pixels."""

COLUMNS = ["faintest", *map(str, range(2, N_PARTS)), "brightest", "no foreground", "error", "chance"]
"""Of the result of `by_brightness`."""


@dataclass(frozen=True, kw_only=True)
class Parts:
    """Observed pixels of a cleaned cube, grouped by the brightness of its foreground, faintest first.

    Attributes
    ----------
    pixels
        Indices of the pixels of each part, a list of arrays.
    brightness
        Mean squared foreground of each part, relative to that of all pixels, (`N_PARTS`,).
    """

    pixels: list
    brightness: np.ndarray

    @classmethod
    def of(cls, cleaned):
        """The `Parts` of a `CleanedCube`."""
        separation, squares = cleaned.separation, np.empty(cleaned.cube.maps.shape[1])
        for block in blocks(len(squares)):
            lines = separation.foreground.lines(block) + separation.means[:, None]
            squares[block] = np.mean(lines**2, axis=0)
        pixels = np.array_split(np.argsort(squares, kind="stable"), N_PARTS)
        brightness = np.array([squares[part].mean() for part in pixels])
        return cls(pixels=pixels, brightness=brightness / squares.mean())

    def powers(self, residual, channel_width):
        """P(k) of a residual (n_channels, n_seen), mK, in each part, mK^2 MHz, (`N_PARTS`, n_k)."""
        return np.array([frequency_power(residual[:, part], channel_width).power for part in self.pixels])

    def without(self, ratios):
        """Ratios (..., `N_PARTS`) extrapolated linearly to zero brightness, (...)."""
        design = np.vander(self.brightness, 2, increasing=True)
        return ratios @ np.linalg.pinv(design)[0]


def by_brightness(cleaned, transfer, corrected):
    """Residual power by foreground brightness in each band of k, relative to T times the corrected power.

    For a `CleanedCube`, its `CubeTransfer`, and the result of `correct`.

    Returns
    -------
    DataFrame
        A row per band of k. Columns are `COLUMNS`: for each part, divided by the same ratio for the mocks;
        "no foreground", extrapolated to none: 1 if the subtracted foreground residual is correct; "error" of
        its difference from 1: extrapolation error from mocks compared with each other, error bar and
        systematic error of the corrected power, in quadrature; "chance", the probability of a deviation at
        least as large. The last two are NaN for a single mock.
    """
    parts, one, rows = transfer.parts, corrected["frequency"], []
    own = parts.powers(cleaned.residual, cleaned.cube.channel_width)[:, 1:]
    for name, (spectrum, inside) in in_bands(corrected).items():
        if spectrum is not one:
            continue
        mocks, residual = transfer.powers[..., 1:][..., inside].mean(axis=-1), own[:, inside].mean(axis=-1)
        foreground, total = (np.mean(each[inside]) for each in (one.foreground, one.residual))
        ratios = _shape(residual) / _shape(mocks.mean(axis=0)) * total / (total - foreground)
        without = parts.without(ratios)
        errors = parts.without(_shape(mocks) / _shape(of_others(mocks))) - 1
        known = significance(without - 1, errors, *one.errors_in(inside)[:2])
        rows.append([name, *ratios, without, *known.values()])
    return pd.DataFrame(rows, columns=["band", *COLUMNS]).set_index("band")


def _shape(powers):
    """Powers (..., `N_PARTS`) divided by their mean."""
    return powers / powers.mean(axis=-1, keepdims=True)


def brightness_table(power):
    """A `Table` of the result of `by_brightness`."""
    rows = [
        [name, *map("{:.4f}".format, ratios), f"{error:.2%}", f"{chance:.2g}"]
        for name, *ratios, error, chance in power.itertuples()
    ]
    note = (
        "Residual power by foreground brightness, relative to T times the corrected power; extrapolated to "
        "no foreground, with the error of this and of the corrected power, and the probability of a "
        "deviation from 1 at least as large."
    )
    return band_table(["fifths of the sky", *COLUMNS], rows, note)


def remarks_on_brightness(power):
    """Remarks on significant deviations, a list of sentences."""
    unlike = power.index[power["chance"] * len(power) < LEVEL]
    return [
        f"The corrected power differs from that of the residual extrapolated to no foreground in "
        f"{', '.join(unlike)}: the subtracted foreground residual is wrong, the beam differs, or the noise "
        "is not distributed as in the mocks."
    ] * bool(len(unlike))
